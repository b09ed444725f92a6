//! Poses that are refined with the objects (`localize --refine-poses`): simulated drives with errors of poses, and KITTI's GPS poses.

use std::path::Path;

use quadlift::metrics::{iou3d_bodies, nees};
use quadlift::nalgebra::{Rotation3, Vector3, Vector6};
use quadlift::solve::{BodyKind, MapOptions, PoseMotion};
use quadlift::synthetic::random::{normal, stream};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, LocalizeOptions, localize};
use rayon::prelude::*;

use crate::data::TrueScene;
use crate::error::Error;
use crate::kitti::{AVERAGED, cars, protocol};
use crate::progress::{Progress, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, average, median_figure};
use crate::table::{Cell, Table};

/// Cars, frames and drives of each row, and the noise of the edges of boxes in half sizes.
const CARS: usize = 24;
const FRAMES: usize = 60;
const DRIVES: u64 = 6;
const FIRST_SEED: u64 = 91;
const EDGE_NOISE: f64 = 0.03;

const ERROR_STREAM: u64 = 50;

/// Errors of poses: their name, standard deviations of rotation (radians) and shift, and frames after which the correlation is 1/e.
const ERRORS: [(&str, f64, f64, f64); 4] = [
    ("none", 0.0, 0.0, 0.0),
    ("independent, .003 rad, .05", 0.003, 0.05, 0.0),
    ("slow (100 frames), .02 rad, .3", 0.02, 0.3, 100.0),
    ("slow (20 frames), .01 rad, .2", 0.01, 0.2, 20.0),
];

const MOTIONS: [(&str, Option<PoseMotion>); 3] =
    [("as given", None), ("independent", Some(PoseMotion::Independent)), ("slow", Some(PoseMotion::Slow))];

fn drive(seed: u64) -> Result<SyntheticScene, Error> {
    Ok(generate(&SyntheticOptions {
        seed,
        objects: CARS,
        views: FRAMES,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(EDGE_NOISE)],
        ..Default::default()
    })?)
}

/// The drive with errors of its poses.
fn with_errors(
    made: &SyntheticScene,
    (_, rotation, shift, memory): (&str, f64, f64, f64),
    seed: u64,
) -> Result<SyntheticScene, Error> {
    let mut rng = stream(seed, ERROR_STREAM);
    let rho = if memory > 0.0 { (-1.0 / memory).exp() } else { 0.0f64 };
    let mut given = made.clone();
    given.scene.edit(|parts| {
        let mut error = Vector6::from_fn(|_, _| normal(&mut rng));
        for frame in &mut parts.frames {
            error = error * rho + Vector6::from_fn(|_, _| normal(&mut rng)) * (1.0 - rho * rho).sqrt();
            let turn = Rotation3::new(error.fixed_rows::<3>(0) * rotation);
            if let Some(moved) = frame.projection.with_moved_camera(&turn, &(error.fixed_rows::<3>(3) * shift)) {
                frame.projection = moved;
            }
        }
    })?;
    Ok(given)
}

/// Scores of a drive: sum of O3D, objects, squared NEES list, errors of rotations and of positions (less their means), NEES of poses.
#[derive(Default)]
struct Scores {
    o3d: Vec<f64>,
    nees: Vec<f64>,
    rotation: f64,
    position: f64,
    pose_nees: Vec<f64>,
}

fn scores(made: &SyntheticScene, given: &SyntheticScene, found: &Localization) -> Scores {
    let mut scores = Scores::default();
    for estimate in &found.estimates {
        let id = &made.scene.object_ids[estimate.object_index];
        let Some((_, truth)) = made.truth.iter().find(|(name, _)| name == id) else { continue };
        scores.o3d.push(estimate.body.map_or(0.0, |body| iou3d_bodies(&body, truth)));
        let body = estimate.ellipsoid().zip(estimate.covariance);
        scores.nees.extend(body.and_then(|(e, c)| nees(&e, &truth.ellipsoid(), &c.matrix)));
    }
    let (mut turns, mut shifts) = (Vec::new(), Vec::new());
    for (index, frame) in made.scene.frames.iter().enumerate() {
        let Some(refined) = found.refined_poses.iter().find(|refined| refined.frame_index == index) else {
            push_error(&given.scene.frames[index].projection, &frame.projection, &mut turns, &mut shifts);
            continue;
        };
        let given = &given.scene.frames[index].projection;
        let moved = given.with_moved_camera(&refined.turn, &refined.shift).unwrap_or(*given);
        push_error(&moved, &frame.projection, &mut turns, &mut shifts);
        if let (Some(turn), Some(shift), Some(covariance)) = (turns.last(), shifts.last(), &refined.covariance) {
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            let whitened = covariance.cholesky().map(|root| error.dot(&root.solve(&error)));
            scores.pose_nees.extend(whitened);
        }
    }
    (scores.rotation, scores.position) = (spread(&turns), spread(&shifts));
    scores
}

fn push_error(
    found: &quadlift::geometry::Projection,
    truth: &quadlift::geometry::Projection,
    turns: &mut Vec<Vector3<f64>>,
    shifts: &mut Vec<Vector3<f64>>,
) {
    let rotations = found.world_from_cam_rotation().zip(truth.world_from_cam_rotation());
    let centers = found.center_in_world().zip(truth.center_in_world());
    if let (Some((a, b)), Some((c, d))) = (rotations, centers) {
        turns.push(Rotation3::from_matrix(&(a * b.transpose())).scaled_axis());
        shifts.push(c - d);
    }
}

/// Root mean square of vectors less their mean.
fn spread(errors: &[Vector3<f64>]) -> f64 {
    let count = errors.len().max(1) as f64;
    let mean = errors.iter().sum::<Vector3<f64>>() / count;
    (errors.iter().map(|error| (error - mean).norm_squared()).sum::<f64>() / count).sqrt()
}

/// Adds the table of simulated drives.
pub(super) fn run(seed: u64, progress: Progress, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", ERRORS.len() * MOTIONS.len(), progress);
    report.text(format!(
        "Poses that are refined with the objects (`localize --refine-poses`): {DRIVES} drives of {FRAMES} frames along {CARS} cars, boxes with \
         {EDGE_NOISE} of their half size of noise, poses with errors. Errors of poses are root mean squares less their mean over the \
         drive, which no box shows. NEES: medians, of objects with 9 parameters (8.34), of poses with 6 (5.35)."
    ));
    let titles = ["errors of poses", "refined", "rotation, rad", "position", "O3D", "NEES of objects", "NEES of poses"];
    let mut table = Table::new("Refined poses: simulated drives", titles);
    let mut halved = Vec::new();
    for errors in ERRORS {
        let mut as_given = 0.0;
        for (name, refine_poses) in MOTIONS {
            let of_drive = |k: u64| -> Result<Scores, Error> {
                let seed = seed.wrapping_add(FIRST_SEED + k);
                let made = drive(seed)?;
                let given = with_errors(&made, errors, seed)?;
                let map = MapOptions { body: Some(BodyKind::Ellipsoid), refine_poses, ..Default::default() };
                let found = localize(&given.scene, &LocalizeOptions { seed, ..map.into() })?;
                Ok(scores(&made, &given, &found))
            };
            let drives: Vec<Scores> = (0..DRIVES).into_par_iter().map(of_drive).collect::<Result<_, Error>>()?;
            steps.done();
            let mean = |of: fn(&Scores) -> f64| drives.iter().map(of).sum::<f64>() / drives.len() as f64;
            let figure = |value| Some(Figure { value, standard_error: None });
            let rotation = mean(|s| s.rotation);
            match refine_poses {
                None => as_given = rotation,
                Some(_) if as_given > 0.0 => halved.push((name, errors, rotation / as_given)),
                Some(_) => {}
            }
            let normalised =
                |of: fn(&Scores) -> &Vec<f64>| median_figure(drives.iter().flat_map(|s| of(s).clone()).collect());
            table.push(vec![
                errors.0.into(),
                name.into(),
                Cell::figure(figure(rotation), 5),
                Cell::figure(figure(mean(|s| s.position)), 4),
                Cell::figure(average(&drives.iter().map(|s| s.o3d.clone()).collect::<Vec<_>>()), 3),
                Cell::figure(normalised(|s| &s.nees), 1),
                Cell::figure(normalised(|s| &s.pose_nees), 1),
            ]);
        }
    }
    report.table(table);
    // Of the motion that suits the errors.
    let suits =
        |(name, (_, _, _, memory), _): &&(&str, (&str, f64, f64, f64), f64)| (*name == "slow") == (*memory > 0.0);
    let worst = halved.iter().filter(suits).map(|(_, _, ratio)| *ratio).fold(0.0, f64::max);
    report.headlines.push(Headline::ours(
        "cameras_refined",
        "rotation errors of refined poses over those given, simulated drives, largest",
        "map",
        worst,
    ));
    Ok(())
}

/// Adds the table of KITTI.
pub(super) fn run_real(data: &Path, seed: u64, progress: Progress, report: &mut Report) -> Result<(), Error> {
    let kinds = [("oxts", "GPS and IMU"), ("aligned", "registered on the labels")];
    let steps = Steps::new("cameras", kinds.len() * MOTIONS.len(), progress);
    let titles = ["poses", "refined", "O3D", "centres within 1 m, %", "centres within 2 m, %"];
    let mut table = Table::new("Refined poses: KITTI, RRC boxes, car prior", titles);
    for (poses, words) in kinds {
        let read = |name: &&str| TrueScene::read(data, &format!("kitti_{name}_{poses}"), name);
        let scenes: Vec<TrueScene> = AVERAGED.iter().map(read).collect::<Result<_, _>>()?;
        for (name, refine_poses) in MOTIONS {
            let mut options = LocalizeOptions::from(MapOptions { refine_poses, ..cars(BodyKind::Cuboid) });
            protocol("rrc", seed)(&mut options);
            let scores: Vec<_> = scenes.par_iter().map(|scene| scene.scores(&options)).collect::<Result<_, Error>>()?;
            steps.done();
            let of = |measure: Measure| average(&scores.iter().map(|s| measure.values(s)).collect::<Vec<_>>());
            let mut cells: Vec<Cell> = vec![words.into(), name.into(), Cell::figure(of(Measure::O3d), 3)];
            cells.extend([1.0, 2.0].map(|within| Cell::figure(of(Measure::CenterWithin(within)), 1)));
            table.push(cells);
        }
    }
    report.table(table);
    Ok(())
}

//! Poses that are refined with the objects (`localize --refine-poses`): simulated drives with errors of poses, and KITTI's GPS poses.

use std::path::Path;

use quadlift::geometry::{Body, BodyKind, CamFromWorld, rotation_vector};
use quadlift::metrics::{iou3d_bodies, nees};
use quadlift::nalgebra::{IsometryMatrix3, Rotation3, Vector3, Vector6};
use quadlift::random::{normal, stream};
use quadlift::solve::{PoseMotion, PosteriorOptions};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, LocalizeOptions, localize};
use rayon::prelude::*;

use crate::data::{MIN_VIEWS, TrueScene};
use crate::error::Error;
use crate::kitti::{AVERAGED, cars, protocol};
use crate::progress::{Run, Steps};
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

const MOTIONS: [(&str, Option<PoseMotion>); 4] = [
    ("as given", None),
    ("auto", Some(PoseMotion::Auto)),
    ("independent", Some(PoseMotion::Independent)),
    ("slow", Some(PoseMotion::Slow)),
];

/// The row with points: tracks of a drive, errors of their pixels, and share of wrong observations.
const WITH_POINTS: (&str, Option<PoseMotion>) = ("auto, with points", Some(PoseMotion::Auto));
const POINTS: usize = 1500;
const POINT_NOISE: f64 = 0.5;
const POINT_MISMATCHES: f64 = 0.05;

fn drive(seed: u64, points: usize) -> Result<SyntheticScene, Error> {
    Ok(generate(&SyntheticOptions {
        seed,
        objects: CARS,
        views: FRAMES,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(EDGE_NOISE)],
        points,
        point_noise: POINT_NOISE,
        point_mismatches: POINT_MISMATCHES,
        ..Default::default()
    })?)
}

/// The drive with errors of its poses.
fn with_errors(
    made: &SyntheticScene,
    (_, rotation, shift, correlation_length): (&str, f64, f64, f64),
    seed: u64,
) -> Result<SyntheticScene, Error> {
    let mut rng = stream(seed, ERROR_STREAM);
    let rho = if correlation_length > 0.0 { (-1.0 / correlation_length).exp() } else { 0.0f64 };
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
        let body = estimate.closest_ellipsoid().zip(estimate.covariance);
        scores.nees.extend(body.and_then(|(e, c)| nees(&e, &truth.closest_ellipsoid(), &c.matrix)));
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
        turns.push(rotation_vector(&Rotation3::from_matrix(&(a * b.transpose()))));
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
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", ERRORS.len() * (MOTIONS.len() + 1), run.progress);
    let count = run.scenes(DRIVES);
    report.text(format!(
        "Poses that are refined with the objects (`localize --refine-poses`): {count} drives of {FRAMES} frames along {CARS} cars, boxes with \
         {EDGE_NOISE} of their half size of noise, poses with errors. Errors of poses are root mean squares less their mean over the \
         drive, which no box shows. \"With points\": {POINTS} points of structure from motion, each tracked through 3 to 20 frames, {POINT_NOISE} px \
         of noise, {POINT_MISMATCHES} of the observations wrong. NEES: medians, of objects with 9 parameters (8.34), of poses with 6 (5.35)."
    ));
    let titles = ["errors of poses", "refined", "rotation, rad", "position", "O3D", "NEES of objects", "NEES of poses"];
    let mut table = Table::new("Refined poses: simulated drives", titles);
    let mut halved = Vec::new();
    for errors in ERRORS {
        let mut as_given = 0.0;
        for (name, refine_poses) in MOTIONS.into_iter().chain([WITH_POINTS]) {
            let points = if name == WITH_POINTS.0 { POINTS } else { 0 };
            let of_drive = |k: u64| -> Result<Scores, Error> {
                let seed = run.seed.wrapping_add(FIRST_SEED + k);
                let made = drive(seed, points)?;
                let given = with_errors(&made, errors, seed)?;
                let map = PosteriorOptions { body: Some(BodyKind::Ellipsoid), refine_poses, ..Default::default() };
                let found = localize(&given.scene, &LocalizeOptions { seed, ..map.into() })?;
                Ok(scores(&made, &given, &found))
            };
            let drives: Vec<Scores> = (0..count).into_par_iter().map(of_drive).collect::<Result<_, Error>>()?;
            steps.done();
            let mean = |of: fn(&Scores) -> f64| drives.iter().map(of).sum::<f64>() / drives.len() as f64;
            let figure = |value| Some(Figure { value, standard_error: None });
            let rotation = mean(|s| s.rotation);
            match refine_poses {
                None => as_given = rotation,
                Some(_) if as_given > 0.0 => halved.push((name, errors, rotation / as_given)),
                Some(_) => {}
            }
            let normalized =
                |of: fn(&Scores) -> &Vec<f64>| median_figure(drives.iter().flat_map(|s| of(s).clone()).collect());
            table.push(vec![
                errors.0.into(),
                name.into(),
                Cell::figure(figure(rotation), 5),
                Cell::figure(figure(mean(|s| s.position)), 4),
                Cell::figure(average(&drives.iter().map(|s| s.o3d.clone()).collect::<Vec<_>>()), 3),
                Cell::figure(normalized(|s| &s.nees), 1),
                Cell::figure(normalized(|s| &s.pose_nees), 1),
            ]);
        }
    }
    report.table(table);
    // Of the motion that suits the errors.
    let suits = |(name, (_, _, _, correlation_length), _): &&(&str, (&str, f64, f64, f64), f64)| {
        (*name == "slow") == (*correlation_length > 0.0)
    };
    let worst = halved.iter().filter(suits).map(|(_, _, ratio)| *ratio).fold(0.0, f64::max);
    report.headlines.push(Headline::ours(
        "cameras_refined",
        "rotation errors of refined poses over those given, simulated drives, largest",
        "posterior",
        worst,
    ));
    Ok(())
}

/// Volume IoU and the distance of the centers of each object as its cameras see it, averaged over its views: the true object of the
/// `registered` scene is placed by the pose of that scene's camera, the estimate by the refined one. What moves cameras and objects
/// together does not count.
fn seen_from_cameras(found: &Localization, given: &TrueScene, registered: &TrueScene) -> Vec<(f64, f64)> {
    let pose = |frame: &quadlift::scene::Frame| frame.projection.camera_pose();
    let mut scores = Vec::new();
    for estimate in found.estimates.iter().filter(|estimate| estimate.views.len() >= MIN_VIEWS) {
        let id = &given.scene.object_ids[estimate.object_index];
        let Some(truth) = registered.truth.iter().find(|object| object.id == *id).and_then(|object| object.cuboid)
        else {
            continue;
        };
        let placed = |frame_index: usize| {
            let frame = &given.scene.frames[frame_index];
            let other = registered.scene.frames.iter().find(|other| other.id == frame.id)?;
            let refined = found.refined_poses.iter().find(|refined| refined.frame_index == frame_index);
            let given = pose(frame)?;
            let refined = refined.map_or(Some(given), |refined| refined.cam_from_world(&given).ok())?;
            let (world, camera) = (isometry(&refined)?.inverse(), isometry(&pose(other)?)?);
            let motion = world * camera;
            let center = motion * truth.center;
            Some(Body { center, rotation: motion.rotation * truth.rotation, ..truth })
        };
        let views: Vec<Body> = estimate.views.iter().filter_map(|view| placed(view.frame_index)).collect();
        if views.is_empty() {
            continue;
        }
        let overlap = |truth: &Body| estimate.body.map_or(0.0, |body| iou3d_bodies(&body, truth));
        let distance = |truth: &Body| estimate.center.map_or(f64::INFINITY, |center| (center - truth.center).norm());
        let mean = |of: &dyn Fn(&Body) -> f64| views.iter().map(of).sum::<f64>() / views.len() as f64;
        scores.push((mean(&overlap), mean(&distance)));
    }
    scores
}

fn isometry(pose: &CamFromWorld) -> Option<IsometryMatrix3<f64>> {
    let matrix = pose.matrix();
    let rotation = Rotation3::from_matrix_unchecked(matrix.fixed_columns::<3>(0).into_owned());
    let translation = matrix.column(3).into_owned();
    translation.iter().all(|x| x.is_finite()).then(|| IsometryMatrix3::from_parts(translation.into(), rotation))
}

/// Adds the table of KITTI.
pub(super) fn run_real(data: &Path, run: &Run, report: &mut Report) -> Result<(), Error> {
    let kinds = [("oxts", "GPS and IMU"), ("aligned", "registered on the labels")];
    let steps = Steps::new("cameras", kinds.len() * MOTIONS.len(), run.progress);
    let titles = ["poses", "refined", "O3D", "centers within 1 m, %", "from the cameras: O3D", "centers within 1 m, %"];
    let registered: Vec<TrueScene> = AVERAGED
        .iter()
        .map(|name| TrueScene::read(data, &format!("kitti_{name}_aligned"), name))
        .collect::<Result<_, _>>()?;
    let mut table = Table::new(
        "Refined poses: KITTI, RRC boxes, car prior (from the cameras: the registered scene places the true cars in each frame)",
        titles,
    );
    for (poses, words) in kinds {
        let read = |name: &&str| TrueScene::read(data, &format!("kitti_{name}_{poses}"), name);
        let scenes: Vec<TrueScene> = AVERAGED.iter().map(read).collect::<Result<_, _>>()?;
        for (name, refine_poses) in MOTIONS {
            let mut options = LocalizeOptions::from(PosteriorOptions { refine_poses, ..cars(BodyKind::Cuboid) });
            protocol("rrc", run.seed)(&mut options);
            let found: Vec<Localization> =
                (scenes.par_iter().map(|scene| localize(&scene.scene, &options))).collect::<Result<_, _>>()?;
            steps.done();
            let scores: Vec<_> = scenes.iter().zip(&found).map(|(scene, found)| scene.scores_of(found)).collect();
            let of = |measure: Measure| average(&scores.iter().map(|s| measure.values(s)).collect::<Vec<_>>());
            let mut cells: Vec<Cell> = vec![words.into(), name.into(), Cell::figure(of(Measure::O3d), 3)];
            cells.push(Cell::figure(of(Measure::CenterWithin(1.0)), 1));
            let seen: Vec<Vec<(f64, f64)>> = (found.iter().zip(&scenes).zip(&registered))
                .map(|((found, scene), registered)| seen_from_cameras(found, scene, registered))
                .collect();
            let averaged = |of: fn(&(f64, f64)) -> f64| {
                average(&seen.iter().map(|scores| scores.iter().map(of).collect()).collect::<Vec<_>>())
            };
            cells.push(Cell::figure(averaged(|(overlap, _)| *overlap), 3));
            cells.push(Cell::figure(averaged(|(_, distance)| if *distance < 1.0 { 100.0 } else { 0.0 }), 1));
            table.push(cells);
        }
    }
    report.table(table);
    Ok(())
}

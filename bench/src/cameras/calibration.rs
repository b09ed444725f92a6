//! Rigs of fixed cameras from people who walk by (`quadlift calibrate-rig`): synthetic halls.

use std::collections::BTreeMap;

use quadlift::calibrate_rig::{CalibrateOptions, CalibratedCamera, CameraStatus, KnownBaseline, calibrate_rig};
use quadlift::geometry::{CamFromWorld, rotation_vector};
use quadlift::nalgebra::{Matrix3, Rotation3, Vector3, Vector6};
use quadlift::synthetic::{Hall, HallOptions, WalkPath, generate_hall};
use rayon::prelude::*;

use super::eight_point::relative_pose;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::table::{Cell, Table};

/// Halls of each row; of two cameras twice as many.
const HALLS: u64 = 20;
const FIRST_SEED: u64 = 1000;

/// Share of people who are missed, and false boxes for each box.
const MISSES: f64 = 0.2;
const FALSE_BOXES: f64 = 0.05;

/// What is right, degrees and meters; and standard deviations beyond which an answer that is not right is wrong.
const RIGHT_DEGREES: f64 = 1.0;
const RIGHT_METERS: f64 = 0.1;
const WRONG_SDS: f64 = 4.0;

/// Cameras, pedestrians, time steps, noise of edges, ids, path.
type Row = (usize, usize, usize, f64, bool, WalkPath);

const ROWS: [Row; 17] = [
    (2, 1, 30, 0.03, true, WalkPath::Anywhere),
    (2, 1, 100, 0.03, true, WalkPath::Anywhere),
    (2, 1, 300, 0.05, true, WalkPath::Anywhere),
    (2, 3, 100, 0.03, true, WalkPath::Anywhere),
    (2, 1, 100, 0.03, false, WalkPath::Anywhere),
    (4, 1, 30, 0.03, true, WalkPath::Anywhere),
    (4, 1, 100, 0.03, true, WalkPath::Anywhere),
    (4, 1, 300, 0.05, true, WalkPath::Anywhere),
    (4, 3, 100, 0.05, true, WalkPath::Anywhere),
    (4, 1, 100, 0.03, false, WalkPath::Anywhere),
    (4, 1, 100, 0.05, false, WalkPath::Anywhere),
    (4, 3, 100, 0.03, false, WalkPath::Anywhere),
    (8, 1, 100, 0.03, true, WalkPath::Anywhere),
    (8, 3, 100, 0.05, true, WalkPath::Anywhere),
    (4, 1, 100, 0.03, true, WalkPath::Line),
    (2, 1, 100, 0.03, true, WalkPath::Line),
    (4, 3, 100, 0.03, true, WalkPath::Spot),
];

/// The answers for the cameras of a row, the first camera of each hall left out: the others are compared with it.
#[derive(Default)]
struct Tally {
    cameras: usize,
    degrees: Vec<f64>,
    meters: Vec<f64>,
    right: usize,
    wrong: usize,
    refused: usize,
    nees: Vec<f64>,
}

/// Rotation, and center in the frame of a reference.
pub(crate) fn relative(pose: &CamFromWorld, reference: &CamFromWorld) -> (Matrix3<f64>, Vector3<f64>) {
    let parts = |pose: &CamFromWorld| {
        let matrix = *pose.matrix();
        (matrix.fixed_columns::<3>(0).into_owned(), matrix.column(3).into_owned())
    };
    let ((r, t), (r0, t0)) = (parts(pose), parts(reference));
    let rotation = r * r0.transpose();
    (rotation, -rotation.tr_mul(&(t - rotation * t0)))
}

impl Tally {
    /// Counts an answer: rotation and center relative to the reference, with standard deviations and covariance where there are any.
    fn add(
        &mut self,
        found: Option<(Matrix3<f64>, Vector3<f64>)>,
        truth: (Matrix3<f64>, Vector3<f64>),
        known: Option<&CalibratedCamera>,
    ) {
        self.cameras += 1;
        let Some((rotation, center)) = found else {
            self.refused += 1;
            return;
        };
        let turn = Rotation3::from_matrix_eps(&(rotation * truth.0.transpose()), 1e-12, 100, Rotation3::identity());
        let (turn, off) = (rotation_vector(&turn), rotation * (center - truth.1));
        let (degrees, meters) = (turn.norm().to_degrees(), off.norm());
        let is_right = degrees < RIGHT_DEGREES && meters < RIGHT_METERS;
        self.right += usize::from(is_right);
        let total = 3f64.sqrt();
        let sds = known.and_then(CalibratedCamera::sds);
        let beyond = sds.is_none_or(|[rotation_sd, position_sd]| {
            turn.norm() > WRONG_SDS * total * rotation_sd || meters > WRONG_SDS * total * position_sd
        });
        self.wrong += usize::from(!is_right && beyond);
        let error = Vector6::from_iterator(turn.iter().chain(off.iter()).copied());
        let whitened = known.and_then(|camera| Some(error.dot(&camera.covariance?.cholesky()?.solve(&error))));
        self.nees.extend(whitened);
        self.degrees.push(degrees);
        self.meters.push(meters);
    }

    fn cells(mut self) -> Vec<Cell> {
        let share = |n: usize| n as f64 / self.cameras.max(1) as f64;
        let shares = [share(self.right), share(self.wrong), share(self.refused)];
        let quantile = |values: &mut Vec<f64>, at: f64, decimals: usize| {
            values.sort_by(f64::total_cmp);
            let place = (at * values.len().saturating_sub(1) as f64).round() as usize;
            values.get(place).map_or(Cell::Empty, |&value| Cell::number(value, decimals))
        };
        let mut cells = vec![
            quantile(&mut self.degrees, 0.5, 2),
            quantile(&mut self.degrees, 0.95, 2),
            quantile(&mut self.meters, 0.5, 3),
            quantile(&mut self.meters, 0.95, 3),
        ];
        cells.extend(shares.map(|value| Cell::number(value, 2)));
        cells.push(quantile(&mut self.nees, 0.5, 1));
        cells
    }

    fn plus(mut self, other: Self) -> Self {
        self.cameras += other.cameras;
        self.right += other.right;
        self.wrong += other.wrong;
        self.refused += other.refused;
        self.degrees.extend(other.degrees);
        self.meters.extend(other.meters);
        self.nees.extend(other.nees);
        self
    }
}

/// Time step and id, and the rays of both cameras.
type OfBody = (usize, Option<usize>);
type BothSides = [Vec<Vector3<f64>>; 2];

/// Centers of boxes of two cameras that show the same person: by ids, or at time steps at which both have one box.
fn rays(hall: &Hall, cameras: [usize; 2]) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut of_time_step: BTreeMap<OfBody, BothSides> = BTreeMap::new();
    let k = &hall.intrinsics;
    for b in &hall.boxes {
        if let Some(side) = cameras.iter().position(|&camera| camera == b.camera) {
            let center = b.bounding_box.center();
            let ray = Vector3::new((center.x - k.cx) / k.fx, (center.y - k.cy) / k.fy, 1.0);
            of_time_step.entry((b.time_step, b.object)).or_default()[side].push(ray);
        }
    }
    let with_ids = hall.boxes.iter().any(|b| b.object.is_some());
    let pair = |((_, object), [first, second]): (OfBody, BothSides)| {
        let usable = object.is_some() == with_ids && first.len() == 1 && second.len() == 1;
        usable.then(|| (first[0], second[0]))
    };
    of_time_step.into_iter().filter_map(pair).collect()
}

/// A hall by both methods.
fn of_hall(&(cameras, pedestrians, time_steps, edge_noise, ids, path): &Row, seed: u64) -> Result<[Tally; 2], Error> {
    let hall = generate_hall(&HallOptions {
        seed,
        cameras,
        pedestrians,
        time_steps,
        edge_noise,
        misses: MISSES,
        false_boxes: FALSE_BOXES,
        ids,
        path,
        ..HallOptions::default()
    })?;
    let truth: Vec<_> = hall.cameras.iter().map(|pose| relative(pose, &hall.cameras[0])).collect();
    let baselines = vec![KnownBaseline { cameras: [0, 1], length: truth[1].1.norm() }];
    let found = calibrate_rig(&hall.rig(None), &CalibrateOptions { baselines, seed });
    let mut tallies = [Tally::default(), Tally::default()];
    let reference = found.cameras[0].cam_from_world.filter(|_| found.cameras[0].status == CameraStatus::Ok);
    for camera in 1..cameras {
        let of_camera = &found.cameras[camera];
        let answer = reference.zip(of_camera.cam_from_world).map(|(reference, pose)| relative(&pose, &reference));
        tallies[0].add(answer, truth[camera], Some(of_camera));
        let by_centers = relative_pose(&rays(&hall, [0, camera]), seed)
            .map(|(rotation, direction)| (rotation, -rotation.tr_mul(&direction) * truth[camera].1.norm()));
        tallies[1].add(by_centers, truth[camera], None);
    }
    Ok(tallies)
}

/// Adds the table.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", ROWS.len(), run.progress);
    let count = run.scenes(HALLS);
    report.text(format!(
        "Fixed cameras at the walls of halls of 8 x 6 m, 2.5 to 3 m high, calibrated by `quadlift calibrate-rig` from the boxes of people who \
         walk (bodies with shoulders, which no ellipsoid of revolution is), half a second apart: {MISSES} of the people have no box, and beside {FALSE_BOXES} of the boxes there is a \
         false one. One distance between two cameras is known. Errors are those of each camera relative to the first one, \
         over {count} halls ({} of two cameras). Right: within {RIGHT_DEGREES} degree and {RIGHT_METERS} m; wrong: not right, with a pose, and \
         beyond {WRONG_SDS} of its standard deviations; refused: without a pose. \"Eight points\" is the essential matrix of the centers of boxes, pair by pair with RANSAC; it gets the \
         true length of each translation, and has no standard deviations. NEES is the median (5.3 is honest).",
        2 * count,
    ));
    let titles = [
        "cameras",
        "people",
        "time steps",
        "noise",
        "ids",
        "path",
        "method",
        "rotation [deg]",
        "95 %",
        "position [m]",
        "95 %",
        "right",
        "wrong",
        "refused",
        "NEES",
    ];
    let mut table = Table::new("Fixed cameras from people who walk by", titles);
    let (mut least_right, mut most_wrong) = (1.0_f64, 0.0_f64);
    for row in &ROWS {
        let &(cameras, pedestrians, time_steps, noise, ids, path) = row;
        let halls = if cameras == 2 { 2 * count } else { count };
        let found = (0..halls)
            .into_par_iter()
            .map(|number| of_hall(row, run.seed.wrapping_add(FIRST_SEED + number)))
            .collect::<Result<Vec<_>, _>>()?;
        let sum = |all: [Tally; 2], other: [Tally; 2]| {
            let ([a, b], [c, d]) = (all, other);
            [a.plus(c), b.plus(d)]
        };
        let tallies = found.into_iter().fold([Tally::default(), Tally::default()], sum);
        let share = |n: usize| n as f64 / tallies[0].cameras.max(1) as f64;
        most_wrong = most_wrong.max(share(tallies[0].wrong));
        if path == WalkPath::Anywhere && cameras > 2 && time_steps >= 100 {
            least_right = least_right.min(share(tallies[0].right));
        }
        let path = match path {
            WalkPath::Anywhere => "anywhere",
            WalkPath::Line => "one line",
            WalkPath::Spot => "one place each",
        };
        for (method, tally) in ["calibrate-rig", "eight points"].into_iter().zip(tallies) {
            let ids = if ids { "yes" } else { "no" };
            let labels = [cameras.to_string(), pedestrians.to_string(), time_steps.to_string(), noise.to_string()];
            let labels = labels.into_iter().chain([ids, path, method].map(str::to_owned)).map(Cell::from);
            table.push(labels.chain(tally.cells()).collect());
        }
        steps.done();
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "calibrate-rig", value);
    report.headlines.push(headline(
        "calibrate_right",
        "share of fixed cameras that are right, of four and eight cameras with 100 time steps and more, the lowest",
        least_right,
    ));
    report.headlines.push(headline(
        "calibrate_wrong",
        "share of fixed cameras that are wrong with the status ok, the highest",
        most_wrong,
    ));
    Ok(())
}

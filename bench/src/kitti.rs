//! The KITTI sequences (PfD section 5.4, tables `tab:kitti` and `tab:distances`): parked cars seen from a moving car.

use std::path::Path;

use quadlift::geometry::BodyKind;
use quadlift::solve::{PoseNoise, PosteriorOptions};
use quadlift_io::builtin_priors;

use crate::data::TrueScene;
use crate::error::Error;
use crate::held_out;
use crate::methods::{MethodRow, RowScores, closed_forms, run_rows};
use crate::paper::{
    KITTI_O3D, KITTI_SEQUENCES, KITTI_THETA_ERR, KITTI_THETA_ERR_IN_TEXT, KITTI_WITHIN_1M, KITTI_WITHIN_2M,
};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, average};
use crate::sequences::Columns;
use crate::table::{Cell, Table};

/// The sequences that make up the average: the only ones with boxes of a detector and with GPS/IMU poses.
pub(crate) const AVERAGED: [&str; 4] = ["S05", "S09", "S22", "S36"];

/// Sequences beside them, with aligned poses only. S35 has two frames: see the minimal experiment.
const BESIDE: [&str; 2] = ["S23", "S35ext"];

/// Sources of boxes.
const SOURCES: [(&str, &str); 3] = [
    ("ellipsoid", "tight boxes of the true ellipsoids (the paper simulated its boxes)"),
    ("label", "labeled boxes"),
    ("rrc", "boxes of a real detector (RRC)"),
];

/// Kinds of poses.
const POSES: [(&str, &str); 2] = [("aligned", "poses registered on the labels"), ("oxts", "poses from GPS and IMU")];

const SHAPE: [Measure; 3] = [Measure::O3d, Measure::CuboidIou, Measure::ThetaErr];
const DISTANCE: [Measure; 2] = [Measure::CenterWithin(1.0), Measure::CenterWithin(2.0)];

/// Height of KITTI's cameras above the road, meters (from the description of the data set).
pub(crate) const CAMERA_HEIGHT: f64 = 1.65;

/// Errors of the poses of a car with GPS and IMU, for the row that estimates them.
const POSE_NOISE: PoseNoise = PoseNoise { rotation_sd: 0.003, translation_sd: 0.1 };

/// The row for cars that a detector has found.
const CAR_ROW: &str = "cuboid, car prior";

/// A kind of body, nothing known about cars.
fn plain(body: BodyKind) -> PosteriorOptions {
    PosteriorOptions { body: Some(body), ..Default::default() }
}

/// A kind of body, with what is known about cars.
pub(crate) fn cars(body: BodyKind) -> PosteriorOptions {
    PosteriorOptions { priors: builtin_priors(), camera_height: Some(CAMERA_HEIGHT), ..plain(body) }
}

/// The same without a ground plane under them.
fn without_ground(mut options: PosteriorOptions) -> PosteriorOptions {
    options.priors.by_category.values_mut().for_each(|prior| prior.on_ground = false);
    PosteriorOptions { camera_height: None, ..options }
}

/// The rows: all settings of this experiment.
fn rows() -> Vec<MethodRow> {
    let mut rows = closed_forms();
    rows.push(MethodRow::posterior("ellipsoid", plain(BodyKind::Ellipsoid)));
    rows.push(MethodRow::posterior("cuboid", plain(BodyKind::Cuboid)));
    rows.push(MethodRow::posterior("ellipsoid, car prior", cars(BodyKind::Ellipsoid)));
    rows.push(MethodRow::posterior(CAR_ROW, cars(BodyKind::Cuboid)));
    rows
}

/// [`CAR_ROW`] without one of its parts, and with one more.
fn ablations() -> Vec<MethodRow> {
    let car = || cars(BodyKind::Cuboid);
    vec![
        MethodRow::posterior(CAR_ROW, car()),
        MethodRow::posterior("border edges like others", PosteriorOptions { border_margin: 0.0, ..car() }),
        MethodRow::posterior("noise relative to the size only", PosteriorOptions { pixel_noise_size: 0.0, ..car() }),
        MethodRow::posterior("no heavy tails", PosteriorOptions { heavy_tails: false, ..car() }),
        MethodRow::posterior("views not correlated", PosteriorOptions { correlated_views: false, ..car() }),
        MethodRow::posterior("hidden edges like others", PosteriorOptions { occluded_edges: false, ..car() }),
        MethodRow::posterior("camera height not known", PosteriorOptions { camera_height: None, ..car() }),
        MethodRow::posterior("no ground plane", without_ground(car())),
        MethodRow::posterior("with pose noise", PosteriorOptions { pose_noise: Some(POSE_NOISE), ..car() }),
    ]
}

/// The settings among which [`held_out`] chooses: those that were chosen on this data, with other values.
fn grid() -> Vec<MethodRow> {
    let mut rows = Vec::new();
    let switches = [false, true].map(|on| [false, true].map(|other| (on, other))).concat();
    // 8 and 31 pixels.
    for border_margin in [0.0065, 0.025] {
        for pixel_noise_size in [0.0, 67.0, 100.0] {
            for &(correlated_views, ground) in &switches {
                let car =
                    PosteriorOptions { border_margin, pixel_noise_size, correlated_views, ..cars(BodyKind::Cuboid) };
                let setting = format!(
                    "border {border_margin}, pixel noise {pixel_noise_size}, {}, {}",
                    if correlated_views { "correlated" } else { "independent" },
                    if ground { "ground" } else { "no ground" }
                );
                rows.push(MethodRow::posterior(&setting, if ground { car } else { without_ground(car) }));
            }
        }
    }
    rows
}

/// The paper's protocol: no strong occlusion, nothing cut off.
pub(crate) fn protocol(source: &str, seed: u64) -> impl Fn(&mut quadlift::LocalizeOptions) + Sync {
    move |options| {
        options.source = Some(source.to_owned());
        options.max_occluded = Some(1.0);
        options.max_truncated = Some(0.0);
        options.seed = seed;
    }
}

/// The scenes with one kind of poses.
fn scenes(data: &Path, poses: &str) -> Result<Vec<TrueScene>, Error> {
    let beside: &[&str] = if poses == "aligned" { &BESIDE } else { &[] };
    let names = AVERAGED.iter().chain(beside);
    names.map(|name| TrueScene::read(data, &format!("kitti_{name}_{poses}"), name)).collect()
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Read`], [`Error::Localize`].
pub(crate) fn run(data: &Path, run: &Run) -> Result<Report, Error> {
    let (rows, ablations, grid) = (rows(), ablations(), grid());
    let grid = run.first(&grid, 2);
    let scenes_of = POSES.map(|(poses, _)| scenes(data, poses));
    let [aligned, oxts] = scenes_of;
    let scenes_of = [aligned?, oxts?];
    let scene_count: usize = scenes_of.iter().map(Vec::len).sum();
    let of_detector = ablations.len() + grid.len();
    let total = SOURCES.len() * rows.len() * scene_count + POSES.len() * of_detector * AVERAGED.len();
    let steps = Steps::new("kitti", total, run.progress);

    let mut report = Report::new("kitti", "KITTI: parked cars seen from a moving car (section 5.4)");
    report.text(format!(
        "Detections with `occluded <= 1` and `truncated = 0`, as in the paper. The average is over {}; S23 (8 of the \
         paper's 17 frames) and S35ext (5 frames, 2 of them the paper's) are listed separately, because they have \
         neither detector boxes nor GPS poses. The paper's averages are over its six sequences, with simulated boxes; \
         its theta_err is {KITTI_THETA_ERR_IN_TEXT} in the text and {} in the table. For a cuboid estimate, O3D is \
         that of the inscribed ellipsoid, as in the ground truth. A center counts even if the estimate is not an \
         ellipsoid. The car prior is the built-in one (size, upright axes, on the ground), with the camera height, \
         {CAMERA_HEIGHT} m.",
        AVERAGED.join(", "),
        KITTI_THETA_ERR.average,
    ));
    let titles = SOURCES.iter().flat_map(|(source, _)| POSES.map(|(poses, _)| format!("{source}, {poses}")));
    let titles = ["method", "setting", "measure"].into_iter().map(str::to_owned).chain(titles);
    let mut overview = Table::new(format!("KITTI: averages over {}", AVERAGED.join(", ")), titles);
    let mut details = Vec::new();
    let mut averages: Vec<Vec<RowScores>> = Vec::new();
    for (source, boxes) in SOURCES {
        for ((poses, poses_in_words), scenes) in POSES.iter().zip(&scenes_of) {
            // The detector's boxes are known for the averaged sequences only.
            let count = if source == "rrc" { AVERAGED.len() } else { scenes.len() };
            let scores = run_rows(&rows, &scenes[..count], &protocol(source, run.seed), &steps)?;
            (count..scenes.len()).for_each(|_| rows.iter().for_each(|_| steps.done()));
            let title = format!("KITTI, {boxes}, {poses_in_words} (source `{source}`, `_{poses}`)");
            details.extend(tables(&title, &scenes[..count], &scores));
            report.headlines.extend(headlines(source, poses, &scores));
            averages.push(scores);
        }
    }
    for (index, row) in rows.iter().enumerate() {
        for measure in [Measure::O3d, DISTANCE[0], DISTANCE[1]] {
            let cells =
                averages.iter().map(|scores| Cell::figure(over_averaged(&scores[index], measure), measure.decimals()));
            let label = [row.method.into(), row.setting.as_str().into(), measure.name().into()];
            overview.push(label.into_iter().chain(cells).collect());
        }
    }
    report.table(overview);
    details.into_iter().for_each(|table| report.table(table));
    let mut parts: Vec<Vec<RowScores>> = Vec::new();
    for scenes in &scenes_of {
        parts.push(run_rows(&ablations, &scenes[..AVERAGED.len()], &protocol("rrc", run.seed), &steps)?);
    }
    report.table(parts_table(&ablations, &parts));
    let mut table = held_out::table("KITTI, RRC boxes: settings chosen without the sequence that they are scored on");
    for ((poses, _), scenes) in POSES.iter().zip(&scenes_of) {
        let scores = run_rows(grid, &scenes[..AVERAGED.len()], &protocol("rrc", run.seed), &steps)?;
        held_out::push(&mut table, &format!("`_{poses}`"), &AVERAGED, &scores, Measure::O3d);
    }
    report.table(table);
    Ok(report)
}

/// The table of shapes and that of distances, as in the paper.
fn tables(title: &str, scenes: &[TrueScene], scores: &[RowScores]) -> [Table; 2] {
    let names: Vec<&str> = scenes.iter().map(|scene| scene.sequence.as_str()).collect();
    // The paper's S35 has a separate column, because our frames differ.
    let columns = Columns { averaged: &AVERAGED, pooled: Some("all cars"), beside: &["S23", "S35", "S35ext"] };
    let mut shapes = columns.table(format!("{title}: O3D and theta_err"));
    let mut distances = columns.table(format!("{title}: centers"));
    for row in &KITTI_O3D {
        columns.push_paper(&mut shapes, &KITTI_SEQUENCES, row, Measure::O3d);
    }
    columns.push_paper(&mut shapes, &KITTI_SEQUENCES, &KITTI_THETA_ERR, Measure::ThetaErr);
    for (rows, measure) in [(&KITTI_WITHIN_1M, DISTANCE[0]), (&KITTI_WITHIN_2M, DISTANCE[1])] {
        for row in rows {
            columns.push_paper(&mut distances, &KITTI_SEQUENCES, row, measure);
        }
    }
    for ours in scores {
        columns.push_ours(&mut shapes, &names, ours, &SHAPE);
        columns.push_ours(&mut distances, &names, ours, &DISTANCE);
    }
    let counts: Vec<Cell> = AVERAGED
        .iter()
        .map(|name| names.iter().position(|n| n == name).map_or(0, |index| scores[0].sequences[index].len()))
        .map(|count| Cell::number(count as f64, 0))
        .collect();
    for table in [&mut shapes, &mut distances] {
        table.push(["".into(), "".into(), "cars".into()].into_iter().chain(counts.iter().cloned()).collect());
    }
    [shapes, distances]
}

/// The effect of each part of the row for cars.
fn parts_table(rows: &[MethodRow], scores: &[Vec<RowScores>]) -> Table {
    let measures = [Measure::O3d, DISTANCE[0], DISTANCE[1]];
    let titles = POSES.iter().flat_map(|(poses, _)| measures.map(|measure| format!("{poses}: {}", measure.name())));
    let titles = ["method", "setting"].into_iter().map(str::to_owned).chain(titles);
    let mut table =
        Table::new("KITTI, RRC boxes: the row for cars without one of its parts, and with one more", titles);
    for (index, row) in rows.iter().enumerate() {
        let setting = if row.setting == CAR_ROW { CAR_ROW.to_owned() } else { format!("... {}", row.setting) };
        let cells = scores.iter().flat_map(|scores| {
            measures.map(|measure| Cell::figure(over_averaged(&scores[index], measure), measure.decimals()))
        });
        table.push([row.method.into(), setting.into()].into_iter().chain(cells).collect());
    }
    table
}

/// The average over the sequences that make it up, which are the first ones.
fn over_averaged(row: &RowScores, measure: Measure) -> Option<Figure> {
    average(&row.sequences[..AVERAGED.len()].iter().map(|s| measure.values(s)).collect::<Vec<_>>())
}

fn headlines(source: &str, poses: &str, scores: &[RowScores]) -> Vec<Headline> {
    let headline = |id, setting: &str, measure: Measure, paper| {
        let row = scores.iter().find(|s| s.row.method == "posterior" && s.row.setting == setting)?;
        let what = format!("{}, {source} boxes, {poses} poses", measure.name());
        Some(Headline {
            id,
            what,
            paper,
            ours: over_averaged(row, measure)?,
            row: row.row.name(),
            decimals: measure.decimals(),
        })
    };
    let reg = |value: f64| Some((value, KITTI_O3D[1].method));
    let all = match (source, poses) {
        ("ellipsoid", "aligned") => {
            vec![headline("kitti_ellipsoid_aligned", "ellipsoid", Measure::O3d, reg(KITTI_O3D[1].average))]
        }
        ("rrc", "aligned") => vec![
            headline("kitti_rrc_aligned", CAR_ROW, Measure::O3d, reg(KITTI_O3D[1].average)),
            headline("kitti_rrc_aligned_1m", CAR_ROW, DISTANCE[0], reg(KITTI_WITHIN_1M[1].average)),
            headline("kitti_rrc_aligned_2m", CAR_ROW, DISTANCE[1], reg(KITTI_WITHIN_2M[1].average)),
        ],
        ("rrc", "oxts") => vec![headline("kitti_rrc_oxts", CAR_ROW, Measure::O3d, None)],
        _ => Vec::new(),
    };
    all.into_iter().flatten().collect()
}

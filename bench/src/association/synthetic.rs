//! Synthetic scenes: crowds, noise, missed and false boxes, wrong poses, few views, and ids that may be wrong.

use quadlift::association::{AssociateOptions, IdPolicy};
use quadlift::metrics::ObjectDetectionScore;
use quadlift::synthetic::{Detector, Noise, Observations, SyntheticIds, SyntheticOptions, Trajectory, generate};
use rayon::prelude::*;

use super::case::{Case, CaseScore};
use super::{Aim, headline, mean_of};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::mean;
use crate::table::{Cell, Table};

/// Headline of the base.
const BASE: &str = "association_base";

/// Scenes of each condition.
const SEEDS: u64 = 3;

/// A condition: its difference from the base, and the figures of the prototype (on its own scenes).
pub(crate) struct Condition {
    name: &'static str,
    make: SyntheticOptions,
    prototype: Option<f64>,
    aim: Option<Aim>,
}

/// 50 objects of one category in a cube of 40, 20 views on the paper's path, edges 5 % off, 20 % missed, 15 % false.
fn base() -> SyntheticOptions {
    SyntheticOptions {
        cube_side: 40.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.2, false_boxes: 0.15, ..Default::default() },
        ids: SyntheticIds::Absent,
        ..Default::default()
    }
}

fn with_detector(change: impl Fn(&mut Detector)) -> SyntheticOptions {
    let mut options = base();
    change(&mut options.detector);
    options
}

/// A cube of 30, edges 10 % off, 30 % missed, 30 % false.
fn hard() -> SyntheticOptions {
    SyntheticOptions {
        cube_side: 30.0,
        noise: vec![Noise::BoxEdges(0.1)],
        detector: Detector { misses: 0.3, false_boxes: 0.3, ..Default::default() },
        ..base()
    }
}

impl Condition {
    /// Its name.
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// A scene of it.
    ///
    /// # Errors
    /// [`Error::Synthetic`].
    pub(crate) fn case(&self, seed: u64) -> Result<Case, Error> {
        case(&SyntheticOptions { seed, ..self.make.clone() })
    }
}

/// All conditions.
pub(crate) fn conditions() -> Vec<Condition> {
    let condition = |name, make, prototype: f64| Condition { name, make, prototype: Some(prototype), aim: None };
    let random = SyntheticOptions { cube_side: 60.0, views: 60, trajectory: Trajectory::Random, ..base() };
    let hidden = SyntheticOptions {
        cube_side: 40.0,
        detector: Detector { occlusion: true, ..base().detector },
        ..random.clone()
    };
    let street = SyntheticOptions { views: 250, objects: 100, trajectory: Trajectory::Street, ..base() };
    vec![
        Condition { aim: Some(Aim { id: BASE, least: 0.995 }), ..condition("base", base(), 1.0) },
        Condition {
            aim: Some(Aim { id: "association_cube20", least: 0.995 }),
            ..condition("cube of 20", SyntheticOptions { cube_side: 20.0, ..base() }, 1.0)
        },
        Condition {
            aim: Some(Aim { id: "association_random", least: 0.995 }),
            ..condition("60 random viewpoints, cube of 60", random, 1.0)
        },
        Condition {
            aim: Some(Aim { id: "association_hard", least: 0.985 }),
            ..condition("hard: cube of 30, noise 10 %, 30 % missed, 30 % false", hard(), 0.991)
        },
        condition("hard, 60 views", SyntheticOptions { views: 60, ..hard() }, 0.998),
        Condition {
            aim: Some(Aim { id: "association_pose", least: 0.99 }),
            ..condition("poses turned by 0.3 degrees", SyntheticOptions { pose_noise: 0.3, ..base() }, 1.0)
        },
        Condition {
            prototype: None,
            ..condition("once around", SyntheticOptions { trajectory: Trajectory::Orbit, ..base() }, 0.0)
        },
        condition("60 % missed", with_detector(|d| d.misses = 0.6), 0.994),
        condition("as many false boxes as true ones", with_detector(|d| d.false_boxes = 1.0), 1.0),
        condition("20 % duplicates", with_detector(|d| d.duplicates = 0.2), 0.993),
        condition("60 random viewpoints, cube of 40, objects hide each other", hidden, 0.991),
        condition("6 views", SyntheticOptions { views: 6, ..base() }, 0.987),
        condition("4 views", SyntheticOptions { views: 4, ..base() }, 0.932),
        Condition { prototype: None, ..condition("a street, 250 frames", street, 0.0) },
    ]
}

/// Conditions that are not solved at once, with a name for a column.
pub(crate) fn with_parts_to_do() -> [(&'static str, SyntheticOptions); 5] {
    [
        ("hard", hard()),
        ("20 % duplicates", with_detector(|d| d.duplicates = 0.2)),
        ("60 % missed", with_detector(|d| d.misses = 0.6)),
        ("poses turned", SyntheticOptions { pose_noise: 0.3, ..base() }),
        ("6 views", SyntheticOptions { views: 6, ..base() }),
    ]
}

/// The use of given ids.
struct IdRow {
    name: &'static str,
    ids: SyntheticIds,
    use_of_ids: IdPolicy,
    prototype: Option<f64>,
    aim: Option<Aim>,
}

fn id_rows() -> Vec<IdRow> {
    let row = |name, ids, use_of_ids| IdRow { name, ids, use_of_ids, prototype: None, aim: None };
    let broken = |use_of_ids| {
        let ids = SyntheticIds::Tracks { fragments: 0.1, switches: 0.1 };
        row("10 % fragments, 10 % switches", ids, use_of_ids)
    };
    let perfect = |use_of_ids| row("perfect", SyntheticIds::True, use_of_ids);
    vec![
        broken(IdPolicy::Ignore),
        IdRow { prototype: Some(0.165), ..broken(IdPolicy::Trust) },
        IdRow {
            prototype: Some(1.0),
            aim: Some(Aim { id: "association_ids", least: 0.995 }),
            ..broken(IdPolicy::Evidence)
        },
        perfect(IdPolicy::Evidence),
        IdRow { aim: Some(Aim { id: "association_trust", least: 1.0 }), ..perfect(IdPolicy::Trust) },
    ]
}

fn number(x: Option<f64>) -> Cell {
    x.map_or(Cell::Empty, |x| Cell::number(x, 3))
}

/// A synthetic scene as association gets it.
///
/// # Errors
/// [`Error::Synthetic`].
pub(crate) fn case(make: &SyntheticOptions) -> Result<Case, Error> {
    let synthetic = generate(make)?;
    Ok(Case {
        scene: synthetic.scene,
        true_objects: synthetic.true_objects.iter().map(|object| object.map(|index| index as u32)).collect(),
        bodies: synthetic.truth.iter().map(|(_, body)| body.closest_ellipsoid()).collect(),
    })
}

fn scores(make: &SyntheticOptions, ids: IdPolicy, run: &Run, steps: &Steps) -> Result<Vec<CaseScore>, Error> {
    let score = |k| {
        let case = case(&SyntheticOptions { seed: run.seed + k, ..make.clone() })?;
        let score = case.score(&AssociateOptions { ids, ..Default::default() });
        steps.done();
        score
    };
    (0..run.scenes(SEEDS)).into_par_iter().map(score).collect()
}

/// Number of steps.
pub(crate) fn steps(run: &Run) -> usize {
    run.scenes(SEEDS) as usize * (conditions().len() + id_rows().len())
}

/// Adds the tables of synthetic scenes and their headlines.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Associate`], [`Error::Localize`].
pub(crate) fn add(report: &mut Report, run: &Run, steps: &Steps) -> Result<(), Error> {
    let columns =
        ["condition", "F1, prototype", "aim", "F1", "lowest F1", "objects P", "objects R", "O3D", "O3D, true ids"];
    let mut table = Table::new(format!("Synthetic scenes without ids, {} of each", run.scenes(SEEDS)), columns);
    let conditions = conditions();
    let of = |condition: &Condition| scores(&condition.make, IdPolicy::Ignore, run, steps);
    let all: Vec<Vec<CaseScore>> = conditions.par_iter().map(of).collect::<Result<_, _>>()?;
    for (condition, scores) in conditions.iter().zip(&all) {
        let f1: Vec<f64> = scores.iter().map(|s| s.division.f1).collect();
        let lowest = f1.iter().copied().fold(1.0, f64::min);
        let found = |of: fn(&ObjectDetectionScore) -> Option<f64>| mean_of(scores, |s| of(&s.found));
        let o3d = mean_of(scores, |s| Some(s.o3d));
        let with_ids = mean_of(scores, |s| Some(s.o3d_with_true_ids));
        table.push(vec![
            condition.name.into(),
            number(condition.prototype),
            number(condition.aim.map(|aim| aim.least)),
            number(mean(&f1)),
            Cell::number(lowest, 3),
            number(found(ObjectDetectionScore::precision)),
            number(found(ObjectDetectionScore::recall)),
            number(o3d),
            number(with_ids),
        ]);
        if let Some(aim) = condition.aim {
            report.headlines.extend(headline(aim.id, format!("F1, {}", condition.name), mean(&f1), "associate"));
            if let (BASE, Some(o3d), Some(with_ids)) = (aim.id, o3d, with_ids) {
                let what = "O3D, base, less than with true ids".to_owned();
                report.headlines.extend(headline("association_base_o3d", what, Some(with_ids - o3d), "associate"));
            }
        }
    }
    table.note(
        "Base: 50 objects of one category in a cube of 40, 20 views on the path of the paper, noise of the edges 5 % \
         of the half size, 20 % of the boxes missed, 15 % false boxes in addition. The prototype's figures are from \
         its own scenes of the same kind. P: fraction of the found objects that are true, R: fraction of the true \
         objects that are found.",
    );
    report.table(table);
    add_ids(report, run, steps)
}

fn add_ids(report: &mut Report, run: &Run, steps: &Steps) -> Result<(), Error> {
    let columns = ["ids", "--ids", "F1, prototype", "aim", "F1", "O3D", "O3D, true ids"];
    let mut table = Table::new("Synthetic scenes whose detections name objects (base, 60 views)", columns);
    let rows = id_rows();
    let of = |row: &IdRow| scores(&SyntheticOptions { views: 60, ids: row.ids, ..base() }, row.use_of_ids, run, steps);
    let all: Vec<Vec<CaseScore>> = rows.par_iter().map(of).collect::<Result<_, _>>()?;
    for (row, scores) in rows.iter().zip(&all) {
        let f1 = mean_of(scores, |s| Some(s.division.f1));
        let option = match row.use_of_ids {
            IdPolicy::Trust => "trust",
            IdPolicy::Evidence => "evidence",
            IdPolicy::Ignore => "ignore",
        };
        table.push(vec![
            row.name.into(),
            option.into(),
            number(row.prototype),
            number(row.aim.map(|aim| aim.least)),
            number(f1),
            number(mean_of(scores, |s| Some(s.o3d))),
            number(mean_of(scores, |s| Some(s.o3d_with_true_ids))),
        ]);
        if let Some(aim) = row.aim {
            report.headlines.extend(headline(
                aim.id,
                format!("F1, {} ids", row.name),
                f1,
                &format!("associate, {option}"),
            ));
        }
    }
    table.note(
        "At each detection, with the given probability, a fragment starts a new track and a switch swaps the tracks \
         of two neighbors from then on.",
    );
    report.table(table);
    Ok(())
}

//! The consistency check on correct scenes and on scenes with one of the common mistakes (ours).

pub(crate) mod mistakes;
mod real;
pub(crate) mod scenes;

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use quadlift::associate;
use quadlift::association::AssociateOptions;
use quadlift::diagnosis::{Diagnosis, diagnose, diagnose_association};
use quadlift::geometry::Body;
use quadlift::scene::Scene;
use rayon::prelude::*;

use self::mistakes::{Harm, bodies, harm, mistakes_of};
use self::scenes::RandomScene;
use crate::data::data_folder;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::Figure;
use crate::table::{Cell, Table};

/// First seed of the scenes, so that none of them has set a threshold: those come from scenes 1 to 400.
const FIRST_SCENE: u64 = 100_000;

/// How many scenes are drawn.
struct Extent {
    /// Right scenes with ids.
    right: u64,
    /// Scenes with ids into which mistakes are made, six each.
    wrong: u64,
    /// Scenes without ids, as they are and with one mistake each.
    without_ids: u64,
    /// Every so many of the mistakes are made in real scenes.
    real_stride: usize,
}

impl Extent {
    /// What the results page shows.
    const WHOLE: Self = Self { right: 2000, wrong: 200, without_ids: 40, real_stride: 1 };
    /// The short form.
    const SHORT: Self = Self { right: 200, wrong: 15, without_ids: 3, real_stride: 15 };
}

/// The result of the consistency check for a corrupted scene.
#[derive(Debug, Clone, Copy)]
struct Verdict {
    called_wrong: bool,
    named: bool,
    harm: Harm,
    /// From 8 views and 5 objects on.
    large: bool,
    /// Whether the geometry of the trajectory hides the mistake.
    hidden: bool,
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Read`] for real scenes that cannot be read.
pub fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let extent = if run.short { Extent::SHORT } else { Extent::WHOLE };
    let total = (extent.right + extent.wrong + extent.without_ids) as usize;
    let steps = Steps::new("diagnosis", total, run.progress);
    let first = FIRST_SCENE + run.seed * 1_000_000;
    let mut report = Report::new("diagnosis", "Consistency check: right scenes, and scenes with one mistake (ours)");
    report.text(
        "Synthetic scenes are drawn at random: trajectory (paper, arcs of 20 and 60 degrees, orbit, random, street), \
         3 to 60 views, 1 to 50 objects (a street has its own number), box edges with a noise of 0 to 10 % of the \
         half size, 0 to 30 % wrong boxes. Each mistake has one magnitude. A mistake counts if it lowers the mean O3D \
         by more than 0.1 or moves the median center by more than half a mean semi-axis. No scene of these tables was \
         used to set a threshold of the consistency check.",
    );
    let right = right_scenes(first, extent.right, &steps);
    let with_ids = wrong_scenes(first, extent.wrong, &steps);
    let (right_without, without_ids) = scenes_without_ids(first, extent.without_ids, &steps);
    let real = data_folder(data).ok().map(|folder| real::run(&folder, extent.real_stride)).transpose()?;

    let mut table = Table::new(
        "Right scenes: how many are called wrong, or warned of",
        ["scenes", "number", "called wrong", "warned of"],
    );
    let mut push = |name: &str, verdicts: &[Diagnosis]| {
        let wrong = verdicts.iter().filter(|d| !d.consistent).count();
        let warned = verdicts.iter().filter(|d| d.consistent && !d.causes.is_empty()).count();
        let number = |n: usize| Cell::number(n as f64, 0);
        table.push(vec![name.into(), number(verdicts.len()), number(wrong), number(warned)]);
    };
    push("synthetic, with ids", &right);
    push("synthetic, without ids", &right_without);
    if let Some(real) = &real {
        real.right.iter().for_each(|(name, verdicts)| push(name, verdicts));
    }
    report.table(table);
    report.table(by_mistake("Mistakes in synthetic scenes with ids", &with_ids));
    report.table(by_mistake("Mistakes in synthetic scenes without ids", &without_ids));
    if let Some(real) = real {
        report.table(by_mistake("Mistakes in real scenes with ids", &real.wrong));
    }
    report.text(
        "Some mistakes cannot be detected in some scenes, because the wrong scene is as consistent as the correct \
         one: a wrong focal length if the cameras are far away relative to the extent of the objects (paper, arcs and \
         orbit: it only scales the world), a small frame offset on a straight drive at constant speed (it shifts the \
         world), a mirrored drive in a plane. These are counted separately as \"hidden by the geometry\". Millimeters \
         instead of meters cannot be detected from boxes and poses, only with a prior on sizes or the camera height.",
    );
    let share = |of: &[(String, Verdict)], good: fn(&Verdict) -> bool| -> Option<Figure> {
        let counted: Vec<f64> = (of.iter())
            .filter(|(_, v)| v.large && v.harm.matters() && !v.hidden)
            .map(|(_, v)| f64::from(u8::from(good(v))))
            .collect();
        crate::scores::mean(&counted).map(|value| Figure { value, standard_error: None })
    };
    let false_alarms = right.iter().filter(|d| !d.consistent).count() as f64 / right.len().max(1) as f64;
    let mut headline = |id, what: &str, ours: Option<Figure>, row: &str| {
        report.headlines.extend(ours.map(|ours| Headline {
            id,
            what: what.to_owned(),
            paper: None,
            ours,
            row: row.to_owned(),
            decimals: 3,
        }));
    };
    let figure = Some(Figure { value: false_alarms, standard_error: None });
    headline("diagnosis_false_alarms", "right scenes called wrong", figure, "synthetic, with ids");
    let seen = "8 views and 5 objects or more, not hidden";
    headline("diagnosis_called_wrong", "wrong scenes called wrong", share(&with_ids, |v| v.called_wrong), seen);
    headline("diagnosis_named", "wrong scenes named rightly", share(&with_ids, |v| v.named), seen);
    let seen = "without ids, 8 views and 5 objects or more, not hidden";
    headline(
        "diagnosis_called_wrong_no_ids",
        "wrong scenes called wrong",
        share(&without_ids, |v| v.called_wrong),
        seen,
    );
    headline("diagnosis_named_no_ids", "wrong scenes named rightly", share(&without_ids, |v| v.named), seen);
    Ok(report)
}

fn right_scenes(first: u64, count: u64, steps: &Steps) -> Vec<Diagnosis> {
    let verdict = |k: u64| {
        steps.done();
        RandomScene::draw(first + k).map(|drawn| diagnose(&drawn.synthetic.scene, |_| true))
    };
    (0..count).into_par_iter().filter_map(verdict).collect()
}

fn wrong_scenes(first: u64, count: u64, steps: &Steps) -> Vec<(String, Verdict)> {
    let verdicts = |k: u64| -> Vec<(String, Verdict)> {
        steps.done();
        let Some(drawn) = RandomScene::draw(first + k) else { return Vec::new() };
        let bodies_of_right = bodies(&drawn.synthetic.scene);
        let chosen = mistakes_of(first + k, 6);
        chosen
            .into_iter()
            .filter_map(|mistake| {
                let wrong = mistake.make(&drawn.synthetic.scene)?;
                let diagnosis = diagnose(&wrong, |_| true);
                Some((mistake.name(), drawn.verdict(&mistake, &bodies_of_right, &wrong, &diagnosis)))
            })
            .collect()
    };
    (0..count).into_par_iter().flat_map_iter(verdicts).collect()
}

fn scenes_without_ids(first: u64, count: u64, steps: &Steps) -> (Vec<Diagnosis>, Vec<(String, Verdict)>) {
    let options = AssociateOptions::default();
    let check = |scene: &Scene| -> Option<Diagnosis> {
        let scene = scenes::without_ids(scene)?;
        let association = associate(&scene, &options).ok()?;
        diagnose_association(&scene, &association, &options).ok()
    };
    let (mut right, mut wrong) = (Vec::new(), Vec::new());
    for k in 0..count {
        steps.done();
        let Some(drawn) = RandomScene::draw(first + k) else { continue };
        right.extend(check(&drawn.synthetic.scene));
        let bodies_of_right = bodies(&drawn.synthetic.scene);
        wrong.extend(mistakes_of(first + k, 1).into_iter().find_map(|mistake| {
            let wrong = mistake.make(&drawn.synthetic.scene)?;
            let diagnosis = check(&wrong)?;
            Some((mistake.name(), drawn.verdict(&mistake, &bodies_of_right, &wrong, &diagnosis)))
        }));
    }
    (right, wrong)
}

impl RandomScene {
    fn verdict(
        &self,
        mistake: &mistakes::NamedMistake,
        right: &HashMap<String, Body>,
        wrong: &Scene,
        diagnosis: &Diagnosis,
    ) -> Verdict {
        Verdict {
            called_wrong: !diagnosis.consistent,
            named: !diagnosis.consistent && diagnosis.causes.first().is_some_and(|c| c.name == mistake.cause()),
            harm: harm(&self.synthetic.truth, right, wrong),
            large: self.options.views >= 8 && self.options.objects >= 5,
            hidden: mistake.is_hidden_by(self.options.trajectory),
        }
    }
}

/// One row for each mistake, and one for all; only mistakes that matter count.
fn by_mistake(title: &str, verdicts: &[(String, Verdict)]) -> Table {
    let columns =
        ["mistake", "number", "called wrong", "named rightly", "number, small scenes", "called wrong, small scenes"];
    let mut table = Table::new(title, columns);
    let mut groups: BTreeMap<&str, Vec<Verdict>> = BTreeMap::new();
    for (name, verdict) in verdicts.iter().filter(|(_, v)| v.harm.matters()) {
        groups.entry(name).or_default().push(*verdict);
    }
    let all: Vec<Verdict> = groups.values().flatten().copied().collect();
    let (hidden, seen): (Vec<Verdict>, Vec<Verdict>) = all.iter().partition(|v| v.hidden);
    let mut push = |name: &str, group: &[Verdict]| {
        let (large, small): (Vec<&Verdict>, Vec<&Verdict>) = group.iter().partition(|v| v.large);
        let share = |of: &[&Verdict], good: fn(&Verdict) -> bool| match of.len() {
            0 => Cell::Empty,
            n => Cell::number(of.iter().filter(|v| good(v)).count() as f64 / n as f64, 2),
        };
        table.push(vec![
            name.into(),
            Cell::number(large.len() as f64, 0),
            share(&large, |v| v.called_wrong),
            share(&large, |v| v.named),
            Cell::number(small.len() as f64, 0),
            share(&small, |v| v.called_wrong),
        ]);
    };
    groups.iter().for_each(|(name, group)| push(name, group));
    push("hidden by the geometry", &hidden);
    push("all others", &seen);
    push("all", &all);
    table.note("Large scenes have 8 views and 5 objects or more; the others are small ones.");
    table
}

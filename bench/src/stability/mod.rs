//! Stability (ours): which answers change when a change of the input leaves the objects as they are.

mod cases;
mod change;
mod perturbation;

use std::path::Path;

use quadlift::metrics::{iou3d_bodies, iou3d_ellipsoids};
use quadlift::solve::{Estimate, Status};
use quadlift::{Localization, localize};
use quadlift_io::scene_file::ObjectBodies;
use rayon::prelude::*;

use crate::compare::scoring::is_inside;
use crate::compare::sets::Overlap;
use crate::data::data_folder;
use crate::error::Error;
use crate::processor_time::{Of, processor_time};
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::pooled;
use crate::table::{Cell, Table};
use cases::{Case, Group, cases};
use change::{Change, answers, changes};
use perturbation::Perturbation;

/// Scenes of each synthetic set.
const SCENES: u64 = 4;

/// A change by less than this share of the size cannot be seen.
const VISIBLE: f64 = 0.02;

/// The shares of the second table: changes by more than that.
const LIMITS: [f64; 3] = [VISIBLE, 1e-3, 1e-6];

/// What is found for one case.
struct Outcome {
    /// By perturbation.
    changes: Vec<Vec<Change>>,
    overlaps: Vec<f64>,
    coverage: Vec<f64>,
}

/// IoU of the true objects, and whether the regions of their estimates hold them.
fn score(case: &Case, found: &Localization) -> (Vec<f64>, Vec<f64>) {
    let (mut overlaps, mut coverage) = (Vec::new(), Vec::new());
    for object in &case.truth {
        let estimate = found.estimates.iter().find(|one| case.scene.object_ids[one.object_index] == object.id);
        overlaps.push(estimate.and_then(|estimate| overlap(case.overlap, estimate, object)).unwrap_or(0.0));
        let region = estimate.filter(|estimate| estimate.status == Status::Ok);
        let region = region.and_then(|estimate| Some((estimate.body?, estimate.covariance?)));
        let inside = region.and_then(|(body, covariance)| is_inside(case.overlap, &body, &covariance, object));
        coverage.extend(inside.map(|inside| f64::from(u8::from(inside))));
    }
    (overlaps, coverage)
}

fn overlap(overlap: Overlap, estimate: &Estimate, truth: &ObjectBodies) -> Option<f64> {
    let ellipsoid = match overlap {
        Overlap::Bodies => return Some(iou3d_bodies(&estimate.body?, &truth.body()?)),
        Overlap::Ellipsoids => estimate.closest_ellipsoid()?,
        Overlap::Enclosing => estimate.enclosing?,
    };
    Some(iou3d_ellipsoids(&ellipsoid, &truth.ellipsoid().or(truth.body().map(|body| body.closest_ellipsoid()))?))
}

fn outcome(case: &Case) -> Result<Outcome, Error> {
    let found = localize(&case.scene, &case.options)?;
    let before = answers(&case.scene, &found);
    let changes = Perturbation::ALL.map(|perturbation| -> Result<Vec<Change>, Error> {
        let (scene, options, world) = perturbation.of(&case.scene, &case.options)?;
        Ok(changes(&before, &answers(&scene, &localize(&scene, &options)?), &world))
    });
    let (overlaps, coverage) = score(case, &found);
    Ok(Outcome { changes: changes.into_iter().collect::<Result<_, _>>()?, overlaps, coverage })
}

/// Share of changes, in per cent.
fn share(changes: &[Change], counts: impl Fn(&Change) -> bool) -> f64 {
    100.0 * changes.iter().filter(|change| counts(change)).count() as f64 / changes.len().max(1) as f64
}

/// The share of visible changes, and in brackets that of other kinds.
fn cell(changes: &[Change]) -> Cell {
    let visible = share(changes, |change| change.distance > VISIBLE);
    format!("{visible:.1} ({:.1})", share(changes, |change| change.of_kind)).as_str().into()
}

/// The changes of some cases under one perturbation.
fn together<'a>(found: impl Iterator<Item = &'a Outcome>, perturbation: usize) -> Vec<Change> {
    found.flat_map(|outcome| outcome.changes[perturbation].iter().copied()).collect()
}

/// Runs the experiment; without data on synthetic scenes alone.
///
/// # Errors
/// [`Error`] of a scene that cannot be read, made or localized.
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let folder = data_folder(data).ok();
    let cases = cases(folder.as_deref(), run.scenes(SCENES), run)?;
    let steps = Steps::new("stability", cases.len(), run.progress);
    let start = processor_time(Of::Itself);
    let solved = |case: &Case| {
        let outcome = outcome(case);
        steps.done();
        outcome
    };
    let outcomes: Vec<Outcome> = cases.par_iter().map(solved).collect::<Result<_, _>>()?;
    let time = processor_time(Of::Itself).zip(start).map(|(end, start)| end.saturating_sub(start).as_secs_f64());

    let mut report = Report::new("stability", "Changes that should not change the answer");
    report.text(
        "Share of estimates, in per cent, that change by more than 2 % of their size when the world is turned and moved, lengths \
         are multiplied by 3.7, frames, detections and objects are ordered otherwise, poses are multiplied by 1 + 1e-15, \
         the seed is another one, or the edges of boxes are moved at random; in brackets those that change their kind of body. Bodies \
         are compared by their tangent planes in 64 directions. Scenes without object ids are left out.",
    );
    let names: Vec<String> = Perturbation::ALL.iter().map(|perturbation| perturbation.name()).collect();
    let titles = || names.iter().map(String::as_str);
    let columns = ["set", "estimates"].into_iter().chain(titles()).chain(["body IoU", "coverage"]);
    let mut table = Table::new("Changed estimates, %", columns);
    let mut push = |name: &str, found: &[&Outcome]| {
        let of = |perturbation| together(found.iter().copied(), perturbation);
        let all = |values: fn(&Outcome) -> &[f64]| -> Vec<f64> {
            found.iter().flat_map(|outcome| values(outcome).iter().copied()).collect()
        };
        let count = of(0).len();
        let cells = (0..Perturbation::ALL.len()).map(|perturbation| cell(&of(perturbation)));
        let figures = [all(|outcome| &outcome.overlaps), all(|outcome| &outcome.coverage)]
            .map(|values| Cell::figure(pooled(&[values]), 3));
        table.push([name.into(), Cell::number(count as f64, 0)].into_iter().chain(cells).chain(figures).collect());
    };
    for group in Group::ALL {
        let of_group = cases.iter().zip(&outcomes).filter(|(case, _)| case.group == group);
        let found: Vec<&Outcome> = of_group.map(|(_, outcome)| outcome).collect();
        if !found.is_empty() {
            push(group.name(), &found);
        }
    }
    let everything: Vec<&Outcome> = outcomes.iter().collect();
    push("all", &everything);
    report.table(table);
    report.table(by_size(&outcomes, titles()));
    report.headlines.extend(Perturbation::ALL.into_iter().enumerate().map(|(k, perturbation)| {
        let changes = together(outcomes.iter(), k);
        let visible = share(&changes, |change| change.distance > VISIBLE);
        Headline::ours(perturbation.id(), &format!("estimates changed by {}, %", perturbation.name()), "auto", visible)
    }));
    if let Some(time) = time {
        report.text(format!("Processor time: {time:.1} s."));
    }
    Ok(report)
}

/// Shares of estimates that change by more than each of the limits.
fn by_size<'a>(outcomes: &[Outcome], titles: impl Iterator<Item = &'a str>) -> Table {
    let mut table =
        Table::new("Estimates that change by more than a share of their size, %", ["by"].into_iter().chain(titles));
    let all: Vec<Vec<Change>> = (0..Perturbation::ALL.len()).map(|k| together(outcomes.iter(), k)).collect();
    for limit in LIMITS {
        let cells = all.iter().map(|changes| Cell::number(share(changes, |change| change.distance > limit), 1));
        table.push([Cell::from(format!("{limit:.0e}").as_str())].into_iter().chain(cells).collect());
    }
    let kinds = all.iter().map(|changes| Cell::number(share(changes, |change| change.of_kind), 1));
    table.push([Cell::from("its kind")].into_iter().chain(kinds).collect());
    table
}

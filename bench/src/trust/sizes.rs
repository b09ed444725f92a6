//! Sizes and directions against their standard deviations, by kind of body and number of views.

use quadlift::geometry::{Body, BodyKind};
use quadlift::nalgebra::{Unit, Vector3};
use quadlift::solve::Estimate;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::VIEWS;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::table::{Cell, Table};

/// Standard deviations on both sides of a number that contain 95 %.
const SD_95: f64 = 1.96;

/// Quantile of 95 % of chi-square with 2 degrees of freedom: a direction errs about two axes.
const CHI2_2_95: f64 = 5.991;

/// Objects of a synthetic scene.
const OBJECTS: usize = 20;

/// Kinds of the synthetic bodies.
const KINDS: [(&str, BodyKind); 3] =
    [("ellipsoids", BodyKind::Ellipsoid), ("cuboids", BodyKind::Cuboid), ("cylinders", BodyKind::Cylinder)];

/// Size and direction of an estimate against the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sizes {
    /// Whether the kind is the true one.
    is_right_kind: bool,
    /// How many of the three true half extents lie within [`SD_95`] standard deviations.
    half_extents: usize,
    /// Whether the true axis lies in the cone of 95 % around the estimated one: the axis of a cylinder, the longest of others.
    direction: bool,
}

impl Sizes {
    /// Compares an estimate with the truth, whose axes are named so that they are closest; `None` without a covariance.
    pub(super) fn of(estimate: &Estimate, truth: &Body, up: Option<&Unit<Vector3<f64>>>) -> Option<Self> {
        let (body, sd) = (estimate.body.as_ref()?, estimate.half_extents_sd()?);
        let [about_up, away] = estimate.rotation_sd(up)?;
        let cosines = (body.rotation.inverse() * truth.rotation).matrix().abs();
        let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]];
        let sum = |order: &[usize; 3]| (0..3).map(|k| cosines[(k, order[k])]).sum::<f64>();
        let order = orders.into_iter().max_by(|a, b| sum(a).total_cmp(&sum(b)))?;
        let is_inside = |k: &usize| (body.half_extents[*k] - truth.half_extents[order[*k]]).abs() <= SD_95 * sd[*k];
        let axis = if body.kind == BodyKind::Cylinder { 2 } else { body.half_extents.imax() };
        let angle = cosines[(axis, order[axis])].min(1.0).acos();
        Some(Self {
            is_right_kind: body.kind == truth.kind,
            half_extents: (0..3).filter(is_inside).count(),
            direction: angle <= CHI2_2_95.sqrt() * about_up.max(away),
        })
    }
}

/// An empty table of [`push`].
pub(super) fn table() -> Table {
    let shares = ["half extents", "direction", "half extents, right kind", "direction, right kind"];
    let titles = ["set", "views", "objects", "right kind"].into_iter().chain(shares).map(str::to_owned);
    let mut table = Table::new("Sizes and directions: share of the truths inside 95 %, per cent", titles);
    table.note(
        "Half extents: inside 1.96 standard deviations. Direction: the axis of a cylinder, the longest of other bodies, \
         inside the cone of 2.45 standard deviations of the rotation (the larger of both, about the vertical and away from \
         it). Synthetic: edge noise of 0.03 half sizes, 20 objects a scene, kinds selected for each object. \"Right kind\": \
         the objects whose kind is the true one, alone. Real objects but cars have the truth of an ellipsoid.",
    );
    table
}

/// Adds a row.
pub(super) fn push(table: &mut Table, set: &str, views: Option<usize>, found: &[Sizes]) {
    let right: Vec<Sizes> = found.iter().copied().filter(|one| one.is_right_kind).collect();
    let share = |part: usize, all: usize| {
        if all == 0 { Cell::Empty } else { Cell::number(100.0 * part as f64 / all as f64, 1) }
    };
    let inside = |found: &[Sizes]| {
        let half_extents = found.iter().map(|one| one.half_extents).sum();
        let directions = found.iter().filter(|one| one.direction).count();
        [share(half_extents, 3 * found.len()), share(directions, found.len())]
    };
    let views = views.map_or(Cell::Empty, |views| Cell::number(views as f64, 0));
    let head = [set.into(), views, Cell::number(found.len() as f64, 0), share(right.len(), found.len())];
    table.push(head.into_iter().chain(inside(found)).chain(inside(&right)).collect());
}

/// Number of steps.
pub(super) fn steps(run: &Run) -> usize {
    KINDS.len() * run.first(&VIEWS, super::SHORT_VIEWS).len()
}

/// Adds the synthetic rows, each of this many scenes.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Localize`].
pub(super) fn add_synthetic(table: &mut Table, scenes: u64, run: &Run, steps: &Steps) -> Result<(), Error> {
    for (name, body) in KINDS {
        for &views in run.first(&VIEWS, super::SHORT_VIEWS) {
            let of_scene = |scene: u64| -> Result<Vec<Sizes>, Error> {
                let synthetic = generate(&SyntheticOptions {
                    seed: run.seed.wrapping_mul(1000).wrapping_add(scene),
                    objects: OBJECTS,
                    views,
                    body,
                    observations: Observations::Boxes,
                    noise: vec![Noise::BoxEdges(0.03)],
                    ..Default::default()
                })?;
                let options = LocalizeOptions { seed: run.seed, ..Default::default() };
                let found = localize(&synthetic.scene, &options)?;
                let pairs = found.estimates.iter().zip(&synthetic.truth);
                let up = synthetic.scene.up;
                Ok(pairs.filter_map(|(estimate, (_, truth))| Sizes::of(estimate, truth, up.as_ref())).collect())
            };
            let found: Vec<_> = (0..scenes).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
            steps.done();
            push(table, name, Some(views), &found.concat());
        }
    }
    Ok(())
}

//! How the one weight lambda of `reg` was chosen. The paper keeps it equal for all tests but does not print it.
//!
//! The rule: the decade that gives the highest mean O3D over all points of the paper's three curves, on scenes that
//! are not among those whose figures are reported.

use quadlift::Options;
use quadlift::solve::{Method, RegOptions};
use rayon::prelude::*;

use crate::error::Error;
use crate::methods::REG_LAMBDA;
use crate::paper;
use crate::progress::Steps;
use crate::scores::{Measure, mean};
use crate::synthetic::PAPER_CURVES;
use crate::table::{Cell, Table};

/// The decades, as exponents of ten.
const DECADES: std::ops::RangeInclusive<i32> = 8..=24;

/// Scenes of the scan.
const SCENES: u64 = 2;

/// Added to the seed, so that the scenes are not those of the report.
const OTHER_SEEDS: u64 = 1_000_000;

/// Steps that the scan reports.
pub(crate) const STEPS: usize = SCENES as usize;

/// What the scan finds for one lambda.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanPoint {
    /// The weight.
    pub lambda: f64,
    /// Mean O3D over all points of the three curves.
    pub mean: f64,
    /// O3D without noise, and at the end of each curve: rotation, size, translation.
    pub ends: [f64; 4],
}

/// The mean O3D for every decade.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Localize`].
pub fn scan_points(seed: u64) -> Result<Vec<ScanPoint>, Error> {
    measure(seed, &|| {})
}

fn measure(seed: u64, scene_done: &(dyn Fn() + Sync)) -> Result<Vec<ScanPoint>, Error> {
    let lambdas: Vec<f64> = DECADES.map(|decade| 10f64.powi(decade)).collect();
    // For each scene and lambda: the O3D of each point of each curve.
    let of_scene = |index: u64| -> Result<Vec<Vec<Vec<f64>>>, Error> {
        let seed = seed.wrapping_add(OTHER_SEEDS).wrapping_add(index);
        let mut values = vec![vec![Vec::new(); PAPER_CURVES.len()]; lambdas.len()];
        for (curve_index, curve) in PAPER_CURVES.iter().enumerate() {
            for amount in curve.amounts() {
                let scene = curve.scene(amount, seed)?;
                for (lambda, values) in lambdas.iter().zip(&mut values) {
                    let reg = RegOptions { lambda: *lambda };
                    let options = Options { method: Method::Reg, reg, ..Default::default() };
                    let o3d = Measure::O3d.values(&scene.scores(&options)?);
                    values[curve_index].push(mean(&o3d).unwrap_or_default());
                }
            }
        }
        scene_done();
        Ok(values)
    };
    let scenes: Vec<Vec<Vec<Vec<f64>>>> = (0..SCENES).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
    let point = |(index, &lambda): (usize, &f64)| {
        let of_lambda = || scenes.iter().map(|scene| &scene[index]);
        let over_scenes = |value: &dyn Fn(&Vec<Vec<f64>>) -> f64| of_lambda().map(value).sum::<f64>() / scenes.len() as f64;
        let last = |curve: usize| over_scenes(&|curves| curves[curve].last().copied().unwrap_or_default());
        let ends = [over_scenes(&|curves| curves[0][0]), last(0), last(1), last(2)];
        ScanPoint { lambda, mean: over_scenes(&|curves| mean(&curves.concat()).unwrap_or_default()), ends }
    };
    Ok(lambdas.iter().enumerate().map(point).collect())
}

/// The scan as a table.
pub(crate) fn scan(seed: u64, steps: &Steps) -> Result<Table, Error> {
    let points = measure(seed, &|| steps.done())?;
    let mut table = Table::new(
        "The weight of reg: O3D for every decade",
        ["lambda", "used", "mean over the curves", "no noise", "RE 45 degrees", "SE 0.3", "TE 0.3"],
    );
    let reg = paper::SYNTHETIC[1];
    let published = [reg.without_noise, reg.rotation, reg.size, reg.translation].map(|x| Cell::number(x, 2));
    table.push([reg.method.into(), "paper".into(), Cell::Empty].into_iter().chain(published).collect());
    let best = points.iter().map(|point| point.mean).fold(0.0, f64::max);
    for point in &points {
        let used = if point.lambda == REG_LAMBDA { "used" } else { "" };
        let mark = if point.mean == best && used.is_empty() { "best here" } else { used };
        let mut row = vec![format!("{:e}", point.lambda).into(), mark.into(), Cell::number(point.mean, 3)];
        row.extend(point.ends.map(|x| Cell::number(x, 2)));
        table.push(row);
    }
    table.note(format!(
        "The rule: the decade with the highest mean O3D over all points of the paper's three curves, on {SCENES} scenes \
         with other seeds than those reported above."
    ));
    Ok(table)
}

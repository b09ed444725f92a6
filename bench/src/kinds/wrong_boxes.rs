//! Wrong boxes among those of objects of one kind (ours): the default against the true kind given.

use quadlift::geometry::BodyKind;
use quadlift::solve::PosteriorOptions;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, generate};
use rayon::prelude::*;

use super::{Row, ious};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::scores::{Figure, average};
use crate::table::{Cell, Table};

/// Scenes of each cell, and objects in each.
const SCENES: u64 = 3;
const OBJECTS: usize = 12;

/// Shares of the detections that are wrong boxes.
const SHARES: [f64; 4] = [0.0, 0.05, 0.1, 0.3];

/// Noise of an edge, in mean half sizes: exact, and that of a detector.
const NOISES: [f64; 2] = [0.0, 0.05];

const VIEWS: [usize; 3] = [4, 8, 20];

/// What all objects of a scene truly are.
const TRUTHS: [(&str, BodyKind); 4] = [
    ("ellipsoids", BodyKind::Ellipsoid),
    ("superellipsoids", BodyKind::Superellipsoid(1.5)),
    ("cuboids", BodyKind::Cuboid),
    ("cylinders", BodyKind::Cylinder),
];

/// Steps that are reported.
pub(super) const STEPS: usize = NOISES.len() * VIEWS.len() * TRUTHS.len();

/// A table for each noise: IoU with the true kind given, and what the default has less or more.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Localize`].
pub(super) fn tables(run: &Run, steps: &Steps) -> Result<Vec<Table>, Error> {
    NOISES
        .iter()
        .map(|&noise| {
            let title = format!("Wrong boxes, noise of edges {:.0} %", 100.0 * noise);
            let shares = SHARES.map(|share| [format!("{:.0} % wrong", 100.0 * share), "auto".to_owned()]);
            let columns = ["truth", "views"].map(str::to_owned).into_iter().chain(shares.into_iter().flatten());
            let mut table = Table::new(title, columns);
            for views in VIEWS {
                for (name, kind) in TRUTHS {
                    let mut cells: Vec<Cell> = vec![name.into(), views.to_string().into()];
                    for share in SHARES {
                        let (given, difference) = cell(run, noise, views, kind, share)?;
                        cells.extend([Cell::figure(given, 3), Cell::figure(difference, 3)]);
                    }
                    table.push(cells);
                    steps.done();
                }
            }
            table
                .note("Body IoU with the true kind given, 0 without an estimate; auto: the default less that, paired.");
            Ok(table)
        })
        .collect()
}

/// IoU with the true kind given, and the paired difference of the default.
fn cell(
    run: &Run,
    noise: f64,
    views: usize,
    kind: BodyKind,
    share: f64,
) -> Result<(Option<Figure>, Option<Figure>), Error> {
    let default = Row::Posterior(Box::default());
    let given = Row::Posterior(Box::new(PosteriorOptions { body: Some(kind), ..Default::default() }));
    let pairs = (0..SCENES)
        .into_par_iter()
        .map(|k| {
            let seed = run.seed.wrapping_add(k);
            let scene = scene(seed, noise, views, kind, share)?;
            Ok((ious(&scene, &given, seed)?, ious(&scene, &default, seed)?))
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let given: Vec<f64> = pairs.iter().flat_map(|(given, _)| given).copied().collect();
    let difference = pairs.iter().flat_map(|(given, default)| default.iter().zip(given).map(|(a, b)| a - b));
    let difference = average(&[difference.collect()]);
    Ok((average(&[given]), difference))
}

fn scene(seed: u64, noise: f64, views: usize, kind: BodyKind, share: f64) -> Result<SyntheticScene, Error> {
    let options = SyntheticOptions {
        seed,
        objects: OBJECTS,
        kinds: vec![kind],
        views,
        observations: Observations::Boxes,
        noise: if noise > 0.0 { vec![Noise::BoxEdges(noise)] } else { Vec::new() },
        outlier_share: share,
        ..Default::default()
    };
    Ok(generate(&options)?)
}

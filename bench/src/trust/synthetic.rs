//! Synthetic cells: kinds of measurements, angles between the views, numbers of views.

use quadlift::geometry::BodyKind;
use quadlift::solve::PosteriorOptions;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::regions::{Coverage, Judged, LEVELS, Part};
use super::{SHORT_VIEWS, VIEWS};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::table::{Cell, Table};

/// Angles between the first and the last view, degrees.
const SPANS: [f64; 3] = [5.0, 30.0, 90.0];

/// Views from which the noise levels are those of the residuals.
const ENOUGH_VIEWS: usize = 10;

/// Objects of a scene.
const OBJECTS: usize = 100;

/// What is measured.
#[derive(Debug, Clone, Copy)]
struct Kind {
    name: &'static str,
    body: BodyKind,
    observations: Observations,
    noise: &'static [Noise],
}

const KINDS: [Kind; 3] = [
    Kind {
        name: "boxes of ellipsoids",
        body: BodyKind::Ellipsoid,
        observations: Observations::Boxes,
        noise: &[Noise::BoxEdges(0.05)],
    },
    Kind {
        name: "ellipses of ellipsoids",
        body: BodyKind::Ellipsoid,
        observations: Observations::Ellipses,
        noise: &[Noise::Translation(0.1), Noise::SizePerAxis(0.1), Noise::Rotation(10.0)],
    },
    Kind {
        name: "boxes of cuboids",
        body: BodyKind::Cuboid,
        observations: Observations::Boxes,
        noise: &[Noise::BoxEdges(0.05)],
    },
];

/// Number of steps.
pub(super) fn steps(run: &Run) -> usize {
    KINDS.len() * run.first(&SPANS, 1).len() * run.first(&VIEWS, SHORT_VIEWS).len()
}

/// The objects of a cell against the truth.
fn cell(kind: &Kind, span: f64, views: usize, scenes: u64, seed: u64) -> Result<Vec<Judged>, Error> {
    let map = PosteriorOptions { body: Some(kind.body), ..Default::default() };
    let of_scene = |scene: u64| -> Result<Vec<Judged>, Error> {
        let synthetic = generate(&SyntheticOptions {
            seed: seed.wrapping_mul(1000).wrapping_add(scene),
            objects: OBJECTS,
            views,
            body: kind.body,
            trajectory: Trajectory::Arc { span },
            observations: kind.observations,
            noise: kind.noise.to_vec(),
            ..Default::default()
        })?;
        let options = LocalizeOptions { seed, ..LocalizeOptions::from(map.clone()) };
        let localization = localize(&synthetic.scene, &options)?;
        let pairs = localization.estimates.iter().zip(&synthetic.truth);
        Ok(pairs.filter_map(|(estimate, (_, truth))| Judged::new(estimate, truth, None)).collect())
    };
    let scenes: Vec<_> = (0..scenes).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
    Ok(scenes.concat())
}

/// Adds the tables of the synthetic cells, each of this many scenes of 100 objects.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Localize`].
pub(super) fn add(report: &mut Report, scenes: u64, run: &Run, steps: &Steps) -> Result<(), Error> {
    let objects = (scenes * OBJECTS as u64) as f64;
    report.text(format!(
        "Synthetic: cameras on an arc at distance 200, {objects} objects a cell ({scenes} scenes). Boxes with edge \
         noise of 0.05 half sizes; ellipses with translation 0.1, size 0.1 for each axis and rotation 10 degrees; \
         cuboids are fitted as cuboids. The standard error of a share is {:.1} at 50 % and {:.1} at 90 %. With few \
         views the noise levels are pulled slightly towards typical detector levels. Cuboids with arbitrary \
         orientation in a narrow arc fit their boxes in several ways, which a single covariance cannot represent: \
         their regions of extents and body are too small.",
        50.0 / objects.sqrt(),
        30.0 / objects.sqrt()
    ));
    let mut centers = Vec::new();
    for kind in &KINDS {
        let titles = Part::ALL.iter().flat_map(|part| {
            let shares = LEVELS.map(|level| format!("{}: {level} %", part.name()));
            shares.into_iter().chain([format!("{}: median", part.name())])
        });
        let mut table = Table::new(
            format!("Synthetic, {}: share of the truths inside, by angle and views", kind.name),
            ["degrees", "views"].into_iter().map(str::to_owned).chain(titles),
        );
        for &span in run.first(&SPANS, 1) {
            for &views in run.first(&VIEWS, SHORT_VIEWS) {
                let judged = cell(kind, span, views, scenes, run.seed)?;
                steps.done();
                if views >= ENOUGH_VIEWS && kind.body == BodyKind::Ellipsoid {
                    centers.push(Coverage::of(&judged, Part::Center).inside);
                }
                let mut row = vec![Cell::number(span, 0), Cell::number(views as f64, 0)];
                for part in Part::ALL {
                    let coverage = Coverage::of(&judged, part);
                    row.extend(coverage.inside.map(|x| Cell::number(x, 1)));
                    row.push(Cell::number(coverage.median, 2));
                }
                table.push(row);
            }
        }
        report.table(table);
    }
    for (id, index, level) in [("trust_synthetic_50", 0, 50.0), ("trust_synthetic_90", 1, 90.0)] {
        let off = centers.iter().map(|inside| (inside[index] - level).abs()).fold(0.0, f64::max);
        let what = format!("centers inside {level} %: largest difference over cells with 10 views and more, points");
        report.headlines.extend(super::headline(id, what, Some(off), "posterior, ellipsoids"));
    }
    Ok(())
}

//! One view of each object, whose sources of cues have other biases in each scene.

use quadlift::scene::{Detection, Scene};
use quadlift::synthetic::{Box3dNoise, DepthNoise, SyntheticScene, simulate_cues};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::outlines::normal;
use super::synthetic::{CUES, FIRST_SEED, Score, cue_options, noisy_boxes, scores_of};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::{median_figure, pooled};
use crate::table::{Cell, Table};

/// Scenes of each row: their biases differ.
const SCENES: u64 = 24;

/// Standard deviations of the logarithms of the scales of depths and distances, and of the bias of sizes: what the estimator expects.
const SCALE_SD: f64 = 0.1;
const SIZE_SD: f64 = 0.2;

/// Biases of the sources of a scene: measured over true lengths.
#[derive(Debug, Clone, Copy)]
struct Biases {
    depth: f64,
    distance: f64,
    size: f64,
}

/// The rows: how far the biases are drawn, in standard deviations.
const ROWS: [(f64, &str); 2] = [(0.0, "none"), (1.0, "as expected")];

fn scene_of(made: &SyntheticScene, column: usize, biases: Biases, seed: u64) -> Result<Scene, Error> {
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    let depth = DepthNoise { outliers: 0.05, scale: biases.depth, ..Default::default() };
    let box3d = Box3dNoise { size_bias: biases.size, ..Default::default() };
    let mut parts = simulate_cues(&made.scene, body_of, &cue_options(column, depth, box3d), seed)?.into_parts();
    for cues in parts.detections.iter_mut().filter_map(|detection| detection.cues.as_mut()) {
        if let Some(center) = cues.box3d.as_mut().and_then(|measured| measured.center.as_mut()) {
            *center *= biases.distance;
        }
    }
    Ok(Scene::from_parts(parts)?)
}

/// Adds the table.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", ROWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "One view of each object, {count} scenes. In one view nothing tells the common scale of all lengths, so that biases remain. \
         \"As expected\": in each scene the logarithms of the scales of depths and of distances are drawn with {SCALE_SD}, that of \
         sizes with {SIZE_SD}, the standard deviations that the estimator assumes. O3D, and medians of the error of the center in mean \
         semi-axes and of the mean error of the logarithms of the semi-axes."
    ));
    let titles = ["biases", "measure"].into_iter().chain(CUES.into_iter().skip(1)).collect::<Vec<_>>();
    let mut table = Table::new("One view: biases of the sources", titles);
    for (deviations, label) in ROWS {
        let of_scene = |scene: u64| {
            let seed = run.seed.wrapping_add(FIRST_SEED + scene);
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let mut drawn = |sd: f64| (deviations * sd * normal(&mut rng)).exp();
            let biases = Biases { depth: drawn(SCALE_SD), distance: drawn(SCALE_SD), size: drawn(SIZE_SD) };
            let made = noisy_boxes(1, seed)?;
            scores_of(&made, &|column| scene_of(&made, column, biases, seed), seed)
        };
        let scenes: Vec<Vec<Vec<Option<Score>>>> =
            (0..count).into_par_iter().map(of_scene).collect::<Result<_, Error>>()?;
        let of = |column: usize| scenes.iter().flat_map(move |scene| scene[column].iter().copied());
        let columns = 1..CUES.len();
        let median = |value: fn(&Score) -> f64| {
            let of_column = move |column: usize| median_figure(of(column).flatten().map(|s| value(&s)).collect());
            columns.clone().map(of_column).collect::<Vec<_>>()
        };
        let o3d = columns.clone().map(|column| pooled(&[of(column).map(|s| s.map_or(0.0, |s| s.o3d)).collect()]));
        for (measure, figures) in [
            ("O3D", o3d.collect::<Vec<_>>()),
            ("center error", median(|s| s.center)),
            ("size error", median(|s| s.size)),
        ] {
            let cells = figures.into_iter().map(|figure| Cell::figure(figure, 3));
            table.push([Cell::from(label), Cell::from(measure)].into_iter().chain(cells).collect());
        }
        steps.done();
    }
    report.table(table);
    Ok(())
}

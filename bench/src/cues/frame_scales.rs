//! Depths with a scale in each frame: objects that are seen once, where the others tell the scale.

use quadlift::geometry::BodyKind;
use quadlift::metrics::nees;
use quadlift::scene::Detection;
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::{CueOptions, DepthNoise, simulate_cues};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::synthetic::{OBJECTS, SCENES, noisy_boxes};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::median_figure;
use crate::table::{Cell, Table};

/// Frames of each scene.
const FRAMES: [usize; 5] = [2, 3, 5, 10, 20];

/// Standard deviation of the logarithm of a frame's scale.
const SPREAD: f64 = 0.3;

const FIRST_SEED: u64 = 61;

/// What the depths are and what the scene says of them.
const DEPTHS: [&str; 3] = ["one scale", "a scale in each frame, not told", "a scale in each frame"];

/// Errors of the centers of objects that are seen once, in mean semi-axes, and their NEES.
fn errors(frames: usize, column: usize, seed: u64) -> Result<Vec<[f64; 2]>, Error> {
    let made = noisy_boxes(frames, seed)?;
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    let frame_scale = if column == 0 { 0.0 } else { SPREAD };
    let depth = DepthNoise { outliers: 0.05, frame_scale, ..Default::default() };
    let mut scene = simulate_cues(&made.scene, body_of, &CueOptions { depth: Some(depth), box3d: None }, seed)?;
    let is_seen_once = |object: usize| object % 2 == 1;
    scene.edit(|parts| {
        if column == 1 {
            parts.scaled_by_frame.clear();
        }
        parts.detections.retain(|detection| {
            let object = detection.object_index.unwrap_or(0) as usize;
            !is_seen_once(object) || detection.frame_index as usize == object / 2 % frames
        });
    })?;
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    let found = localize(&scene, &LocalizeOptions { seed, ..options.into() })?;
    let error = |estimate: &quadlift::solve::Estimate| {
        let id = &scene.object_ids[estimate.object_index];
        let truth = made.truth.iter().find(|(name, _)| name == id)?.1.closest_ellipsoid();
        let body = estimate.closest_ellipsoid().filter(|_| estimate.status == Status::Ok)?;
        let normalized = estimate.covariance.as_ref().and_then(|c| nees(&body, &truth, &c.matrix));
        Some([(body.center - truth.center).norm() / truth.semi_axes.mean(), normalized.unwrap_or(f64::NAN)])
    };
    Ok(found.estimates.iter().filter(|estimate| is_seen_once(estimate.object_index)).filter_map(error).collect())
}

/// Adds the table.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", FRAMES.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "Every second of the {OBJECTS} objects is seen in one frame only, the others in all. Depths as above; in two columns the depths \
         of each frame have a further scale of their own (standard deviation of its logarithm {SPREAD}), as those of networks for \
         relative depth. Figures are medians over the objects that are seen once."
    ));
    let titles = || std::iter::once("frames").chain(DEPTHS).collect::<Vec<_>>();
    let mut tables = ["center error", "NEES"].map(|what| Table::new(format!("Scales of frames: {what}"), titles()));
    for frames in FRAMES {
        let of_column = |column: usize| -> Result<Vec<[f64; 2]>, Error> {
            let of_scene = |scene: u64| errors(frames, column, run.seed.wrapping_add(FIRST_SEED + scene));
            Ok((0..count).into_par_iter().map(of_scene).collect::<Result<Vec<_>, _>>()?.concat())
        };
        let columns: Vec<_> = (0..DEPTHS.len()).map(of_column).collect::<Result<_, _>>()?;
        steps.done();
        for (k, (table, decimals)) in tables.iter_mut().zip([3, 1]).enumerate() {
            let figure = |column: &Vec<[f64; 2]>| {
                Cell::figure(median_figure(column.iter().map(|e| e[k]).filter(|x| x.is_finite()).collect()), decimals)
            };
            let label: Cell = frames.to_string().as_str().into();
            table.push(std::iter::once(label).chain(columns.iter().map(figure)).collect());
        }
    }
    tables.into_iter().for_each(|table| report.table(table));
    Ok(())
}

//! Synthetic scenes: each cue alone and both, in 1 to 20 views.

use quadlift::geometry::{BodyKind, Ellipsoid};
use quadlift::metrics::{iou3d_ellipsoids, nees};
use quadlift::scene::{Detection, Scene};
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, SyntheticOptions, SyntheticScene, generate, simulate_cues,
};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::fusion::mean_box;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, median_figure, pooled};
use crate::table::{Cell, Table};

/// Views of each object.
const VIEWS: [usize; 6] = [1, 2, 3, 5, 10, 20];

/// Objects of a scene, and scenes of each row.
pub(super) const OBJECTS: usize = 50;
pub(super) const SCENES: u64 = 4;
pub(super) const FIRST_SEED: u64 = 21;

/// Standard deviation of the edges of the boxes, in mean half sizes.
pub(super) const EDGE_NOISE: f64 = 0.03;

/// Distance of the cameras from the middle of the objects, and the side of the cube in which they lie.
pub(super) const DISTANCE: f64 = 25.0;
pub(super) const CUBE: f64 = 10.0;

/// What is known besides the boxes.
pub(super) const CUES: [&str; 5] = ["boxes", "+ depth", "+ 3D boxes", "+ both", "mean of 3D boxes"];

/// The scores of one object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Score {
    pub o3d: f64,
    pub center: f64,
    pub size: f64,
    nees: Option<f64>,
}

/// The cues of a column, with these errors.
pub(super) fn cue_options(column: usize, depth: DepthNoise, box3d: Box3dNoise) -> CueOptions {
    CueOptions { depth: matches!(column, 1 | 3).then_some(depth), box3d: matches!(column, 2..).then_some(box3d) }
}

fn score(estimate: Option<(&Ellipsoid, Option<&quadlift::solve::Matrix9>)>, truth: &Ellipsoid) -> Option<Score> {
    let (ellipsoid, covariance) = estimate?;
    let sorted = |e: &Ellipsoid| {
        let mut axes: [f64; 3] = e.semi_axes.into();
        axes.sort_by(f64::total_cmp);
        axes
    };
    let (a, b) = (sorted(ellipsoid), sorted(truth));
    Some(Score {
        o3d: iou3d_ellipsoids(ellipsoid, truth),
        center: (ellipsoid.center - truth.center).norm() / truth.semi_axes.mean(),
        size: (0..3).map(|k| (a[k] / b[k]).ln().abs()).sum::<f64>() / 3.0,
        nees: covariance.and_then(|covariance| nees(ellipsoid, truth, covariance)),
    })
}

fn scene_of(made: &SyntheticScene, column: usize, seed: u64) -> Result<Scene, Error> {
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    let depth = DepthNoise { outliers: 0.05, ..Default::default() };
    Ok(simulate_cues(&made.scene, body_of, &cue_options(column, depth, Box3dNoise::default()), seed)?)
}

/// A scene of ellipsoids with noisy boxes.
pub(super) fn noisy_boxes(views: usize, seed: u64) -> Result<SyntheticScene, Error> {
    noisy_boxes_in(CUBE, DISTANCE, views, seed)
}

/// Such a scene in a cube of another side, with cameras at another distance.
pub(super) fn noisy_boxes_in(cube_side: f64, distance: f64, views: usize, seed: u64) -> Result<SyntheticScene, Error> {
    Ok(generate(&SyntheticOptions {
        seed,
        objects: OBJECTS,
        views,
        cube_side,
        distance,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(EDGE_NOISE)],
        ..Default::default()
    })?)
}

/// The scores of each column's objects; absent where there is no estimate.
fn scores(views: usize, seed: u64) -> Result<Vec<Vec<Option<Score>>>, Error> {
    let made = noisy_boxes(views, seed)?;
    scores_of(&made, &|column| scene_of(&made, column, seed), seed)
}

/// The scores of each column's objects, of which `scene_of` is the scene.
pub(super) fn scores_of(
    made: &SyntheticScene,
    scene_of: &dyn Fn(usize) -> Result<Scene, Error>,
    seed: u64,
) -> Result<Vec<Vec<Option<Score>>>, Error> {
    let truth: Vec<Ellipsoid> = made.truth.iter().map(|(_, body)| body.closest_ellipsoid()).collect();
    let of_column = |column: usize| -> Result<Vec<Option<Score>>, Error> {
        let scene = scene_of(column)?;
        if column == CUES.len() - 1 {
            let mean = |object: usize| {
                let cuboid = mean_box(&scene, object)?;
                Some(Ellipsoid { center: cuboid.center, semi_axes: cuboid.half_extents, rotation: cuboid.rotation })
            };
            return Ok((0..truth.len()).map(|k| score(mean(k).as_ref().map(|e| (e, None)), &truth[k])).collect());
        }
        let options = LocalizeOptions {
            seed,
            ..PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() }.into()
        };
        let found = localize(&scene, &options)?;
        Ok((0..truth.len())
            .map(|k| {
                let name = &made.truth[k].0;
                let estimate = found.estimates.iter().find(|e| &scene.object_ids[e.object_index] == name)?;
                let ellipsoid = &estimate.body?.inscribed();
                let covariance = estimate.covariance.as_ref().map(|c| &c.matrix);
                (estimate.status == Status::Ok).then(|| score(Some((ellipsoid, covariance)), &truth[k])).flatten()
            })
            .collect())
    };
    (0..CUES.len()).map(of_column).collect()
}

/// Adds the tables of synthetic scenes.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", VIEWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "{OBJECTS} ellipsoids in each of {count} scenes, cameras at {DISTANCE} from the middle of a cube of {CUBE}, boxes with \
         {EDGE_NOISE} of their half size of noise. Depths: medians over the visible surface, 10 % too far, 5 % noise, 5 % of something \
         behind. 3D boxes: centers 4 % of the distance along the ray and 1 % across, extents 8 % too large with 10 % noise, \
         yaw 8 degrees with 10 % flips, 5 % wrong in everything. The mean of the 3D boxes is what detectors of single images do \
         over frames. Scales and biases are found with the objects. O3D is 0 without an estimate; the others are medians over objects \
         with one: error of the center in mean semi-axes, mean error of the logarithms of the semi-axes, NEES (9 parameters: 8.34)."
    ));
    let mut tables: Vec<Table> = ["O3D", "center error", "size error", "NEES"]
        .iter()
        .map(|what| Table::new(format!("Cues: {what}"), std::iter::once("views").chain(CUES).collect::<Vec<_>>()))
        .collect();
    // Most that a cue costs, with two views and more.
    let mut worse = 0.0f64;
    for views in VIEWS {
        let of_scene = |scene: u64| scores(views, run.seed.wrapping_add(FIRST_SEED + scene));
        let scenes: Vec<_> = (0..count).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
        steps.done();
        let of = |column: usize| scenes.iter().flat_map(move |scene: &Vec<Vec<Option<Score>>>| scene[column].clone());
        let found =
            |column: usize, value: fn(&Score) -> f64| median_figure(of(column).flatten().map(|s| value(&s)).collect());
        let o3d: Vec<Option<Figure>> = (0..CUES.len())
            .map(|column| pooled(&[of(column).map(|score| score.map_or(0.0, |s| s.o3d)).collect()]))
            .collect();
        if views > 1
            && let Some(boxes) = o3d[0]
        {
            o3d[1..4].iter().flatten().for_each(|with| worse = worse.max(boxes.value - with.value));
        }
        let row = |figures: Vec<Option<Figure>>, decimals: usize| -> Vec<Cell> {
            let label: Cell = views.to_string().as_str().into();
            std::iter::once(label).chain(figures.into_iter().map(|f| Cell::figure(f, decimals))).collect()
        };
        let each = |value: fn(&Score) -> f64| (0..CUES.len()).map(|column| found(column, value)).collect::<Vec<_>>();
        let normalized = |column: usize| median_figure(of(column).flatten().filter_map(|s| s.nees).collect());
        tables[0].push(row(o3d, 3));
        tables[1].push(row(each(|s| s.center), 3));
        tables[2].push(row(each(|s| s.size), 3));
        tables[3].push(row((0..CUES.len()).map(normalized).collect(), 1));
    }
    tables.into_iter().for_each(|table| report.table(table));
    report.headlines.push(Headline::ours(
        "cues_worse",
        "most that O3D falls with a cue, two views and more",
        "posterior",
        worse,
    ));
    Ok(())
}

//! Scenes with upright bodies of several kinds (ours), compared with the median of triangulated boxes.
//!
//! Substitutes for real scenes that cannot be distributed: boxes, cans and bowls on a table, the same in few views,
//! parked cars. `--edge-bias` simulates systematic errors of a detector:
//! `quadlift synth --body cuboid,cylinder,ellipsoid --standing --edge-bias 0.04 --noise box:0.02 ...`.

mod wrong_boxes;

use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use quadlift::geometry::{Body, BodyKind};
use quadlift::metrics::iou3d_bodies;
use quadlift::scene::Scene;
use quadlift::solve::{CategoryPrior, PosteriorOptions};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, average, median};
use crate::table::{Cell, Table};

/// Scenes of each set.
const SCENES: u64 = 4;

/// Objects in each scene.
const OBJECTS: usize = 12;

/// Kinds, in turn.
const KINDS: [BodyKind; 3] = [BodyKind::Cuboid, BodyKind::Cylinder, BodyKind::Ellipsoid];
const NAMES: [&str; 3] = ["cuboids", "cylinders", "ellipsoids"];

/// Error of an edge that is the same in all boxes of an object, and that of a single edge, in mean half sizes.
const EDGE_BIAS: f64 = 0.04;
const NOISE: f64 = 0.02;

/// Standard deviation of the tilt in the row that has it that every object stands, radians.
const UPRIGHT_SD: f64 = 0.05;

/// The sets of scenes: name, trajectory, views, whether the objects stand. The short form has the first, without wrong boxes.
const SETS: [(&str, Trajectory, usize, bool); 4] = [
    ("a table, 40 views", Trajectory::Random, 40, true),
    ("8 views over 60 degrees", Trajectory::Arc { span: 60.0 }, 8, true),
    ("3 views around", Trajectory::Orbit, 3, true),
    ("8 views over 60 degrees, lying anyhow", Trajectory::Arc { span: 60.0 }, 8, false),
];

/// The median of triangulated boxes, or settings of `posterior`.
enum Row {
    Median,
    Posterior(Box<PosteriorOptions>),
}

fn rows() -> Vec<(&'static str, Row)> {
    let map = |options| Row::Posterior(Box::new(options));
    let body = |kind| map(PosteriorOptions { body: Some(kind), ..Default::default() });
    let mut standing = PosteriorOptions::default();
    let upright = CategoryPrior { upright_sd: Some(UPRIGHT_SD), ..Default::default() };
    standing.priors.by_category.insert("*".to_owned(), upright);
    vec![
        ("median of triangulated boxes", Row::Median),
        ("posterior, auto", map(PosteriorOptions::default())),
        ("posterior, auto, --no-upright", map(PosteriorOptions { upright: false, ..Default::default() })),
        ("posterior, auto, all upright", map(standing)),
        ("posterior, ellipsoid", body(BodyKind::Ellipsoid)),
        ("posterior, cuboid", body(BodyKind::Cuboid)),
        ("posterior, cylinder", body(BodyKind::Cylinder)),
    ]
}

/// Runs the experiment.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Localize`].
pub(crate) fn run(run: &Run) -> Result<Report, Error> {
    let (all_rows, sets) = (rows(), run.first(&SETS, 1));
    let rows = run.first(&all_rows, 2);
    let of_wrong_boxes = if run.short { 0 } else { wrong_boxes::STEPS };
    let steps = Steps::new("kinds", sets.len() * rows.len() + of_wrong_boxes, run.progress);
    let mut report = Report::new("kinds", "Bodies of several kinds (ours)");
    report.text(
        "Volume IoU of the estimated and the true body, each of its own kind, 0 without an estimate. One third of the \
         objects each are cuboids, cylinders and ellipsoids. The median of triangulated boxes is a simple baseline: \
         the median over pairs of views of the points where the rays through the box centers meet, and the median \
         width and height of the boxes at that depth, as an upright cuboid with a square base.",
    );
    for &(name, trajectory, views, standing) in sets {
        let scenes = (0..run.scenes(SCENES))
            .map(|k| {
                let options = SyntheticOptions {
                    seed: run.seed.wrapping_add(k),
                    objects: OBJECTS,
                    kinds: KINDS.to_vec(),
                    standing,
                    trajectory,
                    views,
                    observations: Observations::Boxes,
                    noise: vec![Noise::BoxEdges(NOISE)],
                    edge_bias: EDGE_BIAS,
                    ..Default::default()
                };
                Ok(generate(&options)?)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let mut table = Table::new(format!("IoU: {name}"), ["row"].iter().chain(&NAMES).chain(&["together"]));
        for (title, row) in rows {
            let ious = scenes
                .par_iter()
                .enumerate()
                .map(|(k, scene)| ious(scene, row, run.seed.wrapping_add(k as u64)))
                .collect::<Result<Vec<_>, Error>>()?;
            let of_kind = |kind: Option<usize>| -> Option<Figure> {
                let values = ious.iter().flatten().enumerate();
                let of_kind = values.filter(|(k, _)| kind.is_none_or(|kind| k % KINDS.len() == kind));
                average(&[of_kind.map(|(_, iou)| *iou).collect()])
            };
            let mut cells: Vec<Cell> = vec![(*title).into()];
            cells.extend((0..KINDS.len()).map(|kind| Cell::figure(of_kind(Some(kind)), 3)));
            cells.push(Cell::figure(of_kind(None), 3));
            table.push(cells);
            if let (Some(ours), true) = (of_kind(None), *title == "posterior, auto" && name == SETS[0].0) {
                let what = format!("IoU, {name}");
                let row = (*title).to_owned();
                report.headlines.push(Headline { id: "kinds_table", what, paper: None, ours, row, decimals: 3 });
            }
            steps.done();
        }
        report.table(table);
    }
    if !run.short {
        for table in wrong_boxes::tables(run, &steps)? {
            report.table(table);
        }
    }
    Ok(report)
}

/// The IoU of every object of a scene, in the order of the truth.
fn ious(synthetic: &SyntheticScene, row: &Row, seed: u64) -> Result<Vec<f64>, Error> {
    let scene = &synthetic.scene;
    let found: Vec<Option<Body>> = match row {
        Row::Median => (0..synthetic.truth.len()).map(|object| median_of_boxes(scene, object as u32)).collect(),
        Row::Posterior(map) => {
            let options = LocalizeOptions { allow_inconsistent: true, seed, ..LocalizeOptions::from((**map).clone()) };
            let estimates = localize(scene, &options)?.solution.estimates;
            let of_object = |object| estimates.iter().find(|e| e.object_index == object).and_then(|e| e.body);
            (0..synthetic.truth.len()).map(of_object).collect()
        }
    };
    let truth = synthetic.truth.iter().map(|(_, body)| body);
    Ok(truth.zip(found).map(|(truth, found)| found.map_or(0.0, |found| iou3d_bodies(&found, truth))).collect())
}

/// The upright cuboid of median position and size; `None` if no two views of the object determine a point.
fn median_of_boxes(scene: &Scene, object: u32) -> Option<Body> {
    let of_object = scene.detections.iter().filter(|detection| detection.object_index == Some(object));
    let views: Vec<_> =
        of_object.filter_map(|d| Some((&scene.frames[d.frame_index as usize].projection, d.bounding_box?))).collect();
    let ray = |k: usize| {
        let (projection, bounding_box) = views[k];
        Some((projection.center_in_world()?, projection.ray_in_world(&bounding_box.center())?.normalize()))
    };
    let mut points = Vec::new();
    for (i, j) in (0..views.len()).flat_map(|j| (0..j).map(move |i| (i, j))) {
        let ((a, u), (b, v)) = (ray(i)?, ray(j)?);
        // Where two lines are nearest to each other, halfway between them.
        let (w, cos) = (b - a, u.dot(&v));
        let sin2 = 1.0 - cos * cos;
        if sin2 > 1e-6 {
            let (s, t) = ((w.dot(&u) - cos * w.dot(&v)) / sin2, (cos * w.dot(&u) - w.dot(&v)) / sin2);
            points.push(nalgebra::center(&(a + u * s), &(b + v * t)));
        }
    }
    let coordinate = |k: usize| median(points.iter().map(|point| point[k]).collect());
    let center = Point3::new(coordinate(0)?, coordinate(1)?, coordinate(2)?);
    let sizes: Vec<Vector2<f64>> =
        views.iter().map(|(p, b)| b.size() * (p.depth(&center) / p.focal_length())).collect();
    let [width, height] = [0, 1].map(|k| median(sizes.iter().map(|size| size[k]).collect()));
    let half_extents = Vector3::new(width?, width?, height?) * 0.5;
    Some(Body { kind: BodyKind::Cuboid, center, half_extents, rotation: Rotation3::identity() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::ConvexBody;

    #[test]
    fn the_median_of_exact_boxes_is_near_the_object() {
        let options = SyntheticOptions {
            objects: 6,
            body: BodyKind::Cylinder,
            standing: true,
            trajectory: Trajectory::Orbit,
            observations: Observations::Boxes,
            ..Default::default()
        };
        let synthetic = generate(&options).unwrap();
        for (object, (_, truth)) in (0..).zip(&synthetic.truth) {
            let found = median_of_boxes(&synthetic.scene, object).unwrap();
            assert!((found.center() - truth.center()).norm() < 0.2 * truth.half_extents.max());
            let iou = iou3d_bodies(&found, truth);
            assert!((0.2..0.95).contains(&iou), "{iou}");
        }
    }
}

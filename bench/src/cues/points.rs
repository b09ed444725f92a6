//! Points of structure from motion as depths: on the bodies and behind them, with the frames that observed them.

use std::ops::ControlFlow;
use std::path::Path;

use nalgebra::{Point3, Vector2, Vector3};
use quadlift::geometry::{BodyKind, BoundingBox, Ellipsoid};
use quadlift::metrics::{iou3d_ellipsoids, nees};
use quadlift::random::{normal, stream};
use quadlift::scene::{Frame, Scene};
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::SyntheticScene;
use quadlift::{LocalizeOptions, localize};
use quadlift_io::SceneFile;
use quadlift_io::scene_file::{DetectionRecord, FrameRecord};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::synthetic::{EDGE_NOISE, OBJECTS, SCENES, noisy_boxes_in};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, median_figure, pooled};
use crate::table::{Cell, Table};

/// Scenes other than those on which the rules for points were chosen.
const FIRST_SEED: u64 = 211;

/// Views of each object.
const VIEWS: [usize; 5] = [1, 2, 3, 5, 20];

/// Distance of the cameras from the middle of the objects, and the side of the cube in which they lie: few overlap.
const DISTANCE: f64 = 100.0;
const CUBE: f64 = 100.0;

/// Clusters of points on a body, points of a cluster, and its radius relative to the body.
const CLUSTERS: usize = 10;
const OF_CLUSTER: usize = 4;
const CLUSTER: f64 = 0.15;

/// Points behind the bodies, on a sphere of this radius.
const BEHIND: usize = 2000;
const RADIUS: f64 = 2.0 * CUBE;

/// Standard deviation of the places of points along each axis, relative to the distance of the cameras.
const NOISE: f64 = 0.001;

/// Probability that a frame observed a point that it sees.
const OBSERVED: f64 = 0.6;

/// The stream of the seed.
const STREAM: u64 = 43;

/// What is known.
const COLUMNS: [&str; 3] = ["boxes", "+ points, in one view", "+ points, in every view"];

/// Accuracy and NEES of one object.
type Score = Option<(f64, Option<f64>)>;

/// A direction, evenly distributed.
fn direction(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(rng)).normalize()
}

/// How far along a ray (not of unit length) an ellipsoid begins.
fn first_meeting(body: &Ellipsoid, from: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let turned = |v: Vector3<f64>| (body.rotation.inverse() * v).component_div(&body.semi_axes);
    let (o, d) = (turned(from - body.center), turned(*ray));
    let (a, b, c) = (d.norm_squared(), d.dot(&o), o.norm_squared() - 1.0);
    (b * b > a * c).then(|| (-b - (b * b - a * c).sqrt()) / a)
}

/// Whether nothing hides a point of the surfaces from a frame.
fn is_seen(frame: &Frame, point: &Point3<f64>, bodies: &[Ellipsoid]) -> bool {
    let Some(camera) = frame.projection.center_in_world() else { return false };
    let inside = |pixel: Vector2<f64>| {
        frame.image_size.is_none_or(|size| (0.0..size.x).contains(&pixel.x) && (0.0..size.y).contains(&pixel.y))
    };
    let ray = point - camera;
    frame.projection.depth(point) > 0.0
        && frame.projection.project_point(point).is_some_and(inside)
        && bodies.iter().all(|body| first_meeting(body, &camera, &ray).is_none_or(|t| t > 0.999))
}

/// The scene as a file with points, whose detections have their objects or none.
fn file_of(made: &SyntheticScene, bodies: &[Ellipsoid], with_objects: bool, seed: u64) -> SceneFile {
    let mut rng = stream(seed, STREAM);
    let mut exact = Vec::new();
    // Features are found in images: at places of a detection that are spread evenly over it.
    let mut by_body: Vec<Vec<(&Frame, BoundingBox)>> = vec![Vec::new(); bodies.len()];
    for (detection, body) in made.scene.detections.iter().zip(&made.true_objects) {
        if let (Some(bounding_box), Some(body)) = (detection.bounding_box, body) {
            by_body[*body].push((&made.scene.frames[detection.frame_index as usize], bounding_box));
        }
    }
    for (body, seen) in bodies.iter().zip(&by_body) {
        let mut clusters = 0;
        for _ in 0..10 * CLUSTERS {
            if seen.is_empty() || clusters == CLUSTERS {
                break;
            }
            let (frame, b) = &seen[rng.random_range(0..seen.len())];
            let pixel = Vector2::new(rng.random_range(b.x0()..b.x1()), rng.random_range(b.y0()..b.y1()));
            let Some((camera, ray)) = frame.projection.center_in_world().zip(frame.projection.ray_in_world(&pixel))
            else {
                continue;
            };
            let Some(t) = first_meeting(body, &camera, &ray) else { continue };
            let middle = (body.rotation.inverse() * (camera + ray * t - body.center)).component_div(&body.semi_axes);
            clusters += 1;
            for _ in 0..OF_CLUSTER {
                let on_sphere = (middle + direction(&mut rng) * CLUSTER).normalize();
                exact.push(body.center + body.rotation * on_sphere.component_mul(&body.semi_axes));
            }
        }
    }
    exact.extend((0..BEHIND).map(|_| Point3::from(direction(&mut rng) * RADIUS)));
    let sd = NOISE * DISTANCE;
    let points = exact.iter().map(|point| [0, 1, 2].map(|k| point[k] + sd * normal(&mut rng))).collect();
    let scene: &Scene = &made.scene;
    let frames = scene.frames.iter().map(|frame| {
        let seen = (0u32..).zip(&exact).filter(|(_, point)| is_seen(frame, point, bodies)).map(|(k, _)| k);
        let observed: Vec<u32> = seen.filter(|_| rng.random_range(0.0..1.0) < OBSERVED).collect();
        let rows = frame.projection.matrix();
        FrameRecord {
            id: frame.id.clone(),
            projection: Some([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| rows[(i, j)]))),
            width: frame.image_size.map(|size| size.x),
            height: frame.image_size.map(|size| size.y),
            observed_points: Some(observed.into()),
            ..FrameRecord::default()
        }
    });
    let frames = frames.collect();
    let detections = scene.detections.iter().map(|detection| DetectionRecord {
        frame: scene.frames[detection.frame_index as usize].id.as_str().into(),
        object: detection.object_index.filter(|_| with_objects).map(|k| scene.object_ids[k as usize].as_str().into()),
        bounding_box: detection.bounding_box.map(|b| b.edges()),
        ..DetectionRecord::default()
    });
    SceneFile { points, frames, detections: detections.collect(), ..SceneFile::default() }
}

/// A file as a scene, with the depths of its points.
fn with_depths(file: &SceneFile) -> Result<Scene, Error> {
    let in_file = |error: quadlift_io::EntryError| error.in_file(Path::new("synthetic"));
    let mut scene = file.to_scene().map_err(in_file)?;
    let watch = |_: usize, _: usize| ControlFlow::Continue(());
    file.add_depths_of_points(Path::new("synthetic"), &mut scene, None, &watch).map_err(in_file)?;
    Ok(scene)
}

/// The scores of each column's objects, and for each column the share of detections with a depth.
fn scores(views: usize, seed: u64) -> Result<Vec<(Vec<Score>, f64)>, Error> {
    let made = noisy_boxes_in(CUBE, DISTANCE, views, seed)?;
    let truth: Vec<Ellipsoid> = made.truth.iter().map(|(_, body)| body.closest_ellipsoid()).collect();
    let of_column = |column: usize| {
        let mut scene = made.scene.clone();
        if column > 0 {
            // Without objects nothing says which points count for one object.
            let depths = with_depths(&file_of(&made, &truth, column == 1, seed))?.into_parts();
            scene.edit(|parts| {
                parts.detections.iter_mut().zip(depths.detections).for_each(|(to, from)| to.cues = from.cues);
                (parts.cue_sources, parts.scale_known) = (depths.cue_sources, depths.scale_known);
            })?;
        }
        let with = scene.detections.iter().filter(|detection| detection.cues.is_some()).count();
        let share = with as f64 / scene.detections.len().max(1) as f64;
        let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
        let found = localize(&scene, &LocalizeOptions { seed, ..options.into() })?;
        let score = |k: usize| {
            let estimate = found.estimates.iter().find(|e| scene.object_ids[e.object_index] == made.truth[k].0)?;
            let body = estimate.closest_ellipsoid().filter(|_| estimate.status == Status::Ok)?;
            let normalized = estimate.covariance.as_ref().and_then(|c| nees(&body, &truth[k], &c.matrix));
            Some((iou3d_ellipsoids(&body, &truth[k]), normalized))
        };
        Ok(((0..truth.len()).map(score).collect(), share))
    };
    (0..COLUMNS.len()).map(of_column).collect()
}

/// Adds the tables.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", VIEWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "Points of structure from motion in scenes as above ({OBJECTS} ellipsoids, {EDGE_NOISE} of noise of the boxes): {CLUSTERS} clusters of \
         {OF_CLUSTER} on each body and {BEHIND} behind, wrong by {NOISE} of the distance of the cameras; each frame observed {OBSERVED} of those \
         that it sees. Each object has one depth, in one of its views, or one in every view."
    ));
    let titles = || std::iter::once("views").chain(COLUMNS).collect::<Vec<_>>();
    let mut tables = ["O3D", "NEES"].map(|what| Table::new(format!("Points: {what}"), titles()));
    let mut shares = Table::new("Points: detections with a depth, %".to_owned(), titles());
    let mut worse = 0.0f64;
    for views in VIEWS {
        let of_scene = |scene: u64| scores(views, run.seed.wrapping_add(FIRST_SEED + scene));
        let scenes: Vec<_> = (0..count).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
        steps.done();
        let of = |column: usize| scenes.iter().flat_map(move |scene| scene[column].0.iter().copied());
        let label = || -> Cell { views.to_string().as_str().into() };
        let o3d: Vec<Option<Figure>> =
            (0..COLUMNS.len()).map(|k| pooled(&[of(k).map(|score| score.map_or(0.0, |s| s.0)).collect()])).collect();
        if let (true, Some(boxes), Some(with)) = (views > 1, o3d[0], o3d[1]) {
            worse = worse.max(boxes.value - with.value);
        }
        let normalized = |k: usize| median_figure(of(k).flatten().filter_map(|score| score.1).collect());
        let share = |k: usize| {
            let sum: f64 = scenes.iter().map(|scene| scene[k].1).sum();
            Some(Figure { value: 100.0 * sum / scenes.len() as f64, standard_error: None })
        };
        tables[0].push(std::iter::once(label()).chain(o3d.into_iter().map(|f| Cell::figure(f, 3))).collect());
        let row = |of: &dyn Fn(usize) -> Option<Figure>, decimals: usize| {
            std::iter::once(label()).chain((0..COLUMNS.len()).map(|k| Cell::figure(of(k), decimals))).collect()
        };
        tables[1].push(row(&normalized, 1));
        shares.push(row(&share, 0));
    }
    tables.into_iter().chain([shares]).for_each(|table| report.table(table));
    report.headlines.push(Headline::ours(
        "points_worse",
        "most that O3D falls with points, two views and more",
        "posterior",
        worse,
    ));
    Ok(())
}

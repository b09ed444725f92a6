//! Surfaces that are found from the objects standing on them (`--supporting-surfaces`): tables, shelves, and scenes without one.

use std::path::Path;

use quadlift::geometry::{Body, BoundingBox, project_bounding_box};
use quadlift::metrics::{iou3d_ellipsoids, nees};
use quadlift::scene::Scene;
use quadlift::solve::{BodyKind, MapOptions};
use quadlift::synthetic::random::{normal, stream};
use quadlift::synthetic::{Observations, SyntheticOptions, generate};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::sizes::{STRIDES, real_rows, thinned};
use crate::error::Error;
use crate::kitti::protocol;
use crate::progress::{Progress, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, average, median_figure, pooled};
use crate::table::{Cell, Table};

/// Objects of a scene, scenes of each row, and views.
const OBJECTS: usize = 24;
const SCENES: u64 = 6;
const FIRST_SEED: u64 = 71;
const VIEWS: [usize; 4] = [2, 3, 5, 20];

/// Distance of the cameras from the middle, side of the square in which objects stand, and standard deviation of the edges in half sizes.
const DISTANCE: f64 = 60.0;
const SIDE: f64 = 20.0;
const EDGE_NOISE: f64 = 0.03;

/// Distance between the boards of a shelf.
const BOARD: f64 = 14.0;

/// Streams of the seed.
const HEIGHT_STREAM: u64 = 40;
const NOISE_STREAM: u64 = 41;

/// Where objects stand.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Places {
    /// On so many boards in turn.
    Boards(usize),
    /// Each at a height of its own.
    Anywhere,
}

const PLACES: [(&str, Places); 4] = [
    ("one table", Places::Boards(1)),
    ("shelf with two boards", Places::Boards(2)),
    ("shelf with four boards", Places::Boards(4)),
    ("no surface", Places::Anywhere),
];

const BODIES: [(&str, BodyKind); 2] = [("ellipsoids", BodyKind::Ellipsoid), ("cuboids", BodyKind::Cuboid)];

/// A scene with its true bodies.
fn scene(views: usize, kind: BodyKind, places: Places, seed: u64) -> Result<(Scene, Vec<(String, Body)>), Error> {
    let made = generate(&SyntheticOptions {
        seed,
        objects: OBJECTS,
        views,
        body: kind,
        standing: true,
        cube_side: SIDE,
        distance: DISTANCE,
        observations: Observations::Boxes,
        ..Default::default()
    })?;
    let (mut heights, mut errors) = (stream(seed, HEIGHT_STREAM), stream(seed, NOISE_STREAM));
    let lifted = |(k, (name, body)): (usize, &(String, Body))| {
        let height = match places {
            Places::Boards(count) => (k % count) as f64 - 0.5 * (count as f64 - 1.0),
            Places::Anywhere => normal(&mut heights),
        };
        (name.clone(), raised(body, BOARD * height))
    };
    let truth: Vec<(String, Body)> = made.truth.iter().enumerate().map(lifted).collect();
    let mut scene = made.scene;
    let mut seen = Vec::new();
    for detection in &scene.detections {
        let projection = &scene.frames[detection.frame_index as usize].projection;
        let exact = detection.object_index.and_then(|k| {
            let name = &scene.object_ids[k as usize];
            let (_, body) = truth.iter().find(|(id, _)| id == name)?;
            project_bounding_box(projection, body).ok()
        });
        seen.push(exact.and_then(|b| {
            let mut edge = |x: f64| x + EDGE_NOISE * b.mean_half_size() * normal(&mut errors);
            BoundingBox::new([b.x0(), b.y0(), b.x1(), b.y1()].map(&mut edge)).ok()
        }));
    }
    scene.edit(|parts| {
        parts.detections.iter_mut().zip(&seen).for_each(|(detection, seen)| detection.bounding_box = *seen);
        let mut seen = seen.iter();
        parts.detections.retain(|_| seen.next().is_some_and(Option::is_some));
    })?;
    Ok((scene, truth))
}

/// The body, that much higher.
fn raised(body: &Body, height: f64) -> Body {
    let mut body = *body;
    match &mut body {
        Body::Ellipsoid(ellipsoid) => ellipsoid.center.z += height,
        Body::Cuboid(cuboid) => cuboid.center.z += height,
        Body::Cylinder(cylinder) => cylinder.center.z += height,
        Body::Superellipsoid(superellipsoid) => superellipsoid.center.z += height,
    }
    body
}

/// O3D and NEES of the objects of a scene, and the number of surfaces.
struct Scores {
    o3d: Vec<f64>,
    nees: Vec<f64>,
    surfaces: usize,
}

fn scores(scene: &Scene, truth: &[(String, Body)], kind: BodyKind, found: bool, seed: u64) -> Result<Scores, Error> {
    let options = MapOptions { body: Some(kind), supporting_surfaces: found, ..Default::default() };
    let found = localize(scene, &LocalizeOptions { seed, ..options.into() })?;
    let mut scores = Scores { o3d: Vec::new(), nees: Vec::new(), surfaces: found.supporting_surfaces.len() };
    for estimate in &found.estimates {
        let name = &scene.object_ids[estimate.object_index];
        let Some((_, body)) = truth.iter().find(|(id, _)| id == name) else { continue };
        let truth = body.ellipsoid();
        let ellipsoid = estimate.ellipsoid();
        scores.o3d.push(ellipsoid.map_or(0.0, |e| iou3d_ellipsoids(&e, &truth)));
        let covariance = estimate.covariance.filter(|_| kind == BodyKind::Ellipsoid);
        scores.nees.extend(ellipsoid.zip(covariance).and_then(|(e, c)| nees(&e, &truth, &c.matrix)));
    }
    Ok(scores)
}

/// Adds the table of synthetic scenes.
pub(super) fn run(seed: u64, progress: Progress, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", BODIES.len() * PLACES.len() * VIEWS.len(), progress);
    report.text(format!(
        "Surfaces that are found from the objects standing on them (`--supporting-surfaces`): {OBJECTS} objects in each of {SCENES} scenes, \
         cameras at {DISTANCE}, boxes with {EDGE_NOISE} of their half size of noise, boards {BOARD} apart. \"No surface\": each object \
         is at a height of its own. Surfaces: mean number found. NEES: median, 9 parameters (8.34)."
    ));
    let mut table = Table::new(
        "Supporting surfaces: O3D of synthetic scenes",
        ["objects", "places", "views", "without", "with", "surfaces", "NEES without", "NEES with"],
    );
    let (mut worse, mut gains) = (0.0f64, Vec::new());
    for (body, kind) in BODIES {
        for (name, places) in PLACES {
            for views in VIEWS {
                let of_scene = |k: u64| -> Result<[Scores; 2], Error> {
                    let seed = seed.wrapping_add(FIRST_SEED + k);
                    let (scene, truth) = scene(views, kind, places, seed)?;
                    Ok([scores(&scene, &truth, kind, false, seed)?, scores(&scene, &truth, kind, true, seed)?])
                };
                let scenes: Vec<_> = (0..SCENES).into_par_iter().map(of_scene).collect::<Result<_, Error>>()?;
                steps.done();
                let o3d = [0, 1].map(|k: usize| pooled(&scenes.iter().map(|s| s[k].o3d.clone()).collect::<Vec<_>>()));
                let normalised =
                    [0, 1].map(|k: usize| median_figure(scenes.iter().flat_map(|s| s[k].nees.clone()).collect()));
                if let [Some(without), Some(with)] = o3d {
                    worse = worse.max(without.value - with.value);
                    gains.push(with.value - without.value);
                }
                let surfaces = scenes.iter().map(|s| s[1].surfaces as f64).sum::<f64>() / SCENES as f64;
                let surfaces = Figure { value: surfaces, standard_error: None };
                let mut cells: Vec<Cell> = vec![body.into(), name.into(), views.to_string().as_str().into()];
                cells.extend(o3d.map(|figure| Cell::figure(figure, 3)));
                cells.push(Cell::figure(Some(surfaces), 1));
                cells.extend(normalised.map(|figure| Cell::figure(figure, 1)));
                table.push(cells);
            }
        }
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "map", value);
    let mean = gains.iter().sum::<f64>() / gains.len().max(1) as f64;
    report.headlines.push(headline("cues_surfaces_gain", "mean gain of O3D with supporting surfaces, synthetic", mean));
    report.headlines.push(headline(
        "cues_surfaces_worse",
        "most that O3D falls with supporting surfaces, synthetic",
        worse,
    ));
    Ok(())
}

/// Adds the table of the real scenes that have `up`.
pub(super) fn run_real(data: &Path, seed: u64, progress: Progress, report: &mut Report) -> Result<(), Error> {
    let mut rows = real_rows(data)?;
    rows.retain(|row| row.scenes.iter().all(|scene| scene.scene.up.is_some()));
    let steps = Steps::new("cues", rows.len(), progress);
    let mut table = Table::new(
        "Supporting surfaces: O3D of real objects, no other prior",
        ["data", "views", "without", "with", "enclosing, without", "enclosing, with"],
    );
    for row in &rows {
        for stride in STRIDES {
            let scenes: Vec<_> =
                row.scenes.iter().map(|scene| thinned(scene, row.source, stride)).collect::<Result<_, Error>>()?;
            let mut figures = Vec::new();
            for found in [false, true] {
                let map = MapOptions { supporting_surfaces: found, ..Default::default() };
                let mut options = LocalizeOptions { seed, ..map.into() };
                options.source = Some(row.source.to_owned());
                if row.cars {
                    protocol(row.source, seed)(&mut options);
                }
                let scores: Vec<_> =
                    scenes.par_iter().map(|scene| scene.scores(&options)).collect::<Result<_, Error>>()?;
                let of = |measure: Measure| average(&scores.iter().map(|s| measure.values(s)).collect::<Vec<_>>());
                figures.push([of(Measure::O3d), of(Measure::EnclosingO3d)]);
            }
            let views = if stride == 1 { "all".to_owned() } else { format!("one in {stride}") };
            let mut cells: Vec<Cell> = vec![row.name.into(), views.as_str().into()];
            cells.extend((0..2).flat_map(|k| [figures[0][k], figures[1][k]]).map(|figure| Cell::figure(figure, 3)));
            table.push(cells);
        }
        steps.done();
    }
    report.table(table);
    Ok(())
}

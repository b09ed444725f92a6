//! Synthetic scenes: outlines and oriented boxes beside boxes, in 2 to 20 views.

use quadlift::geometry::{
    Body, BodyKind, Ellipse, Ellipsoid, OrientedBox, OutlineEnd, TangentLines, project_ellipsoid,
};
use quadlift::metrics::{iou3d_ellipsoids, nees};
use quadlift::nalgebra::{Rotation2, Vector2};
use quadlift::scene::Scene;
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::SyntheticScene;
use quadlift::{LocalizeOptions, localize};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::synthetic::{EDGE_NOISE, FIRST_SEED, SCENES, noisy_boxes};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, median_figure, pooled};
use crate::table::{Cell, Table};

/// Views of each object.
const VIEWS: [usize; 4] = [2, 3, 5, 20];

/// What is measured.
const MEASURED: [&str; 4] = ["boxes", "outlines", "boxes and outlines", "oriented boxes"];

/// Corners of an outline.
const CORNERS: usize = 64;

/// Highest harmonic of the errors of an outline: size (0), place (1), elongation (2).
const HARMONICS: usize = 3;

/// Standard deviation of the angle of an oriented box, radians.
const ANGLE_NOISE: f64 = 0.05;

/// A normal random number (Box and Muller).
pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random_range(0.0..std::f64::consts::TAU));
    (-2.0 * u.ln()).sqrt() * v.cos()
}

/// An outline with smooth errors: of a radius [`EDGE_NOISE`] mean half sizes, correlated along the outline.
fn outline(ellipse: &Ellipse, rng: &mut ChaCha8Rng) -> Vec<(Vector2<f64>, OutlineEnd)> {
    let unit = ellipse.bounding_box().mean_half_size();
    let amplitudes: Vec<[f64; 2]> = (0..HARMONICS).map(|_| [normal(rng), normal(rng)]).collect();
    let scale = EDGE_NOISE * unit / (HARMONICS as f64).sqrt();
    let corner = |k: usize| {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / CORNERS as f64).sin_cos();
        let on_ellipse = Rotation2::new(ellipse.angle()) * ellipse.semi_axes().component_mul(&Vector2::new(cos, sin));
        let direction = on_ellipse.y.atan2(on_ellipse.x);
        let error: f64 = amplitudes
            .iter()
            .enumerate()
            .map(|(m, [a, b])| {
                let (sin, cos) = (m as f64 * direction).sin_cos();
                a * cos + b * sin
            })
            .sum();
        let point = ellipse.center() + on_ellipse + on_ellipse.normalize() * (scale * error);
        (point, OutlineEnd::default())
    };
    (0..CORNERS).map(corner).collect()
}

/// An oriented box along the axes of an ellipse, with errors of its angle and of its sides.
fn oriented_box(ellipse: &Ellipse, rng: &mut ChaCha8Rng) -> Option<OrientedBox> {
    let unit = ellipse.bounding_box().mean_half_size();
    let angle = ellipse.angle() + ANGLE_NOISE * normal(rng);
    let mut reach = [0.0; 4];
    for (k, reach) in reach.iter_mut().enumerate() {
        let turn = angle + std::f64::consts::FRAC_PI_2 * k as f64;
        let [.., offset] = ellipse.tangent_line(&Vector2::new(turn.cos(), turn.sin()));
        *reach = -offset + EDGE_NOISE * unit * normal(rng);
    }
    let center = Rotation2::new(angle) * Vector2::new(reach[0] - reach[2], reach[1] - reach[3]) * 0.5;
    OrientedBox::new(center, Vector2::new(reach[0] + reach[2], reach[1] + reach[3]), angle).ok()
}

/// The scene with what a column measures.
fn scene_of(made: &SyntheticScene, column: usize, seed: u64) -> Result<Scene, Error> {
    let mut parts = made.scene.clone().into_parts();
    let frames = parts.frames.clone();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for (index, detection) in parts.detections.iter_mut().enumerate() {
        let Some(object) = made.true_objects[index] else { continue };
        let projection = &frames[detection.frame_index as usize].projection;
        let Ok(ellipse) = project_ellipsoid(projection, &made.truth[object].1.closest_ellipsoid()) else { continue };
        let (outline, turned) = (outline(&ellipse, &mut rng), oriented_box(&ellipse, &mut rng));
        let lines = match (column, detection.bounding_box, turned) {
            (1, ..) => TangentLines::of_outline(&outline),
            (2, Some(around), _) => TangentLines::of_outline(&outline).map(|lines| lines.beside_box(&around)),
            (3, _, Some(turned)) => Some(TangentLines::of_oriented_box(&turned, None, 0.0)),
            _ => None,
        };
        if let Some(lines) = lines {
            detection.bounding_box = lines.bounding_box().or(detection.bounding_box);
            detection.tangent_lines = Some(Box::new(lines));
        }
    }
    Ok(Scene::from_parts(parts)?)
}

/// O3D and NEES of an object.
type Score = (f64, Option<f64>);

/// O3D and NEES of each column's objects; absent where there is no estimate.
fn scores(views: usize, seed: u64) -> Result<Vec<Vec<Option<Score>>>, Error> {
    let made = noisy_boxes(views, seed)?;
    let of_column = |column: usize| -> Result<Vec<_>, Error> {
        let scene = scene_of(&made, column, seed)?;
        let map = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
        let found = localize(&scene, &LocalizeOptions { seed, ..map.into() })?;
        let score = |(name, body): &(String, Body)| {
            let truth: Ellipsoid = body.closest_ellipsoid();
            let estimate = found.estimates.iter().find(|e| &scene.object_ids[e.object_index] == name)?;
            let ellipsoid = &estimate.body?.inscribed();
            let covariance = estimate.covariance.as_ref().map(|c| &c.matrix);
            let nees = covariance.and_then(|covariance| nees(ellipsoid, &truth, covariance));
            (estimate.status == Status::Ok).then(|| (iou3d_ellipsoids(ellipsoid, &truth), nees))
        };
        Ok(made.truth.iter().map(score).collect())
    };
    (0..MEASURED.len()).map(of_column).collect()
}

/// Adds the tables of outlines.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", VIEWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "Outlines and oriented boxes in the same scenes. The radius of an outline is wrong by {EDGE_NOISE} of the mean half size, \
         smoothly: in size, place and elongation, so that neighboring supporting lines err alike. Oriented boxes lie along the axes \
         of the true ellipse, their angle is wrong by {ANGLE_NOISE} radians and their sides like the edges of boxes. Beside a box, \
         an outline gives the four diagonal lines."
    ));
    let titles = std::iter::once("views").chain(MEASURED).collect::<Vec<_>>();
    let mut tables = ["O3D", "NEES"].map(|what| Table::new(format!("Outlines: {what}"), &titles));
    let mut worse = f64::NEG_INFINITY;
    for views in VIEWS {
        let of_scene = |scene: u64| scores(views, run.seed.wrapping_add(FIRST_SEED + scene));
        let scenes: Vec<_> = (0..count).into_par_iter().map(of_scene).collect::<Result<_, _>>()?;
        steps.done();
        let of = |column: usize| scenes.iter().flat_map(move |scene| scene[column].iter().copied());
        let o3d: Vec<Option<Figure>> = (0..MEASURED.len())
            .map(|column| pooled(&[of(column).map(|score| score.map_or(0.0, |s| s.0)).collect()]))
            .collect();
        if let Some(boxes) = o3d[0] {
            o3d[2..3].iter().flatten().for_each(|with| worse = worse.max(boxes.value - with.value));
        }
        let nees = |column: usize| median_figure(of(column).flatten().filter_map(|s| s.1).collect());
        let label = || std::iter::once(Cell::from(views.to_string().as_str()));
        tables[0].push(label().chain(o3d.into_iter().map(|f| Cell::figure(f, 3))).collect());
        tables[1].push(label().chain((0..MEASURED.len()).map(|column| Cell::figure(nees(column), 1))).collect());
    }
    tables.into_iter().for_each(|table| report.table(table));
    report.headlines.push(Headline::ours(
        "cues_outlines_worse",
        "most that O3D falls with outlines beside boxes",
        "posterior",
        worse,
    ));
    Ok(())
}

//! Simulated outlines and oriented boxes of detections, with noise (ours).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix2, Matrix3x4, Rotation2, Vector2};
use rand_chacha::ChaCha8Rng;

use crate::geometry::{Body, BodyKind, OrientedBox, Projection, project_bounding_box, project_ellipsoid};
use crate::random;
use crate::scene::{Detection, Scene};

/// Corners of an outline, a multiple of four.
const CORNERS: usize = 64;

/// Number of harmonics of the errors of an outline: size (0), place (1), elongation (2).
const HARMONICS: usize = 3;

/// The stream of the seed for outlines, and for oriented boxes.
const OUTLINE_STREAM: u64 = 43;
const TURNED_STREAM: u64 = 44;

/// Simulated outlines and oriented boxes; the default simulates none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShapeOptions {
    /// Standard deviation of the radius of an outline relative to the mean half size of the box, if there are outlines. The error is
    /// smooth: of size, place and elongation.
    pub outline: Option<f64>,
    /// Errors of oriented boxes, if there are any.
    pub oriented_box: Option<OrientedBoxNoise>,
}

/// Errors of simulated oriented boxes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBoxNoise {
    /// Standard deviation of the angle, radians.
    pub angle: f64,
    /// Standard deviation of each side, relative to the mean half size of the box.
    pub sides: f64,
}

impl Default for OrientedBoxNoise {
    /// Three degrees, and sides as good as the edges of boxes.
    fn default() -> Self {
        Self { angle: 3f64.to_radians(), sides: 0.03 }
    }
}

/// Outline and oriented box of a detection.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SimulatedShape {
    /// Corners of the outline, pixels.
    pub outline: Option<Vec<[f64; 2]>>,
    /// The oriented box.
    pub oriented_box: Option<OrientedBox>,
}

/// Simulated outlines and oriented boxes of the detections of a scene; none for those without a true body in front of the camera. Turned
/// boxes lie along the axes of ellipses; of other bodies they are the smallest ones around the outline.
pub fn simulate_shapes(
    scene: &Scene,
    body_of: impl Fn(usize, &Detection) -> Option<Body>,
    options: &ShapeOptions,
    seed: u64,
) -> Vec<SimulatedShape> {
    let mut of_outlines = random::stream(seed, OUTLINE_STREAM);
    let mut of_boxes = random::stream(seed, TURNED_STREAM);
    let simulated = |(index, detection): (usize, &Detection)| {
        let projection = &scene.frames[detection.frame_index as usize].projection;
        let seen = body_of(index, detection).and_then(|body| Seen::new(projection, body));
        seen.map_or_else(SimulatedShape::default, |seen| SimulatedShape {
            outline: options.outline.map(|noise| seen.outline(noise, &mut of_outlines)),
            oriented_box: options.oriented_box.and_then(|noise| seen.oriented_box(&noise, &mut of_boxes)),
        })
    };
    scene.detections.iter().enumerate().map(simulated).collect()
}

/// A body in an image, without errors.
struct Seen<'a> {
    projection: &'a Projection,
    body: Body,
    /// Tangent polygon.
    corners: Vec<Vector2<f64>>,
    /// Center of the box.
    center: Vector2<f64>,
    /// Mean half size of the box, pixels.
    unit: f64,
}

impl<'a> Seen<'a> {
    fn new(projection: &'a Projection, body: Body) -> Option<Self> {
        let around = project_bounding_box(projection, &body).ok()?;
        let turns = CORNERS / 4;
        // Lines n . x = d by the direction of n.
        let mut lines = vec![(Vector2::zeros(), 0.0); CORNERS];
        for k in 0..turns {
            let angle = FRAC_PI_2 * k as f64 / turns as f64;
            for (quarter, reach) in reaches(projection, &body, angle)?.into_iter().enumerate() {
                let normal = Rotation2::new(angle + FRAC_PI_2 * quarter as f64) * Vector2::x();
                lines[quarter * turns + k] = (normal, reach);
            }
        }
        let corner = |k: usize| {
            let ((n, d), (m, e)) = (lines[k], lines[(k + 1) % CORNERS]);
            Matrix2::from_rows(&[n.transpose(), m.transpose()])
                .try_inverse()
                .map(|inverse| inverse * Vector2::new(d, e))
        };
        let corners = (0..CORNERS).map(corner).collect::<Option<_>>()?;
        Some(Self { projection, body, corners, center: around.center(), unit: around.mean_half_size() })
    }

    fn outline(&self, noise: f64, rng: &mut ChaCha8Rng) -> Vec<[f64; 2]> {
        let amplitudes: Vec<[f64; 2]> = (0..HARMONICS).map(|_| [random::normal(rng), random::normal(rng)]).collect();
        let scale = noise * self.unit / (HARMONICS as f64).sqrt();
        let moved = |corner: &Vector2<f64>| {
            let radius = corner - self.center;
            let direction = radius.y.atan2(radius.x);
            let harmonic = |(m, [a, b]): (usize, &[f64; 2])| {
                let (sin, cos) = (m as f64 * direction).sin_cos();
                a * cos + b * sin
            };
            let error: f64 = amplitudes.iter().enumerate().map(harmonic).sum();
            (corner + radius.normalize() * (scale * error)).into()
        };
        self.corners.iter().map(moved).collect()
    }

    fn oriented_box(&self, noise: &OrientedBoxNoise, rng: &mut ChaCha8Rng) -> Option<OrientedBox> {
        let angle = self.angle()? + noise.angle * random::normal(rng);
        let reach = reaches(self.projection, &self.body, angle)?;
        let reach = reach.map(|reach| reach + noise.sides * self.unit * random::normal(rng));
        let center = Rotation2::new(angle) * Vector2::new(reach[0] - reach[2], reach[1] - reach[3]) * 0.5;
        OrientedBox::new(center, Vector2::new(reach[0] + reach[2], reach[1] + reach[3]), angle).ok()
    }

    /// The direction of an oriented box without errors.
    fn angle(&self) -> Option<f64> {
        if self.body.kind == BodyKind::Ellipsoid {
            return project_ellipsoid(self.projection, &self.body.inscribed()).ok().map(|ellipse| ellipse.angle());
        }
        let area = |angle: f64| {
            let [right, down, left, up] = reaches(self.projection, &self.body, angle)?;
            Some((right + left) * (down + up))
        };
        let smallest = |angles: &mut dyn Iterator<Item = f64>| {
            let areas = angles.filter_map(|angle| Some((angle, area(angle)?)));
            areas.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(angle, _)| angle)
        };
        let about = smallest(&mut (0..45).map(|k| 2.0 * f64::from(k).to_radians()))?;
        smallest(&mut (-8..=8).map(|k| about + 0.25 * f64::from(k).to_radians()))
    }
}

/// How far a body reaches in an image in the direction of an angle and in those that are a quarter of a turn on.
fn reaches(projection: &Projection, body: &Body, angle: f64) -> Option<[f64; 4]> {
    let turn = Rotation2::new(-angle);
    let mut turned: Matrix3x4<f64> = *projection.matrix();
    let rows = turn.matrix() * turned.fixed_rows::<2>(0);
    turned.fixed_rows_mut::<2>(0).copy_from(&rows);
    let [x0, y0, x1, y1] = project_bounding_box(&Projection::from_matrix(turned).ok()?, body).ok()?.edges();
    Some([x1, y1, -x0, -y0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BodyKind, TangentLines};
    use crate::synthetic::{SyntheticOptions, generate};

    /// Shapes of the detections of a scene with their true bodies and projections.
    fn simulated(kind: BodyKind, options: &ShapeOptions) -> Vec<(SimulatedShape, Body, Projection)> {
        let options_of_scene = SyntheticOptions {
            objects: 20,
            views: 10,
            body: kind,
            observations: crate::synthetic::Observations::Boxes,
            ..Default::default()
        };
        let made = generate(&options_of_scene).unwrap();
        let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
        let shapes = simulate_shapes(&made.scene, body_of, options, 1);
        let place = |(index, shape): (usize, SimulatedShape)| {
            let detection = &made.scene.detections[index];
            let projection = made.scene.frames[detection.frame_index as usize].projection;
            (shape, body_of(index, detection).unwrap(), projection)
        };
        shapes.into_iter().enumerate().map(place).collect()
    }

    #[test]
    fn exact_shapes_touch_the_body() {
        let exact =
            ShapeOptions { outline: Some(0.0), oriented_box: Some(OrientedBoxNoise { angle: 0.0, sides: 0.0 }) };
        for kind in [BodyKind::Ellipsoid, BodyKind::Cuboid] {
            for (shape, body, projection) in simulated(kind, &exact) {
                let corners = shape.outline.unwrap();
                let points: Vec<_> = corners.iter().map(|c| (Vector2::from(*c), Default::default())).collect();
                let lines = TangentLines::of_outline(&points).unwrap();
                let around = project_bounding_box(&projection, &body).unwrap();
                let difference = Vector2::from_fn(|k, _| lines.bounding_box().unwrap().edges()[k] - around.edges()[k]);
                assert!(difference.amax() < 1e-6 * around.mean_half_size(), "{difference}");
                // No smaller than the outline in any direction, and no rectangle of another angle is smaller.
                let turned = shape.oriented_box.unwrap();
                let area = turned.size().product();
                for k in 0..90 {
                    let reach = reaches(&projection, &body, f64::from(k).to_radians()).unwrap();
                    assert!(area <= (reach[0] + reach[2]) * (reach[1] + reach[3]) * 1.01, "{kind} {k}");
                }
            }
        }
    }

    #[test]
    fn errors_are_as_large_as_asked_for() {
        let noise =
            ShapeOptions { outline: Some(0.05), oriented_box: Some(OrientedBoxNoise { angle: 0.1, sides: 0.02 }) };
        let (mut radius, mut sides, mut count) = (0.0, 0.0, 0.0);
        for (shape, body, projection) in simulated(BodyKind::Ellipsoid, &noise) {
            let around = project_bounding_box(&projection, &body).unwrap();
            let exact = Seen::new(&projection, body).unwrap();
            let outline = shape.outline.unwrap();
            let errors = exact.corners.iter().zip(&outline).map(|(a, b)| (Vector2::from(*b) - a).norm_squared());
            radius += errors.sum::<f64>() / CORNERS as f64 / around.mean_half_size().powi(2);
            let turned = shape.oriented_box.unwrap();
            let reach = reaches(&projection, &body, turned.angle()).unwrap();
            let half = 0.5 * (reach[0] + reach[2] - turned.size().x) / around.mean_half_size();
            // The mean of two sides.
            sides += 2.0 * half * half;
            count += 1.0;
        }
        // Six harmonics of 200 outlines, and 200 pairs of sides: standard errors 4 % and 5 %.
        assert!(((radius / count).sqrt() / 0.05 - 1.0).abs() < 0.12, "{}", (radius / count).sqrt());
        assert!(((sides / count).sqrt() / 0.02 - 1.0).abs() < 0.2, "{}", (sides / count).sqrt());
    }
}

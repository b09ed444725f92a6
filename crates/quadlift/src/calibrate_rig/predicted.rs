//! The box of an upright body, with its derivatives.

use nalgebra::{Matrix3, Matrix3x2, Vector3};

use crate::geometry::box_of_outline;
use crate::geometry::rigid::Pose;

/// The shape of an upright body, of revolution about the vertical. Where radius and half height are the same and the exponent is 2 it is
/// a ball, which has no vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Logarithm of the radius.
    pub log_radius: f64,
    /// Logarithm of the half height.
    pub log_height: f64,
    /// Exponent of the support function: 2 of an ellipsoid, 1 of a cylinder.
    pub exponent: f64,
}

impl Shape {
    /// So many times as large.
    pub(super) fn scaled(self, factor: f64) -> Self {
        let by = factor.ln();
        Self { log_radius: self.log_radius + by, log_height: self.log_height + by, ..self }
    }

    /// Root of the sum of the squares of radius and half height: about what the half sizes of a box, as a vector, are in length at
    /// depth one, however the camera is turned about its axis.
    pub(super) fn extent(self) -> f64 {
        self.log_radius.exp().hypot(self.log_height.exp())
    }

    /// The support function of the body with this axis.
    fn support(self, axis: &Vector3<f64>, normal: &Vector3<f64>) -> Support {
        let (radius, height, q) = (self.log_radius.exp(), self.log_height.exp(), self.exponent);
        let along = axis.dot(normal);
        let across = normal - axis * along;
        // Along the axis the first term vanishes.
        let length = across.norm().max(f64::MIN_POSITIVE);
        let (wide, high) = (radius * length, height * along.abs());
        let value = (wide.powf(q) + high.powf(q)).powf(1.0 / q);
        let [by_wide, by_high] = [wide, high].map(|part| (part / value).powf(q - 1.0));
        let by_along = by_high * height * along.signum();
        Support {
            value,
            gradient: across * (by_wide * radius / length) + axis * by_along,
            by_axis: by_along - by_wide * radius * along / length,
            by_log_radius: by_wide * wide,
            by_log_height: by_high * high,
        }
    }
}

/// The value of a support function, with derivatives.
#[derive(Debug, Clone, Copy)]
struct Support {
    value: f64,
    /// By the normal: the point that lies farthest along it.
    gradient: Vector3<f64>,
    /// By the axis, along the normal.
    by_axis: f64,
    by_log_radius: f64,
    by_log_height: f64,
}

/// Two directions across another one: by them it moves.
pub(super) fn across(up: &Vector3<f64>) -> Matrix3x2<f64> {
    let other = if up.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = up.cross(&other).normalize();
    Matrix3x2::from_columns(&[first, up.cross(&first)])
}

/// The box of a body in the frame of a camera, in coordinates (X / Z, Y / Z).
#[derive(Debug, Clone, Copy)]
pub(super) struct Predicted {
    /// Left, top, right, bottom.
    pub edges: [f64; 4],
    rotation: Matrix3<f64>,
    depth: f64,
    /// Where the edges touch the body, in the camera, and its support there.
    touches: [(Vector3<f64>, Support); 4],
}

/// Derivatives of an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeSlope {
    /// By the motion of [`Pose::moved`].
    pub turn: Vector3<f64>,
    pub shift: Vector3<f64>,
    /// By the position of the body, world.
    pub center: Vector3<f64>,
    /// By the vertical, world; only the part across it has a meaning.
    pub up: Vector3<f64>,
    pub log_radius: f64,
    pub log_height: f64,
}

/// Maximum number of steps to an edge.
const MAX_STEPS: usize = 30;

impl Predicted {
    /// `None` where the body is not wholly in front of the camera.
    pub(super) fn new(pose: &Pose, center: &Vector3<f64>, up: &Vector3<f64>, shape: Shape) -> Option<Self> {
        let center = pose.apply(center);
        if center.z <= 0.0 {
            return None;
        }
        let [radius, height] = [shape.log_radius, shape.log_height].map(|log| (2.0 * log).exp());
        let axis = pose.rotation * up;
        let matrix = Matrix3::identity() * radius + axis * axis.transpose() * (height - radius);
        let mut edges = box_of_outline(&(matrix - center * center.transpose()), center.z)?;
        let mut touches = [None; 4];
        for (edge, touch) in touches.iter_mut().enumerate() {
            // The plane through the camera and the edge, l . X = 0, touches the body: l . c + h(l) = 0, or l . c = h(l) of left and upper
            // edges. The body holds the ellipsoid, at whose edge the search begins, so that Newton's steps lead outwards, to the edge.
            for _ in 0..MAX_STEPS {
                let (line, sign) = line(edge, edges[edge]);
                let support = shape.support(&axis, &line);
                let point = center + support.gradient * sign;
                let step = (line.dot(&center) + sign * support.value) / point.z;
                if !(point.z > 0.0 && step.is_finite()) {
                    return None;
                }
                *touch = Some((point, support));
                edges[edge] += step;
                if step.abs() < 1e-12 {
                    break;
                }
            }
        }
        let [Some(a), Some(b), Some(c), Some(d)] = touches else { return None };
        Some(Self { edges, rotation: pose.rotation, depth: center.z, touches: [a, b, c, d] })
    }

    /// Depth of the center.
    pub(super) fn depth(&self) -> f64 {
        self.depth
    }

    /// Derivatives of an edge.
    pub(super) fn slope(&self, edge: usize) -> EdgeSlope {
        let (line, sign) = line(edge, self.edges[edge]);
        // The edge moves so that its plane goes on touching the body.
        let (point, support) = &self.touches[edge];
        let scale = 1.0 / point.z;
        let line_in_world = self.rotation.tr_mul(&line);
        EdgeSlope {
            turn: point.cross(&line) * scale,
            shift: line * scale,
            center: line_in_world * scale,
            up: line_in_world * (sign * support.by_axis * scale),
            log_radius: sign * support.by_log_radius * scale,
            log_height: sign * support.by_log_height * scale,
        }
    }
}

/// The normal of the plane through the camera and an edge, and whether the body lies behind (1) or before it (-1).
fn line(edge: usize, x: f64) -> (Vector3<f64>, f64) {
    let mut line = Vector3::zeros();
    line[edge % 2] = 1.0;
    line[2] = -x;
    (line, if edge < 2 { -1.0 } else { 1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Body, BodyKind, Ellipsoid, Intrinsics, Projection, project_bounding_box};
    use nalgebra::{Point3, Rotation3};

    fn pose() -> Pose {
        Pose {
            rotation: *Rotation3::from_euler_angles(0.2, -0.3, 0.1).matrix(),
            translation: Vector3::new(0.3, -0.2, 4.0),
        }
    }

    const SHAPE: Shape = Shape { log_radius: -1.2, log_height: -0.2, exponent: 2.0 };

    fn edges(pose: &Pose, center: &Vector3<f64>, up: &Vector3<f64>, shape: Shape) -> [f64; 4] {
        Predicted::new(pose, center, up, shape).unwrap().edges
    }

    #[test]
    fn the_predicted_box_is_that_of_the_projection() {
        let turn = Rotation3::new(Vector3::new(0.3, 0.7, 0.0));
        let center = Vector3::new(0.4, 0.1, 0.3);
        let found = edges(&pose(), &center, &(turn * Vector3::z()), SHAPE);
        let (radius, height) = (SHAPE.log_radius.exp(), SHAPE.log_height.exp());
        let body =
            Ellipsoid { center: Point3::from(center), semi_axes: Vector3::new(radius, radius, height), rotation: turn };
        let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &pose().checked().unwrap());
        let expected = project_bounding_box(&projection, &body).unwrap().edges();
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let cylinder = Body { kind: BodyKind::Cylinder, ..body.into() };
        let found = edges(&pose(), &center, &(turn * Vector3::z()), Shape { exponent: 1.0, ..SHAPE });
        let expected = project_bounding_box(&projection, &cylinder).unwrap().edges();
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
        let behind = Pose { translation: -pose().translation, ..pose() };
        assert!(Predicted::new(&behind, &center, &Vector3::z(), SHAPE).is_none());
        assert!(Predicted::new(&pose(), &Vector3::repeat(f64::NAN), &Vector3::z(), SHAPE).is_none());
    }

    #[test]
    fn slopes_are_those_of_differences() {
        for exponent in [2.0, 1.5, 1.1] {
            check_slopes(Shape { exponent, ..SHAPE });
        }
    }

    fn check_slopes(of: Shape) {
        let center = Vector3::new(0.4, 0.1, 0.3);
        let up = Vector3::new(0.1, 0.9, 0.3).normalize();
        let predicted = Predicted::new(&pose(), &center, &up, of).unwrap();
        let step = 1e-6;
        let tangent = across(&up);
        for edge in 0..4 {
            let slope = predicted.slope(edge);
            let check = |at: &dyn Fn(f64) -> [f64; 4], analytic: f64| {
                let numeric = (at(step)[edge] - at(-step)[edge]) / (2.0 * step);
                assert!((numeric - analytic).abs() < 1e-8, "{edge}: {numeric} {analytic}");
            };
            for k in 0..3 {
                let by = |x: f64| Vector3::ith(k, x);
                let none = Vector3::zeros();
                check(&|x| edges(&pose().moved(&by(x), &none), &center, &up, of), slope.turn[k]);
                check(&|x| edges(&pose().moved(&none, &by(x)), &center, &up, of), slope.shift[k]);
                check(&|x| edges(&pose(), &(center + by(x)), &up, of), slope.center[k]);
            }
            for k in 0..2 {
                let direction = tangent.column(k).into_owned();
                let turned = |x: f64| (up + direction * x).normalize();
                check(&|x| edges(&pose(), &center, &turned(x), of), slope.up.dot(&direction));
            }
            let wider = |x: f64| Shape { log_radius: of.log_radius + x, ..of };
            let higher = |x: f64| Shape { log_height: of.log_height + x, ..of };
            check(&|x| edges(&pose(), &center, &up, wider(x)), slope.log_radius);
            check(&|x| edges(&pose(), &center, &up, higher(x)), slope.log_height);
        }
    }
}

//! The box of an upright body, with its derivatives.

use nalgebra::{Matrix3, Matrix3x2, Vector3};

use crate::geometry::box_of_outline;
use crate::geometry::rigid::Pose;

/// The shape of an upright body: an ellipsoid of revolution about the vertical. Where radius and half height are the same it is a
/// ball, which has no vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Logarithm of the radius.
    pub log_radius: f64,
    /// Logarithm of the half height.
    pub log_height: f64,
}

impl Shape {
    fn squares(self) -> [f64; 2] {
        [(2.0 * self.log_radius).exp(), (2.0 * self.log_height).exp()]
    }

    /// Root of the sum of the squares of radius and half height: about what the half sizes of a box, as a vector, are in length at
    /// depth one, however the camera is turned about its axis.
    pub(super) fn extent(self) -> f64 {
        let [radius, height] = self.squares();
        (radius + height).sqrt()
    }
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
    /// Center in the camera.
    center: Vector3<f64>,
    /// `R A R^T - c c^T`: the dual conic of the outline.
    conic: Matrix3<f64>,
    up: Vector3<f64>,
    squares: [f64; 2],
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

impl Predicted {
    /// `None` where the body is not wholly in front of the camera.
    pub(super) fn new(pose: &Pose, center: &Vector3<f64>, up: &Vector3<f64>, shape: Shape) -> Option<Self> {
        let center = pose.apply(center);
        if center.z <= 0.0 {
            return None;
        }
        let squares @ [radius, height] = shape.squares();
        let axis = pose.rotation * up;
        let matrix = Matrix3::identity() * radius + axis * axis.transpose() * (height - radius);
        let conic = matrix - center * center.transpose();
        let edges = box_of_outline(&conic, center.z)?;
        Some(Self { edges, rotation: pose.rotation, center, conic, up: *up, squares })
    }

    /// Depth of the center.
    pub(super) fn depth(&self) -> f64 {
        self.center.z
    }

    /// Derivatives of an edge.
    pub(super) fn slope(&self, edge: usize) -> EdgeSlope {
        let (axis, x) = (edge % 2, self.edges[edge]);
        // The edge is a line l = (1, 0, -x) with l^T conic l = 0, so that dx = l^T d(conic) l / (2 (conic l)_z).
        let mut line = Vector3::zeros();
        line[axis] = 1.0;
        line[2] = -x;
        let seen = self.conic * line;
        let scale = 0.5 / seen[2];
        let [radius, height] = self.squares;
        let line_in_world = self.rotation.tr_mul(&line);
        let along = self.up.dot(&line_in_world);
        let shift = line * (-2.0 * line.dot(&self.center) * scale);
        EdgeSlope {
            turn: seen.cross(&line) * (2.0 * scale),
            shift,
            center: self.rotation.tr_mul(&shift),
            up: line_in_world * (2.0 * (height - radius) * along * scale),
            log_radius: 2.0 * radius * (line.norm_squared() - along * along) * scale,
            log_height: 2.0 * height * along * along * scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Ellipsoid, Intrinsics, Projection, project_bounding_box};
    use nalgebra::{Point3, Rotation3};

    fn pose() -> Pose {
        Pose {
            rotation: *Rotation3::from_euler_angles(0.2, -0.3, 0.1).matrix(),
            translation: Vector3::new(0.3, -0.2, 4.0),
        }
    }

    const SHAPE: Shape = Shape { log_radius: -1.2, log_height: -0.2 };

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
        let behind = Pose { translation: -pose().translation, ..pose() };
        assert!(Predicted::new(&behind, &center, &Vector3::z(), SHAPE).is_none());
        assert!(Predicted::new(&pose(), &Vector3::repeat(f64::NAN), &Vector3::z(), SHAPE).is_none());
    }

    #[test]
    fn slopes_are_those_of_differences() {
        let center = Vector3::new(0.4, 0.1, 0.3);
        let up = Vector3::new(0.1, 0.9, 0.3).normalize();
        let predicted = Predicted::new(&pose(), &center, &up, SHAPE).unwrap();
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
                check(&|x| edges(&pose().moved(&by(x), &none), &center, &up, SHAPE), slope.turn[k]);
                check(&|x| edges(&pose().moved(&none, &by(x)), &center, &up, SHAPE), slope.shift[k]);
                check(&|x| edges(&pose(), &(center + by(x)), &up, SHAPE), slope.center[k]);
            }
            for k in 0..2 {
                let direction = tangent.column(k).into_owned();
                let turned = |x: f64| (up + direction * x).normalize();
                check(&|x| edges(&pose(), &center, &turned(x), SHAPE), slope.up.dot(&direction));
            }
            let wider = |x: f64| Shape { log_radius: SHAPE.log_radius + x, ..SHAPE };
            let higher = |x: f64| Shape { log_height: SHAPE.log_height + x, ..SHAPE };
            check(&|x| edges(&pose(), &center, &up, wider(x)), slope.log_radius);
            check(&|x| edges(&pose(), &center, &up, higher(x)), slope.log_height);
        }
    }
}

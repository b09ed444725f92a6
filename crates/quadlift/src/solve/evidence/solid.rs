//! Bodies as the fit sees them: support functions of four tangent planes at once, with slopes.

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::lanes::{Lanes, dot};
use crate::body_model::ellipsoid::exp_symmetric;
use crate::geometry::linalg::axes_of_image_of_ball;
use crate::geometry::{Body, BodyKind};
use crate::optimize::normal_equations::PARAMETERS;

/// Steps of the fit: shift of the center (3); rotation vector in the body's frame (3) and logarithms of half extents (3), of
/// ellipsoids the entries 23, 13, 12, 11, 22, 33 of a symmetric matrix D, with which A becomes B exp(D) B^T, A = B B^T.
pub(super) type Step = nalgebra::SVector<f64, PARAMETERS>;

/// Families of bodies that are fitted, from round to angular.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Family {
    Ellipsoid,
    /// Minkowski sum of a cuboid and an ellipsoid with the same axes and proportions.
    Rounded,
    Cuboid,
    /// About the third axis, with a circular base.
    Cylinder,
}

impl Family {
    pub(super) const ALL: [Self; 4] = [Self::Ellipsoid, Self::Rounded, Self::Cuboid, Self::Cylinder];
}

/// A body in the frame of its object.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solid {
    pub family: Family,
    pub center: Vector3<f64>,
    /// The axes as columns.
    pub axes: Matrix3<f64>,
    pub half_extents: Vector3<f64>,
    /// The cuboid's share of a rounded body.
    pub cuboid_share: f64,
    /// Direction against gravity, if one of the axes is vertical (of a cylinder: or level).
    pub up: Option<Vector3<f64>>,
}

/// Kinks of the support function become parabolas where a face is seen edge-on to within this angle.
const KINK_WIDTH: f64 = 0.004;

/// Half extents stay within this factor of the first sphere's radius.
const MAX_SIZE: f64 = 1e6;

/// Cosine below which the axis of an upright cylinder is the level one.
const LEVEL_COSINE: f64 = 0.7;

/// Bodies are alike if their supports differ by less than this share.
const SAME_SUPPORT: f64 = 0.03;

/// ... and their centers by less than this share of the first radius.
const SAME_CENTER: f64 = 0.07;

impl Solid {
    /// The axes as arrays.
    #[inline(always)]
    fn axis_arrays(&self) -> [[f64; 3]; 3] {
        self.axes.data.0
    }

    /// Support along four normals of these lengths, and its slopes by the last six entries of a [`Step`].
    #[inline(always)]
    pub(super) fn support4(&self, normal: &[Lanes; 3], length: Lanes) -> (Lanes, [Lanes; 6]) {
        let axes = self.axis_arrays();
        let width = length * KINK_WIDTH;
        let v = [dot(normal, &axes[0]), dot(normal, &axes[1]), dot(normal, &axes[2])];
        let a = &self.half_extents;
        match self.family {
            Family::Ellipsoid => {
                let u = [v[0] * a[0], v[1] * a[1], v[2] * a[2]];
                let h = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2] + width * width * 1e-12).sqrt();
                let inverse = h.inverse();
                let w = [u[0] * inverse, u[1] * inverse, u[2] * inverse];
                let half = |k: usize| w[k] * u[k] * 0.5;
                (h, [w[1] * u[2], w[0] * u[2], w[0] * u[1], half(0), half(1), half(2)])
            }
            Family::Cylinder => {
                let across = (v[0] * v[0] + v[1] * v[1] + width * width * 1e-6).sqrt();
                let scale = across.inverse() * a[0];
                let (along, sign) = v[2].rounded_abs(width);
                let g = [v[0] * scale, v[1] * scale, sign * a[2]];
                let base = across * a[0];
                let turn = [g[1] * v[2] - g[2] * v[1], g[2] * v[0] - g[0] * v[2]];
                (base + along * a[2], [turn[0], turn[1], Lanes::ZERO, base, Lanes::ZERO, g[2] * v[2]])
            }
            Family::Cuboid | Family::Rounded => {
                let share = if self.family == Family::Rounded { self.cuboid_share } else { 1.0 };
                let mut h = Lanes::ZERO;
                let mut g = [Lanes::ZERO; 3];
                for k in 0..3 {
                    let (along, sign) = v[k].rounded_abs(width);
                    h = h + along * (a[k] * share);
                    g[k] = sign * (a[k] * share);
                }
                if self.family == Family::Rounded {
                    let u = [v[0] * a[0], v[1] * a[1], v[2] * a[2]];
                    let round = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2] + width * width * 1e-12).sqrt();
                    let inverse = round.inverse() * (1.0 - share);
                    h = h + round * (1.0 - share);
                    for k in 0..3 {
                        g[k] = g[k] + u[k] * inverse * a[k];
                    }
                }
                let turn = [g[1] * v[2] - g[2] * v[1], g[2] * v[0] - g[0] * v[2], g[0] * v[1] - g[1] * v[0]];
                (h, [turn[0], turn[1], turn[2], g[0] * v[0], g[1] * v[1], g[2] * v[2]])
            }
        }
    }

    /// Slope of the support by the cuboid's share.
    pub(super) fn share_slope4(&self, normal: &[Lanes; 3], length: Lanes) -> Lanes {
        let of = |family| Self { family, ..*self }.support4(normal, length).0;
        of(Family::Cuboid) - of(Family::Ellipsoid)
    }

    /// The body after a step.
    pub(super) fn moved(&self, step: &Step) -> Self {
        let mut moved = *self;
        moved.center += step.fixed_rows::<3>(0);
        if self.family == Family::Ellipsoid {
            let half =
                Matrix3::new(step[6], step[5], step[4], step[5], step[7], step[3], step[4], step[3], step[8]) * 0.5;
            let root = Matrix3::from_diagonal(&self.half_extents) * exp_symmetric(&half);
            if let Some((lengths, mut axes)) = axes_of_image_of_ball(&root) {
                if axes.determinant() < 0.0 {
                    axes.column_mut(2).neg_mut();
                }
                moved.half_extents = lengths;
                moved.axes = self.axes * axes;
            }
        } else {
            moved.axes *= Rotation3::new(step.fixed_rows::<3>(3).into_owned()).matrix();
            for k in 0..3 {
                moved.half_extents[k] *= step[6 + k].exp();
            }
            if self.family == Family::Cylinder {
                moved.half_extents[1] = moved.half_extents[0];
            }
        }
        moved.half_extents.iter_mut().for_each(|x| *x = x.clamp(1.0 / MAX_SIZE, MAX_SIZE));
        moved
    }

    /// Support in one direction.
    pub(super) fn support(&self, n: &Vector3<f64>) -> f64 {
        let u = self.axes.tr_mul(n).component_mul(&self.half_extents);
        match self.family {
            Family::Ellipsoid => u.norm(),
            Family::Cuboid => u.abs().sum(),
            Family::Rounded => self.cuboid_share * u.abs().sum() + (1.0 - self.cuboid_share) * u.norm(),
            Family::Cylinder => u.x.hypot(u.y) + u.z.abs(),
        }
    }

    /// Geometric mean of the half extents.
    pub(super) fn size(&self) -> f64 {
        self.half_extents.product().cbrt()
    }

    /// The components of `up` along the axes, of an upright body.
    pub(super) fn up_in_body(&self) -> Option<Vector3<f64>> {
        self.up.map(|up| self.axes.tr_mul(&up))
    }

    /// Whether this is an upright cylinder whose axis is level.
    pub(super) fn is_level_cylinder(&self) -> bool {
        self.family == Family::Cylinder && self.up_in_body().is_some_and(|u| u.z.abs() < LEVEL_COSINE)
    }

    /// Whether two bodies are the same but for noise: compared along the axes and diagonals of the other, so that nothing depends on
    /// the world's.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        const DIAGONAL: f64 = 0.577;
        let directions = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [DIAGONAL, DIAGONAL, DIAGONAL],
            [-DIAGONAL, DIAGONAL, DIAGONAL],
            [DIAGONAL, -DIAGONAL, DIAGONAL],
            [DIAGONAL, DIAGONAL, -DIAGONAL],
        ];
        (self.center - other.center).norm() < SAME_CENTER
            && directions.into_iter().all(|direction| {
                let n = other.axes * Vector3::from(direction);
                let expected = other.support(&n);
                (self.support(&n) - expected).abs() < SAME_SUPPORT * expected
            })
    }

    /// The body in the world.
    pub(super) fn in_world(&self, origin: &nalgebra::Point3<f64>, unit: f64) -> Body {
        let kind = match self.family {
            Family::Ellipsoid => BodyKind::Ellipsoid,
            Family::Cuboid => BodyKind::Cuboid,
            Family::Cylinder => BodyKind::Cylinder,
            Family::Rounded => BodyKind::Rounded(1.0 - self.cuboid_share),
        };
        Body {
            center: origin + self.center * unit,
            rotation: Rotation3::from_matrix_unchecked(self.axes),
            half_extents: self.half_extents * unit,
            kind,
        }
    }
}

/// The frame of `up` and a level axis nearest to one of these axes, the first that is not vertical.
pub(super) fn level_axes(up: &Vector3<f64>, axes: &Matrix3<f64>) -> Option<[Vector3<f64>; 2]> {
    let level = |k: usize| {
        let axis = axes.column(k);
        axis - up * up.dot(&axis)
    };
    let first = level(0);
    let x = if first.norm() > 0.5 { first } else { level(1) };
    let x = Unit::try_new(x, 1e-9)?.into_inner();
    Some([x, up.cross(&x)])
}

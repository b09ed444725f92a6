//! The body of a fit: an ellipsoid or an oriented body, each in its own parameters.

use crate::tuning::ROUND_BODIES;
use nalgebra::{Matrix3, Rotation3, SVector, Vector3};

use super::covariance;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::body_model::{BodyModel, MeasuredShape, ShapeDifference};
use crate::geometry::{Body, BodyKind};
use crate::optimize::normal_equations::{NormalEquations, Row};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::estimate::{CovarianceCoordinates, Matrix9};

/// A body of any kind, in an object's frame.
#[derive(Debug, Clone)]
pub(crate) enum Model {
    /// An ellipsoid.
    Ellipsoid(EllipsoidModel),
    /// A cuboid, cylinder or superellipsoid.
    Oriented(OrientedModel),
}

/// The same call of whichever model it is.
macro_rules! either {
    ($model:expr, $inner:ident => $call:expr) => {
        match $model {
            Model::Ellipsoid($inner) => $call,
            Model::Oriented($inner) => $call,
        }
    };
}

impl BodyModel for Model {
    #[inline]
    fn center(&self) -> &Vector3<f64> {
        either!(self, model => model.center())
    }

    fn semi_axes(&self) -> Vector3<f64> {
        either!(self, model => model.semi_axes())
    }

    fn axes(&self) -> &Matrix3<f64> {
        either!(self, model => model.axes())
    }

    #[inline]
    fn support_gradient(&self, n: &Vector3<f64>) -> (f64, [f64; 6]) {
        either!(self, model => model.support_gradient(n))
    }

    fn root_transposed(&self) -> Option<&Matrix3<f64>> {
        either!(self, model => model.root_transposed())
    }

    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self> {
        match self {
            Self::Ellipsoid(model) => model.retract(step).map(Self::Ellipsoid),
            Self::Oriented(model) => model.retract(step).map(Self::Oriented),
        }
    }

    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations) {
        either!(self, model => model.add_shape_prior(weight, equations));
    }

    fn log_shape_along(&self, axes: &Matrix3<f64>) -> Option<[(f64, Row); 6]> {
        either!(self, model => model.log_shape_along(axes))
    }

    fn add_spin_prior(&self, equations: &mut NormalEquations) {
        either!(self, model => model.add_spin_prior(equations));
    }

    fn log_axes_gradient(&self) -> [Row; 3] {
        either!(self, model => model.log_axes_gradient())
    }

    fn near_side(&self, ray: &Vector3<f64>) -> (f64, [f64; 6]) {
        either!(self, model => model.near_side(ray))
    }

    fn compare(&self, measured: &MeasuredShape) -> ShapeDifference {
        either!(self, model => model.compare(measured))
    }

    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations) {
        either!(self, model => model.add_upright_prior(up, weight, equations));
    }
}

impl Model {
    /// The model of a body in the world, in an object's frame.
    pub(crate) fn of_body(body: &Body, frame: &ObjectFrame) -> Self {
        let (center, axes) = (frame.point_from_world(&body.center), frame.axes.tr_mul(body.rotation.matrix()));
        Self::new(body.kind, center, axes, body.half_extents / frame.unit)
    }

    fn new(kind: BodyKind, center: Vector3<f64>, axes: Matrix3<f64>, semi_axes: Vector3<f64>) -> Self {
        if kind == BodyKind::Ellipsoid {
            return Self::Ellipsoid(EllipsoidModel::from_axes(center, axes, semi_axes));
        }
        Self::Oriented(OrientedModel::new(center, axes, semi_axes, kind))
    }

    /// Its kind.
    fn kind(&self) -> BodyKind {
        match self {
            Self::Ellipsoid(_) => BodyKind::Ellipsoid,
            Self::Oriented(model) => model.kind(),
        }
    }

    /// A body of the same kind about the same axes with other semi-axes.
    pub(crate) fn of_size(&self, semi_axes: Vector3<f64>) -> Self {
        Self::new(self.kind(), *self.center(), *self.axes(), semi_axes)
    }

    /// The body in the world.
    pub(crate) fn body_in_world(&self, frame: &ObjectFrame) -> Body {
        let center = frame.point_in_world(self.center());
        let half_extents = self.semi_axes() * frame.unit;
        let rotation = Rotation3::from_matrix_unchecked(frame.axes * self.axes());
        Body { center, rotation, half_extents, kind: self.kind() }
    }

    /// Logarithm of the density of a body that stands, tilted with this standard deviation (radians), at zero tilt, over that
    /// of one that lies anyhow. `shape_sd` is the standard deviation of the shape prior.
    pub(crate) fn log_upright_density(&self, tilt_sd: f64, shape_sd: f64) -> f64 {
        match self {
            // Of the two entries of 1/2 log A between `up` and the horizontal, each of which has the variance
            // `shape_sd^2 / 2`.
            Self::Ellipsoid(_) => (0.5 * (shape_sd / tilt_sd).powi(2)).ln_1p() - ROUND_BODIES.get(),
            // One sixth of a Gaussian about each end of each axis over `1 / (4 pi)`.
            Self::Oriented(_) => -(3.0 * tilt_sd * tilt_sd).ln(),
        }
    }

    /// The coordinates of the covariance.
    pub(crate) fn coordinates(&self) -> CovarianceCoordinates {
        match self {
            Self::Ellipsoid(_) => CovarianceCoordinates::CenterVechShape,
            Self::Oriented(_) => CovarianceCoordinates::CenterRotationLogAxes,
        }
    }

    /// Derivatives of these coordinates, in world units, by the parameters of the fit.
    pub(crate) fn world_map(&self, frame: &ObjectFrame) -> Matrix9 {
        match self {
            Self::Ellipsoid(model) => covariance::ellipsoid_in_world(model, frame),
            Self::Oriented(_) => covariance::oriented_in_world(frame),
        }
    }
}

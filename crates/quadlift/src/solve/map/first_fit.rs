//! What each kind of body does by itself: the first fit from an ellipsoid, and the way back into the world.

use nalgebra::{Point3, Rotation3};

use super::super::conditioning::ObjectFrame;
use super::super::estimate::{CovarianceCoordinates, Matrix9};
use super::super::options::BodyKind;
use super::MapContext;
use super::body_model::{BodyModel, EllipsoidModel, Form, OrientedModel};
use super::covariance;
use super::levenberg_marquardt::{Stop, minimise};
use super::noise::NoiseLevels;
use super::normal_equations::NormalEquations;
use super::object::{FROM_START, Prepared};
use super::starts::{centers_from_size, oriented_starts};
use crate::geometry::{Body, ConvexBody, Cuboid, Cylinder, Ellipsoid, Superellipsoid};

/// To decide between many starts: few steps.
const SCREENING: Stop = Stop { evaluations: 15, promised_decrease: 1e-1 };

/// Oriented starts that are followed to the end.
const FOLLOWED_STARTS: usize = 3;

/// Subtracted from the log odds that an ellipsoid stands. Bodies are rounder than the shape prior allows for, and a round
/// one seems to stand: of random ellipsoids in three views of an orbit the log odds are 0.8 on average without it, of
/// standing ones in six views 1.8 and in many views 3.5 (synthetic scenes, seeds 11 and 12).
const ROUND_BODIES: f64 = 1.0;

/// How the first fit of each kind of body comes from the ellipsoid.
pub(super) trait FirstFit: BodyModel {
    /// Whether the first fit chooses between several starts, which is worth repeating under other noise levels.
    const SEVERAL_STARTS: bool;

    /// The body that a fitted ellipsoid leads to, and the objective there; `None` when no start can be evaluated.
    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Option<(Self, NormalEquations)>;

    /// The model of a body in the world, in an object's frame; `None` when it is of another kind.
    fn of_body(body: &Body, frame: &ObjectFrame) -> Option<Self>;

    /// The starts of the first fit after a few steps, with the objective there, the best first; none where a body has only
    /// one start.
    fn screened(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Vec<(Self, NormalEquations)>;

    /// The body in the world, of the kind that was asked for.
    fn body_in_world(&self, frame: &ObjectFrame, kind: BodyKind) -> Body;

    /// Logarithm of the density of a body that stands, tilted with this standard deviation (radians), at zero tilt, over that
    /// of one that lies anyhow. `shape_sd` is the standard deviation of the shape prior.
    fn log_upright_density(tilt_sd: f64, shape_sd: f64) -> f64;

    /// The coordinates of the covariance.
    const COORDINATES: CovarianceCoordinates;

    /// Derivatives of these coordinates, in world units, by the parameters of the fit.
    fn world_map(&self, frame: &ObjectFrame) -> Matrix9;
}

impl FirstFit for EllipsoidModel {
    const SEVERAL_STARTS: bool = false;

    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        _context: &MapContext,
        _seed: u64,
    ) -> Option<(Self, NormalEquations)> {
        let equations = prepared.objective(noise, outlier_scale).linearise(ellipsoid)?;
        Some((ellipsoid.clone(), equations))
    }

    fn of_body(body: &Body, frame: &ObjectFrame) -> Option<Self> {
        let Body::Ellipsoid(Ellipsoid { center, semi_axes, rotation }) = body else { return None };
        let center = (center - frame.origin) / frame.unit;
        Some(Self::from_axes(center, *rotation.matrix(), semi_axes / frame.unit))
    }

    fn screened(
        _prepared: &Prepared,
        _ellipsoid: &EllipsoidModel,
        _noise: &NoiseLevels,
        _outlier_scale: Option<f64>,
        _context: &MapContext,
        _seed: u64,
    ) -> Vec<(Self, NormalEquations)> {
        Vec::new()
    }

    fn body_in_world(&self, frame: &ObjectFrame, _kind: BodyKind) -> Body {
        Body::Ellipsoid(Ellipsoid {
            center: frame.point_in_world(self.center()),
            semi_axes: self.semi_axes() * frame.unit,
            rotation: Rotation3::from_matrix_unchecked(*self.axes()),
        })
    }

    fn log_upright_density(tilt_sd: f64, shape_sd: f64) -> f64 {
        // Of the two entries of 1/2 log A between `up` and the horizontal, each of which has the variance `shape_sd^2 / 2`.
        (0.5 * (shape_sd / tilt_sd).powi(2)).ln_1p() - ROUND_BODIES
    }

    const COORDINATES: CovarianceCoordinates = CovarianceCoordinates::CenterVechShape;

    fn world_map(&self, frame: &ObjectFrame) -> Matrix9 {
        covariance::ellipsoid_in_world(self, frame)
    }
}

impl FirstFit for OrientedModel {
    const SEVERAL_STARTS: bool = true;

    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Option<(Self, NormalEquations)> {
        let objective = prepared.objective(noise, outlier_scale);
        Self::screened(prepared, ellipsoid, noise, outlier_scale, context, seed)
            .into_iter()
            .take(FOLLOWED_STARTS)
            .filter_map(|(start, _)| minimise(start, FROM_START, |body| objective.linearise(body), BodyModel::retract))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
    }

    fn screened(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Vec<(Self, NormalEquations)> {
        let objective = prepared.objective(noise, outlier_scale);
        let form = match context.body {
            BodyKind::Superellipsoid(exponent) => Form::Exponent(exponent),
            BodyKind::Cylinder => Form::Cylinder,
            BodyKind::Cuboid | BodyKind::Ellipsoid => Form::Exponent(1.0),
        };
        let centers = centers_from_size(prepared);
        let starts = oriented_starts(ellipsoid, form, &prepared.prior, &centers, seed);
        let descend = |start: Self| minimise(start, SCREENING, |body| objective.linearise(body), BodyModel::retract);
        let mut screened: Vec<_> = starts.into_iter().filter_map(descend).collect();
        screened.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        screened
    }

    fn of_body(body: &Body, frame: &ObjectFrame) -> Option<Self> {
        let form = match body {
            Body::Ellipsoid(_) => return None,
            Body::Cuboid(_) => Form::Exponent(1.0),
            Body::Cylinder(_) => Form::Cylinder,
            Body::Superellipsoid(body) => Form::Exponent(body.support_exponent),
        };
        let center = (body.center() - frame.origin) / frame.unit;
        Some(Self::new(center, *body.rotation().matrix(), body.half_extents() / frame.unit, form))
    }

    fn body_in_world(&self, frame: &ObjectFrame, kind: BodyKind) -> Body {
        let center: Point3<f64> = frame.point_in_world(self.center());
        let semi_axes = self.semi_axes() * frame.unit;
        let rotation = Rotation3::from_matrix_unchecked(*self.axes());
        match self.form() {
            Form::Cylinder => Body::Cylinder(Cylinder::from_half_extents(center, semi_axes, rotation)),
            Form::Exponent(_) if kind == BodyKind::Cuboid => {
                Body::Cuboid(Cuboid { center, half_extents: semi_axes, rotation })
            }
            Form::Exponent(support_exponent) => {
                Body::Superellipsoid(Superellipsoid { center, semi_axes, rotation, support_exponent })
            }
        }
    }

    fn log_upright_density(tilt_sd: f64, _shape_sd: f64) -> f64 {
        // One sixth of a Gaussian about each end of each axis over `1 / (4 pi)`.
        -(3.0 * tilt_sd * tilt_sd).ln()
    }

    const COORDINATES: CovarianceCoordinates = CovarianceCoordinates::CenterRotationLogAxes;

    fn world_map(&self, frame: &ObjectFrame) -> Matrix9 {
        covariance::oriented_in_world(frame)
    }
}

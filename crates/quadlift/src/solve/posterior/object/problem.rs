//! The estimation problem of one object: measurements and priors in its own frame, and the first ellipsoid.

use nalgebra::{Unit, Vector3};

use super::cue_starts::{ellipsoids_from_cues, frame_from_cues, frame_from_size};
use super::objective::Objective;
use super::prior::{ObjectPrior, TILT_SD, object_prior};
use super::starts::{centers_from_size, ellipsoid_from_quadric, unit_sphere, upright_ellipsoids};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::BodyKind;
use crate::optimize::minimize::{Stop, minimize};
use crate::scene::ObjectViews;
use crate::solve::closed_form::planes::planes_in_frame;
use crate::solve::conditioning::ObjectFrame;
use crate::solve::estimate::{Estimate, Status};
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::measurements::Measurements;
use crate::solve::posterior::shared::cue_scales::CueScales;
use crate::solve::posterior::shared::poses::PoseCorrections;

/// From a start: many steps, no need to end exactly.
pub(crate) const FROM_START: Stop = Stop { evaluations: 40, min_predicted_decrease: 1e-2 };

/// An object's measurements and priors in its own frame.
#[derive(Clone)]
pub(crate) struct ObjectProblem {
    pub views: ObjectViews,
    /// The fitted kind of body.
    pub kind: BodyKind,
    pub measurements: Measurements,
    pub prior: ObjectPrior,
    heavy_tails: bool,
}

impl ObjectProblem {
    /// Builds the object frame and priors; otherwise an estimate with the reason as status.
    pub(crate) fn new(views: ObjectViews, kind: BodyKind, context: &PosteriorContext) -> Result<Self, Box<Estimate>> {
        let failed = |status| Box::new(Estimate::failed(views.object_index, views.category_index, status));
        let several = views.views.len() >= 2;
        let frame = (several.then(|| ObjectFrame::from_views(&views.views)).flatten())
            .or_else(|| frame_from_cues(&views.views))
            .or_else(|| frame_from_size(&views.views, context.standing_size(&views)?));
        let status = if several { Status::Degenerate } else { Status::TooFewViews };
        let frame = frame.ok_or_else(|| failed(status))?;
        Ok(Self::in_frame(views, frame, kind, context))
    }

    /// The same in a given frame.
    pub(crate) fn in_frame(views: ObjectViews, frame: ObjectFrame, kind: BodyKind, context: &PosteriorContext) -> Self {
        let prior = object_prior(&views, &frame, kind, context);
        let measurements = measured(&views, frame, kind, &prior);
        Self { views, kind, measurements, prior, heavy_tails: context.options.heavy_tails }
    }

    /// The same object with corrected cameras.
    pub(crate) fn with_corrected_cameras(&self, poses: &PoseCorrections) -> Self {
        self.with_changed_views(|views| poses.apply(views))
    }

    /// The same object with scaled cues.
    pub(crate) fn with_scaled_cues(&self, scales: &CueScales) -> Self {
        self.with_changed_views(|views| scales.apply(views))
    }

    fn with_changed_views(&self, change: impl FnOnce(&mut ObjectViews)) -> Self {
        let mut views = self.views.clone();
        change(&mut views);
        let mut measurements = measured(&views, self.measurements.frame, self.kind, &self.prior);
        measurements.look_as(&self.measurements);
        Self { views, measurements, prior: self.prior.clone(), ..*self }
    }

    /// The same object with some axis of it along `up`; as it is where its category says how upright it is.
    pub(crate) fn standing(&self, up: &Unit<Vector3<f64>>) -> Self {
        let mut standing = self.clone();
        if standing.prior.upright_weight <= 0.0 {
            standing.prior.up = Some(self.measurements.frame.direction_from_world(up));
            standing.prior.upright_weight = 1.0 / TILT_SD;
        }
        standing
    }

    /// The objective of the object, not on any ground plane.
    pub(crate) fn objective<'a>(&'a self, noise: &'a NoiseLevels, outlier_scale: Option<f64>) -> Objective<'a> {
        Objective {
            measurements: &self.measurements,
            prior: &self.prior,
            ground: None,
            noise,
            heavy_tails: self.heavy_tails,
            outlier_scale,
            smooth: false,
        }
    }

    /// The best ellipsoid over its starts, without outlier rejection.
    pub(crate) fn fit_ellipsoid(&self, noise: &NoiseLevels) -> Option<EllipsoidModel> {
        let objective = Objective { smooth: true, ..self.objective(noise, None) };
        let linear = planes_in_frame(&self.views.views, &self.measurements.frame)
            .ok()
            .and_then(|quadric| ellipsoid_from_quadric(&quadric));
        let sphere = unit_sphere(Vector3::zeros());
        let upright = upright_ellipsoids(
            &sphere,
            &self.prior,
            &centers_from_size(&self.views, &self.measurements.frame, &self.prior),
        );
        [Some(sphere), linear]
            .into_iter()
            .flatten()
            .chain(upright)
            .chain(ellipsoids_from_cues(&self.views.views, &self.measurements.frame))
            .filter_map(|start| minimize(start, FROM_START, |body| objective.linearize(body), BodyModel::retract))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
            .map(|(body, _)| body)
    }
}

/// The measurements for a body of a kind. Its axes are length, width and height where the category has a size.
fn measured(views: &ObjectViews, frame: ObjectFrame, kind: BodyKind, prior: &ObjectPrior) -> Measurements {
    Measurements::new(frame, &views.views, kind != BodyKind::Ellipsoid, prior.log_size.is_some())
}

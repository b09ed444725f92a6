//! One object before it is fitted: its measurements and priors in its own frame, and the first ellipsoid.

use std::sync::Arc;

use nalgebra::{Unit, Vector3};

use super::super::conditioning::ObjectFrame;
use super::super::estimate::{Estimate, Status};
use super::super::options::BodyKind;
use super::super::planes::planes_in_frame;
use super::MapContext;
use super::body_model::{BodyModel, EllipsoidModel};
use super::first_fit::TURNED_STARTS;
use super::fit::Fit;
use super::levenberg_marquardt::{Stop, minimise};
use super::measurements::Measurements;
use super::noise::NoiseLevels;
use super::objective::{ObjectPrior, Objective};
use super::poses::PoseCorrections;
use super::starts::{centers_from_size, ellipsoid_from_quadric, unit_sphere, upright_ellipsoids};
use crate::scene::{ObjectViews, View};

/// From a start: many steps, no need to end exactly.
pub(super) const FROM_START: Stop = Stop { evaluations: 40, promised_decrease: 1e-2 };

/// An object's measurements and priors in its own frame.
#[derive(Clone)]
pub(super) struct Prepared {
    pub views: ObjectViews,
    /// The kind of body that is fitted.
    pub kind: BodyKind,
    pub measurements: Measurements,
    pub prior: ObjectPrior,
    heavy_tails: bool,
}

impl Prepared {
    /// Builds the object's frame and priors; an estimate that says why when there is none.
    pub(super) fn new(views: ObjectViews, kind: BodyKind, context: &MapContext) -> Result<Self, Box<Estimate>> {
        let failed = |status| Box::new(Estimate::failed(views.object_index, views.category_index, status));
        if views.views.len() < 2 {
            return Err(failed(Status::TooFewViews));
        }
        let frame = ObjectFrame::from_views(&views.views).ok_or_else(|| failed(Status::Degenerate))?;
        Ok(Self::in_frame(views, frame, kind, context))
    }

    /// The same in a frame that is known.
    pub(super) fn in_frame(views: ObjectViews, frame: ObjectFrame, kind: BodyKind, context: &MapContext) -> Self {
        let measurements = Measurements::new(frame, &views.views, kind != BodyKind::Ellipsoid);
        let prior = object_prior(&views, &frame, kind, context);
        Self { views, kind, measurements, prior, heavy_tails: context.options.heavy_tails }
    }

    /// The same object seen by cameras that have been moved.
    pub(super) fn with_poses(&self, corrections: &PoseCorrections) -> Self {
        let mut views = self.views.clone();
        corrections.apply(&mut views);
        let measurements = Measurements::new(self.measurements.frame, &views.views, self.kind != BodyKind::Ellipsoid);
        Self { views, measurements, prior: self.prior.clone(), ..*self }
    }

    /// The first fit: from the starts, and again without the outliers where its residuals show some.
    pub(super) fn first_fit(self, noise: &NoiseLevels, context: &MapContext) -> Result<Fit, Box<Estimate>> {
        let failed = Box::new(Estimate::failed(self.views.object_index, self.views.category_index, Status::Diverged));
        let seed = self.seed(context);
        let ellipsoid = self.fit_ellipsoid(noise).ok_or_else(|| failed.clone())?;
        let (body, equations) = self.started_at(&ellipsoid, noise, None, seed, TURNED_STARTS).ok_or(failed)?;
        let fit = Fit {
            prepared: Arc::new(self),
            ellipsoid,
            body,
            equations,
            outlier_scale: None,
            ground: None,
            converged: false,
        };
        Ok(if context.options.robust { fit.without_outliers(noise, context).unwrap_or(fit) } else { fit })
    }

    /// Seed of what is drawn for this object: it comes from the directions in which its cameras look, so that it is the
    /// same whatever the object's name is, whatever other objects there are, in which order the frames come, which way up
    /// their images are, and where the origin of the world and what its unit is.
    pub(super) fn seed(&self, context: &MapContext) -> u64 {
        let of_view = |view: &View| hash(view.projection.m().row(2).iter().copied());
        context.seed ^ self.views.views.iter().map(of_view).fold(0, u64::wrapping_add)
    }

    /// The objective of the object, not on any ground plane.
    pub(super) fn objective<'a>(&'a self, noise: &'a NoiseLevels, outlier_scale: Option<f64>) -> Objective<'a> {
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

    /// The best ellipsoid over its starts, all views believed.
    pub(super) fn fit_ellipsoid(&self, noise: &NoiseLevels) -> Option<EllipsoidModel> {
        let objective = Objective { smooth: true, ..self.objective(noise, None) };
        let linear = planes_in_frame(&self.views.views, &self.measurements.frame)
            .ok()
            .and_then(|quadric| ellipsoid_from_quadric(&quadric));
        let sphere = unit_sphere(Vector3::zeros());
        let upright = upright_ellipsoids(&sphere, &self.prior, &centers_from_size(self));
        [Some(sphere), linear]
            .into_iter()
            .flatten()
            .chain(upright)
            .filter_map(|start| minimise(start, FROM_START, |body| objective.linearise(body), BodyModel::retract))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
            .map(|(body, _)| body)
    }
}

/// A hash of numbers in the manner of FNV-1a, by 64 bits; it will not change, so that the same seed goes on to give the
/// same results.
fn hash(numbers: impl Iterator<Item = f64>) -> u64 {
    let mixed = |hash: u64| hash.wrapping_mul(0x100_0000_01B3) ^ (hash >> 29);
    numbers.fold(0xCBF2_9CE4_8422_2325, |hash, number| mixed(hash ^ number.to_bits()))
}

/// The priors of an object in its frame.
fn object_prior(views: &ObjectViews, frame: &ObjectFrame, kind: BodyKind, context: &MapContext) -> ObjectPrior {
    let mut prior = ObjectPrior { shape_weight: 1.0 / context.options.shape_sd, ..Default::default() };
    prior.axes_are_named = kind != BodyKind::Ellipsoid;
    let name = views.category_index.map_or("", |index| context.categories[index].as_str());
    prior.on_ground = context.options.ground_plane && context.up.is_some();
    let Some(category) = context.options.priors.of(name) else { return prior };
    prior.on_ground |= category.on_ground && context.up.is_some();
    if let (Some(up), Some(sd)) = (context.up, category.upright_sd) {
        prior.up = Some(up.into_inner());
        prior.upright_weight = 1.0 / sd;
    }
    if let Some(size) = category.size {
        prior.log_size =
            Some(std::array::from_fn(|k| ((0.5 * size.mean[k] / frame.unit).ln(), size.mean[k] / size.sd[k])));
        if prior.up.is_none() {
            prior.up = context.up.map(Unit::into_inner);
        }
        // The category's size takes the place of the general shape prior.
        prior.shape_weight = 0.0;
    }
    prior
}

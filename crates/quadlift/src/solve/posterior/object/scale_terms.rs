//! What the cues of an object say about the constants of their sources.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::fit::Fit;
use crate::body_model::BodyModel;
use crate::geometry::linalg::invert_spd;
use crate::scene::{DepthScale, View};
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::residuals::cues::MeasuredCue;
use crate::solve::posterior::shared::cue_scales::{Constant, CueScales, ObjectTerms, Ratios, Term};

impl Fit {
    /// The terms of the constants at this fit; `None` without cues or where the normal equations are singular.
    pub(crate) fn scale_terms(&self, scales: &CueScales, noise: &NoiseLevels) -> Option<ObjectTerms> {
        let measurements = &self.problem.measurements;
        if measurements.cues.is_empty() {
            return None;
        }
        let objective = self.objective(noise, self.outlier_scale);
        // Under these noise levels: what the scales and the object share must be less than what each has.
        let equations = objective.linearize(&self.body)?;
        let covariance = invert_spd(&equations.hessian())?;
        let weights = noise.weights(measurements.views.len());
        let mut terms: BTreeMap<Constant, Term> = BTreeMap::new();
        objective.each_cue(&self.body, |cue, rows, _, loss_weight| {
            let view = &self.problem.views.views[cue.view];
            let mut axis = 0;
            let by_shift = self.derivative_by_shift(cue, view, scales);
            for row in rows {
                let whitening = cue.whitening(noise, row.group);
                let weight = loss_weight * weights.of(row.group);
                let constants = self.constants(view, row.group, by_shift, &mut axis);
                for (k, &(constant, derivative)) in constants.iter().enumerate() {
                    let derivative = -whitening * derivative;
                    let term = terms.entry(constant).or_default();
                    term.information += weight * derivative * derivative;
                    term.gradient += weight * derivative * row.residual;
                    term.coupling += nalgebra::SVector::from(row.row) * (weight * derivative);
                    term.with.resize(k, (constant, 0.0));
                    for (with, (other, by_other)) in term.with.iter_mut().zip(&constants) {
                        *with = (*other, with.1 - weight * derivative * whitening * by_other);
                    }
                }
            }
        });
        let step = -(covariance * equations.gradient());
        (!terms.is_empty()).then_some(ObjectTerms { terms, covariance, step, cost: equations.cost })
    }

    /// The same object after this change of the scales, moved as the scales predict; of its own step to its minimum it makes this share.
    /// `None` where it would not be a body any more.
    pub(crate) fn moved_with(
        &self,
        change: &CueScales,
        share: f64,
        terms: &ObjectTerms,
        noise: &NoiseLevels,
    ) -> Option<Self> {
        let problem = Arc::new(self.problem.with_scaled_cues(change));
        let body = self.body.retract(&change.step_of(terms, share))?;
        let moved = Self { problem, body, ..self.clone() };
        let equations = moved.objective(noise, self.outlier_scale).linearize(&moved.body)?;
        Some(Self { equations, ..moved })
    }

    /// Standard deviation of the distance from the nearest camera, along the ray, relative to that distance.
    pub(crate) fn relative_distance_sd(&self) -> Option<f64> {
        let covariance = invert_spd(&self.equations.hessian())?;
        let frame = &self.problem.measurements.frame;
        let center = frame.point_in_world(self.body.center());
        let rays = self.problem.views.views.iter().filter_map(|view| Some(center - view.projection.center_in_world()?));
        let nearest = rays.min_by(|a, b| a.norm().total_cmp(&b.norm()))?;
        let along = frame.direction_from_world(&nearest.normalize());
        let variance = (along.transpose() * covariance.fixed_view::<3, 3>(0, 0) * along)[0];
        Some(variance.sqrt() * frame.unit / nearest.norm())
    }

    /// Measured against predicted lengths of other views' cues, by their constants, if this body were theirs.
    pub(crate) fn ratios(&self, views: &[View], noise: &NoiseLevels, ratios: &mut Ratios) {
        let frame = &self.problem.measurements.frame;
        let world = self.body.body_in_world(frame);
        let mut rows = Vec::new();
        for view in views.iter().filter(|view| !view.cues.is_empty()) {
            let p = frame.local_projection(&view.projection);
            for mut cue in MeasuredCue::of_view(view, 0, frame, &p, self.problem.prior.log_size.is_some()) {
                cue.look_at(&self.body, &world, view, frame);
                cue.rows(&self.body, noise, &mut rows);
                let mut axis = 0;
                for row in &rows {
                    for (constant, _) in self.constants(view, row.group, None, &mut axis) {
                        let ratio = row.residual / cue.whitening(noise, row.group);
                        ratios.logs.entry(constant).or_default().push(ratio);
                    }
                }
                let scaled = view.cues.depth.filter(|_| view.depth_scale != DepthScale::Known);
                if let (Some(depth), Some(predicted)) = (scaled, cue.predicted_depth(&self.body)) {
                    ratios.depths.entry(depth.source).or_default().push(predicted * frame.unit);
                }
            }
        }
    }

    /// The derivative of the logarithm of the expected measurement by the shift of its source; `None` for cues without one, 0 where
    /// the body is behind the camera.
    fn derivative_by_shift(&self, cue: &MeasuredCue, view: &View, scales: &CueScales) -> Option<f64> {
        let reference = scales.reference(view.cues.depth.filter(|_| cue.is_depth())?.source)?;
        let unit = self.problem.measurements.frame.unit;
        let of_depth = |depth: f64| (reference - depth * unit) / (depth * unit + view.depth_shift);
        Some(cue.predicted_depth(&self.body).map_or(0.0, of_depth))
    }

    /// The constants that a residual of a view's cue contains, those of the whole source first, with the derivatives of the logarithm
    /// of the expected measurement; `axis` counts those of sizes.
    fn constants(
        &self,
        view: &View,
        group: NoiseGroup,
        by_shift: Option<f64>,
        axis: &mut usize,
    ) -> Vec<(Constant, f64)> {
        let source = || view.cues.box3d.and_then(|measured| measured.source);
        match group {
            NoiseGroup::Depth if view.depth_scale != DepthScale::Known => {
                let source = view.cues.depth.and_then(|depth| depth.source);
                let of_frame = Constant::DepthOfFrame(source, view.frame_index);
                std::iter::once((Constant::Depth(source), 1.0))
                    .chain(by_shift.map(|derivative| (Constant::DepthShift(source), derivative)))
                    .chain((view.depth_scale == DepthScale::Frame).then_some((of_frame, 1.0)))
                    .collect()
            }
            NoiseGroup::BoxDistance => vec![(Constant::Distance(source()), 1.0)],
            NoiseGroup::BoxSize => {
                *axis += 1;
                let category = self.problem.views.category_index;
                let of_all = Constant::Sizes(source(), category);
                vec![(of_all, 1.0), (Constant::Size(source(), category, *axis - 1), 1.0)]
            }
            _ => Vec::new(),
        }
    }
}

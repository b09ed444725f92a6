//! What the cues of an object say about the constants of their sources.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::fit::Fit;
use crate::body_model::BodyModel;
use crate::geometry::linalg::invert_spd;
use crate::scene::{DepthScale, View};
use crate::solve::map::noise::groups::NoiseGroup;
use crate::solve::map::noise::levels::NoiseLevels;
use crate::solve::map::residuals::cues::MeasuredCue;
use crate::solve::map::shared::cue_scales::{Constant, CueScales, ObjectTerms, Term};

impl Fit {
    /// The terms of the constants at this fit; `None` without cues or where the normal equations are singular.
    pub(crate) fn scale_terms(&self, noise: &NoiseLevels) -> Option<ObjectTerms> {
        let measurements = &self.problem.measurements;
        if measurements.cues.is_empty() {
            return None;
        }
        let objective = self.objective(noise, self.outlier_scale);
        // Under these noise levels: what the scales and the object share must be less than what each has.
        let equations = objective.linearise(&self.body)?;
        let covariance = invert_spd(&equations.hessian())?;
        let weights = noise.weights(measurements.views.len());
        let mut terms: BTreeMap<Constant, Term> = BTreeMap::new();
        objective.each_cue(&self.body, |cue, rows, _, loss_weight| {
            let view = &self.problem.views.views[cue.view];
            let mut axis = 0;
            for row in rows {
                let derivative = -cue.whitening(noise, row.group);
                let weight = loss_weight * weights.of(row.group);
                for constant in self.constants(view, row.group, &mut axis) {
                    let term = terms.entry(constant).or_default();
                    term.information += weight * derivative * derivative;
                    term.gradient += weight * derivative * row.residual;
                    term.coupling += nalgebra::SVector::from(row.row) * (weight * derivative);
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
        let equations = moved.objective(noise, self.outlier_scale).linearise(&moved.body)?;
        Some(Self { equations, ..moved })
    }

    /// Standard deviation of the distance from the nearest camera, along the ray, relative to that distance.
    pub(crate) fn relative_distance_sd(&self) -> Option<f64> {
        let covariance = invert_spd(&self.equations.hessian())?;
        let frame = &self.problem.measurements.frame;
        let center = frame.point_in_world(self.body.center());
        let rays = self.problem.views.views.iter().filter_map(|view| Some(center - view.projection.center_in_world()?));
        let nearest = rays.min_by(|a, b| a.norm().total_cmp(&b.norm()))?;
        let along = nearest.normalize();
        let variance = (along.transpose() * covariance.fixed_view::<3, 3>(0, 0) * along)[0];
        Some(variance.sqrt() * frame.unit / nearest.norm())
    }

    /// Logarithms of measured over predicted lengths of other views' cues, by their constants, if this body were theirs.
    pub(crate) fn log_ratios(&self, views: &[View], noise: &NoiseLevels, ratios: &mut BTreeMap<Constant, Vec<f64>>) {
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
                    for constant in self.constants(view, row.group, &mut axis) {
                        ratios.entry(constant).or_default().push(row.residual / cue.whitening(noise, row.group));
                    }
                }
            }
        }
    }

    /// The constants that a residual of a view's cue contains; `axis` counts those of sizes.
    fn constants(&self, view: &View, group: NoiseGroup, axis: &mut usize) -> impl Iterator<Item = Constant> + use<> {
        let source = || view.cues.box3d.and_then(|measured| measured.source);
        let (first, second) = match group {
            NoiseGroup::Depth => {
                let source = view.cues.depth.and_then(|depth| depth.source);
                let of_frame = Constant::DepthOfFrame(source, view.frame_index);
                let of_source = Constant::Depth(source);
                (
                    (view.depth_scale != DepthScale::Known).then_some(of_source),
                    (view.depth_scale == DepthScale::Frame).then_some(of_frame),
                )
            }
            NoiseGroup::BoxDistance => (Some(Constant::Distance(source())), None),
            NoiseGroup::BoxSize => {
                *axis += 1;
                let category = self.problem.views.category_index;
                let of_all = Constant::Sizes(source(), category);
                (Some(Constant::Size(source(), category, *axis - 1)), Some(of_all))
            }
            _ => (None, None),
        };
        first.into_iter().chain(second)
    }
}

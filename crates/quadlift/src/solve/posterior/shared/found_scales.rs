//! What is found about the sources of cues, as it is reported: factors of lengths and shifts of depths with their standard deviations.

use super::cue_scales::{Constant, CueScales};
use crate::solve::cue_scale::{CueScale, DepthShift, ScaledQuantity};

/// A constant of a source, with what all of the source share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FoundScale {
    pub constant: Constant,
    /// Logarithm of the factor of measured to true lengths, and its standard deviation.
    pub log_factor: f64,
    pub log_sd: f64,
    /// For depths, what is added to the true depth times the factor, in the source's lengths, and its standard deviation; `None` where
    /// no shift is estimated.
    pub shift: Option<(f64, f64)>,
}

impl FoundScale {
    /// As it is reported; `None` for a part of others.
    pub(crate) fn report(self) -> Option<CueScale> {
        let (quantity, source) = match self.constant {
            Constant::Depth(source) => (ScaledQuantity::Depth, source),
            Constant::DepthOfFrame(source, frame) => (ScaledQuantity::DepthOfFrame { frame }, source),
            Constant::Distance(source) => (ScaledQuantity::BoxDistance, source),
            Constant::Sizes(..) | Constant::DepthShift(_) => return None,
            Constant::Size(source, category, axis) => (ScaledQuantity::BoxSize { category, axis }, source),
        };
        let shift = self.shift.map(|(value, sd)| DepthShift { value, sd });
        Some(CueScale { quantity, source, factor: self.log_factor.exp(), log_sd: self.log_sd, shift })
    }
}

impl CueScales {
    /// The constants as they are reported; the shift of depths is with their scales.
    pub(crate) fn found(&self) -> impl Iterator<Item = FoundScale> {
        self.constants().map(|constant| {
            let (shared, shift) = match constant {
                Constant::Depth(source) => (None, self.reference(source).zip(Some(Constant::DepthShift(source)))),
                Constant::DepthOfFrame(source, _) => {
                    (constant.of_all(), self.reference(source).zip(Some(Constant::DepthShift(source))))
                }
                _ => (constant.of_all(), None),
            };
            let scales = std::iter::once(constant).chain(shared);
            let by_scale: Vec<(Constant, f64)> = scales.map(|scale| (scale, 1.0)).collect();
            let log_scale: f64 = by_scale.iter().map(|(scale, _)| self.value(*scale)).sum();
            let Some((reference, of_shift)) = shift else {
                return FoundScale { constant, log_factor: log_scale, log_sd: self.sd(&by_scale), shift: None };
            };
            // Measured: exp(scale - shift) (depth + reference (exp(shift) - 1)).
            let log_factor = log_scale - self.value(of_shift);
            let by_factor: Vec<_> = by_scale.iter().copied().chain([(of_shift, -1.0)]).collect();
            let shift = log_factor.exp() * reference * self.value(of_shift).exp_m1();
            let scales = by_scale.iter().map(|(scale, _)| (*scale, shift));
            let by_shift: Vec<_> = scales.chain([(of_shift, log_factor.exp() * reference)]).collect();
            FoundScale { constant, log_factor, log_sd: self.sd(&by_factor), shift: Some((shift, self.sd(&by_shift))) }
        })
    }

    /// Standard deviation of a sum of constants with these factors.
    fn sd(&self, factors: &[(Constant, f64)]) -> f64 {
        let products = factors.iter().flat_map(|a| factors.iter().map(move |b| (a, b)));
        let variance: f64 = products.map(|(a, b)| a.1 * b.1 * self.covariance_of(a.0, b.0)).sum();
        variance.max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nalgebra::SVector;

    use super::*;
    use crate::scene::{Cues, DepthCue, DepthScale, ObjectViews, View};
    use crate::solve::estimate::Matrix9;
    use crate::solve::posterior::shared::cue_scales::{ObjectTerms, Ratios, Term};

    const SOURCE: Option<u32> = Some(2);

    /// Objects of one view each at these depths, all exactly known, whose measured depths are off by `errors` (logarithms).
    fn objects(scales: &CueScales, depths: &[f64], errors: impl Fn(f64) -> f64) -> Vec<ObjectTerms> {
        let reference = scales.reference(SOURCE).unwrap();
        let of_depth = |&depth: &f64| {
            let (weight, by_shift) = (1e4, reference / depth - 1.0);
            let term = |derivative: f64, with: Vec<(Constant, f64)>| Term {
                information: weight * derivative * derivative,
                gradient: -weight * derivative * errors(depth),
                coupling: SVector::zeros(),
                with,
            };
            let terms = BTreeMap::from([
                (Constant::Depth(SOURCE), term(1.0, Vec::new())),
                (Constant::DepthShift(SOURCE), term(by_shift, vec![(Constant::Depth(SOURCE), weight * by_shift)])),
            ]);
            ObjectTerms { terms, covariance: Matrix9::identity(), step: SVector::zeros(), cost: 0.0 }
        };
        depths.iter().map(of_depth).collect()
    }

    /// The view of an object at this measured depth, with the scales taken out.
    fn corrected(scales: &CueScales, measured: f64, depth_scale: DepthScale) -> View {
        let projection = crate::geometry::Projection::from_matrix(nalgebra::Matrix3x4::identity()).unwrap();
        let bounding_box = crate::geometry::BoundingBox::new([0.0, 0.0, 1.0, 1.0]).unwrap();
        let depth = Some(DepthCue { median: measured, sd: Some(0.1 * measured), source: SOURCE });
        let cues = Cues { depth, box3d: None };
        let views = vec![View { cues, depth_scale, ..View::from_box(projection, bounding_box) }];
        let mut object = ObjectViews { object_index: 0, category_index: None, views };
        scales.apply(&mut object);
        object.views.remove(0)
    }

    #[test]
    fn near_and_far_depths_tell_the_factor_and_the_shift() {
        let depths = [4.0, 8.0, 10.0, 20.0, 40.0];
        let measured = |depth: f64| 1.1 * depth + 0.5;
        let ratios = Ratios { depths: BTreeMap::from([(SOURCE, depths.to_vec())]), ..Default::default() };
        let mut scales = CueScales::of_medians(ratios);
        assert_eq!(scales.reference(SOURCE), Some(10.0));
        // Steps from no shift: what is left of the errors is that of the corrected measurements.
        for _ in 0..20 {
            let left = |depth: f64| {
                let view = corrected(&scales, measured(depth), DepthScale::Source);
                (view.cues.depth.unwrap().median / (depth + view.depth_shift)).ln()
            };
            let change = {
                let objects = objects(&scales, &depths, left);
                scales.clone().step(objects.iter()).unwrap()
            };
            scales = scales.changed(&change);
        }
        scales.step(objects(&scales.clone(), &depths, |_| 0.0).iter()).unwrap();
        let found = scales.found().next().unwrap();
        let (shift, sd) = found.shift.unwrap();
        assert!((found.log_factor.exp() - 1.1).abs() < 0.01 && (shift - 0.5).abs() < 0.05, "{found:?}");
        assert!(found.log_sd < 0.02 && sd < 0.2, "{found:?}");
        // The mean of the measurements of a depth is what it was made of, and a view is corrected to it.
        for depth in depths {
            let expected = found.log_factor.exp() * depth + shift;
            let view = corrected(&scales, expected, DepthScale::Source);
            let median = view.cues.depth.unwrap().median;
            assert!((median - view.depth_shift - depth).abs() < 1e-9, "{median} {depth}");
            assert!((view.cues.depth.unwrap().sd.unwrap() - 0.1 * median).abs() < 1e-9);
        }
        // Lengths of the world stay as they are.
        let known = corrected(&scales, 7.0, DepthScale::Known);
        assert_eq!((known.cues.depth.unwrap().median, known.depth_shift), (7.0, 0.0));
    }

    #[test]
    fn where_all_depths_are_alike_the_shift_is_open_and_their_scale_is_not() {
        let ratios = Ratios { depths: BTreeMap::from([(SOURCE, vec![10.0; 5])]), ..Default::default() };
        let mut scales = CueScales::of_medians(ratios);
        let alike = objects(&scales, &[10.0; 20], |_| 0.1);
        let change = scales.step(alike.iter()).unwrap();
        scales = scales.changed(&change);
        scales.step(alike.iter()).unwrap();
        let scale = Constant::Depth(SOURCE);
        assert!((scales.value(scale) - 0.1).abs() < 1e-3 && scales.sd(&[(scale, 1.0)]) < 0.01);
        let found = scales.found().next().unwrap();
        let (shift, sd) = found.shift.unwrap();
        // 5 % of 10 in the source's lengths.
        assert!(shift.abs() < 1e-9 && (0.45..0.65).contains(&sd) && found.log_sd > 0.04, "{found:?}");
        // Too few depths have none.
        let few = Ratios { depths: BTreeMap::from([(SOURCE, vec![10.0; 4])]), ..Default::default() };
        assert_eq!(CueScales::of_medians(few).reference(SOURCE), None);
    }
}

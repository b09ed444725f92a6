//! The estimates against the boxes: whether they explain them at all.

use super::cause::{Cause, CauseName};
use super::verdict::Diagnosis;

/// Errors of edges above this, in half sizes of the box, explain any box: half a box (a convention; real detectors in the scenes
/// of the tests have .006 to .09).
const MAX_EDGE_NOISE: f64 = 0.5;

/// Boxes that others do not predict have less than this IoU with the prediction (a convention; clean scenes have .9, GPS poses and
/// partly visible objects .64 to .77)...
const MIN_HELD_OUT_IOU: f64 = 0.2;

/// ...and below this there is a warning.
const GOOD_HELD_OUT_IOU: f64 = 0.75;

impl Diagnosis {
    /// Draws the conclusion from the noise of the edges that a fit needs, in half sizes of the boxes, and from the mean IoU of
    /// boxes that were predicted from other views. Does nothing if the scene is inconsistent anyway.
    pub(crate) fn check_fit(&mut self, edge_noise: Option<f64>, held_out_iou: Option<f64>) {
        let agreement = self.agreement.unwrap_or_default();
        let cause = |name, value| Cause { value: Some(value), ..Cause::unexplained(name, agreement) };
        if !self.consistent {
            return;
        }
        if let Some(noise) = edge_noise.filter(|noise| *noise > MAX_EDGE_NOISE) {
            self.consistent = false;
            self.causes.insert(0, cause(CauseName::EdgeNoise, noise));
        } else if let Some(iou) = held_out_iou.filter(|iou| *iou < GOOD_HELD_OUT_IOU) {
            self.consistent = iou >= MIN_HELD_OUT_IOU;
            // What explains the boxes better says more.
            let place = if self.consistent { self.causes.len() } else { 0 };
            self.causes.insert(place, cause(CauseName::HeldOutViews, iou));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_explains_any_box_explains_none() {
        let of = |noise, iou| {
            let mut diagnosis = Diagnosis::default();
            diagnosis.check_fit(noise, iou);
            (diagnosis.consistent, diagnosis.causes.first().map(|cause| (cause.name, cause.value.unwrap())))
        };
        assert_eq!(of(Some(0.1), Some(0.9)), (true, None));
        assert_eq!(of(None, None), (true, None));
        assert_eq!(of(Some(0.6), Some(0.9)), (false, Some((CauseName::EdgeNoise, 0.6))));
        assert_eq!(of(Some(0.1), Some(0.1)), (false, Some((CauseName::HeldOutViews, 0.1))));
        assert_eq!(of(None, Some(0.5)), (true, Some((CauseName::HeldOutViews, 0.5))));
    }
}

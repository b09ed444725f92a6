//! Errors of masks and ellipses against the true masks, and the figures of a row.

use quadlift::geometry::Ellipse;
use quadlift::metrics::ellipse_iou;
use quadlift_segment::{Mask, Moments, PixelTerm, SegmentStatus, ViewSegmentation};

use crate::scores::{Figure, average, mean};
use crate::table::Cell;

/// Objects whose axes differ by less have no orientation.
const ROUND: f64 = 1.2;

/// Errors of one view.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewErrors {
    mask_iou: f64,
    ellipse_iou: f64,
    /// Angle between the long axes in degrees; none for round objects.
    angle: Option<f64>,
    /// Distance of the centers over the mean semi-axis.
    center: f64,
    /// Absolute logarithm of the ratio of the ellipses' areas.
    log_area: f64,
    fallback: bool,
}

impl ViewErrors {
    /// The errors of a view; none where the true mask has no ellipse.
    pub(super) fn of(view: &ViewSegmentation, truth: &Mask) -> Option<Self> {
        let true_ellipse: Ellipse = Moments::of_mask(truth, PixelTerm::Centers)?.ellipse()?;
        let (axes, found) = (true_ellipse.semi_axes(), view.ellipse.semi_axes());
        let turn = (long_axis(&view.ellipse) - long_axis(&true_ellipse)).rem_euclid(std::f64::consts::PI);
        let angle = turn.min(std::f64::consts::PI - turn).to_degrees();
        Some(Self {
            mask_iou: view.mask.iou(truth),
            ellipse_iou: ellipse_iou(&view.ellipse, &true_ellipse),
            angle: (axes.max() > ROUND * axes.min()).then_some(angle),
            center: (view.ellipse.center() - true_ellipse.center()).norm() / (axes.x * axes.y).sqrt(),
            log_area: ((found.x * found.y) / (axes.x * axes.y)).ln().abs(),
            fallback: matches!(view.status, SegmentStatus::Fallback(_)),
        })
    }
}

/// The direction of the longer axis.
fn long_axis(ellipse: &Ellipse) -> f64 {
    let turned = ellipse.semi_axes().y > ellipse.semi_axes().x;
    if turned { ellipse.angle() + std::f64::consts::FRAC_PI_2 } else { ellipse.angle() }
}

/// Columns of the table of masks, after method and setting.
pub(super) const COLUMNS: [&str; 8] =
    ["mask IoU", "ellipse IoU", "median", "angle [deg]", "center", "log area", "IoU < 0.5", "fell back"];

/// The mean IoU of the ellipses: over the views of each sequence, then over the sequences.
pub(super) fn mean_ellipse_iou(sequences: &[Vec<ViewErrors>]) -> Option<Figure> {
    over_sequences(sequences, |view| view.ellipse_iou)
}

/// The mean error of the angle over all views, degrees.
pub(super) fn mean_angle(sequences: &[Vec<ViewErrors>]) -> Option<f64> {
    mean(&sequences.iter().flatten().filter_map(|view| view.angle).collect::<Vec<_>>())
}

/// The cells of a row: means over sequences, except the median and the angle, which are over views.
pub(super) fn cells(sequences: &[Vec<ViewErrors>]) -> Vec<Cell> {
    let figure = |f: fn(&ViewErrors) -> f64, decimals| match over_sequences(sequences, f) {
        Some(figure) => Cell::number(figure.value, decimals),
        None => Cell::Empty,
    };
    let mut ious: Vec<f64> = sequences.iter().flatten().map(|view| view.ellipse_iou).collect();
    ious.sort_by(f64::total_cmp);
    let number = |x: Option<f64>, decimals| x.map_or(Cell::Empty, |x| Cell::number(x, decimals));
    vec![
        figure(|view| view.mask_iou, 3),
        figure(|view| view.ellipse_iou, 3),
        number(ious.get(ious.len() / 2).copied(), 3),
        number(mean_angle(sequences), 1),
        figure(|view| view.center, 3),
        figure(|view| view.log_area, 3),
        figure(|view| if view.ellipse_iou < 0.5 { 1.0 } else { 0.0 }, 3),
        figure(|view| if view.fallback { 1.0 } else { 0.0 }, 3),
    ]
}

fn over_sequences(sequences: &[Vec<ViewErrors>], f: impl Fn(&ViewErrors) -> f64) -> Option<Figure> {
    let means: Vec<f64> =
        sequences.iter().filter_map(|views| mean(&views.iter().map(&f).collect::<Vec<_>>())).collect();
    // One value for each sequence: the standard error is that of the sequences.
    average(&means.into_iter().map(|value| vec![value]).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(mask: Mask, ellipse: Ellipse) -> ViewSegmentation {
        ViewSegmentation { mask, ellipse, confidence: 1.0, status: SegmentStatus::Ok }
    }

    #[test]
    fn a_turned_ellipse_has_the_error_of_its_turn() {
        let inside = |x: u32, y: u32| {
            let (dx, dy) = (f64::from(x) + 0.5 - 50.0, f64::from(y) + 0.5 - 40.0);
            (dx / 30.0).powi(2) + (dy / 15.0).powi(2) <= 1.0
        };
        let truth = Mask::from_fn(100, 80, inside);
        // The same axes in the other order, turned by 10 degrees beyond the quarter turn.
        let turned = Ellipse::new([50.0, 43.0].into(), [15.0, 30.0].into(), 100f64.to_radians()).unwrap();
        let errors = ViewErrors::of(&view(truth.clone(), turned), &truth).unwrap();
        assert!((errors.angle.unwrap() - 10.0).abs() < 0.05, "{errors:?}");
        assert!((errors.center - 3.0 / 450f64.sqrt()).abs() < 1e-3 && errors.log_area < 5e-3, "{errors:?}");
        assert!(errors.mask_iou == 1.0 && (0.6..0.9).contains(&errors.ellipse_iou), "{errors:?}");
        // A round object has no angle.
        let round = Mask::from_fn(40, 40, |x, y| (f64::from(x) - 19.5).hypot(f64::from(y) - 19.5) < 15.0);
        let errors = ViewErrors::of(&view(Mask::default(), turned), &round).unwrap();
        assert_eq!((errors.angle, errors.mask_iou), (None, 0.0));
    }

    #[test]
    fn sequences_weigh_the_same() {
        let errors = |ellipse_iou| ViewErrors {
            mask_iou: 0.5,
            ellipse_iou,
            angle: Some(4.0),
            center: 0.0,
            log_area: 0.0,
            fallback: false,
        };
        let sequences = [vec![errors(0.9)], vec![errors(0.4), errors(0.6), errors(0.5)]];
        assert!((mean_ellipse_iou(&sequences).unwrap().value - 0.7).abs() < 1e-12);
        assert_eq!(mean_angle(&sequences), Some(4.0));
    }
}

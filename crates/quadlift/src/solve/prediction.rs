//! Prediction of a left-out view by a body: the box, its overlap with the measured one, and the errors of its edges
//! (ours).

use crate::geometry::{Body, BoundingBox, project_bounding_box};
use crate::scene::{BORDER_TOLERANCE_PX, ObjectViews, View, edges_at_border};

/// Error of a prediction ([`Prediction::error`]) above which the view may contradict the others.
pub(crate) const LARGE_ERROR: f64 = 0.2;

/// The prediction of one view of an object from a body that was fitted without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Index of the object in the scene.
    pub object_index: usize,
    /// Index of the frame in the scene.
    pub frame_index: usize,
    /// The measured box, or the box around the measured ellipse, in pixels.
    pub measured: BoundingBox,
    /// The box of the body's outline, in pixels, not cut at the image border; absent if the body is not entirely in
    /// front of the camera.
    pub predicted: Option<BoundingBox>,
    /// Intersection over union of both, in [0, 1]: 0 without a predicted box. Both are clipped at the image border, and
    /// a measured edge that is cut off ([`Prediction::cut_off`]) agrees with every prediction that extends at least to
    /// it.
    pub iou: f64,
    /// Which of the edges `x0, y0, x1, y1` of the measured box lie so near the image border that they only bound the
    /// extent of the object from below.
    pub cut_off: [bool; 4],
    /// Which of the edges are probably hidden by another detection of the frame.
    pub hidden: [bool; 4],
}

impl Prediction {
    /// Compares a body with a view. `border_margin` is [`super::PosteriorOptions::border_margin`]. `None` for a view without
    /// box and ellipse.
    pub(crate) fn new(object_index: usize, view: &View, body: &Body, border_margin: f64) -> Option<Self> {
        let measured = view.measured_box()?;
        let margin = view.image_size.map_or(0.0, |size| border_margin * size.max()).max(BORDER_TOLERANCE_PX);
        let cut_off = edges_at_border(&view.in_image(&measured), view.image_size, margin);
        let predicted = project_bounding_box(&view.projection, body).ok();
        // With lens distortion the image border is not a box in these pixels.
        let image = view.image_size.filter(|_| view.box_in_image.is_none()).map(|size| [0.0, 0.0, size.x, size.y]);
        let iou = predicted.map_or(0.0, |predicted| cut_iou(&measured, &predicted, cut_off, image));
        let frame_index = view.frame_index;
        Some(Self { object_index, frame_index, measured, predicted, iou, cut_off, hidden: view.occluded_edges })
    }

    /// Error of each edge `x0, y0, x1, y1` relative to the mean half size `(w + h) / 4` of the measured box: positive
    /// if the predicted box is larger. Absent for edges that are cut off, and without a predicted box.
    pub(crate) fn edge_errors(&self) -> [Option<f64>; 4] {
        let Some(predicted) = self.predicted else { return [None; 4] };
        let (half_size, measured, predicted) =
            (self.measured.mean_half_size(), self.measured.edges(), predicted.edges());
        std::array::from_fn(|edge| {
            let outwards = if edge < 2 { -1.0 } else { 1.0 };
            (!self.cut_off[edge]).then(|| outwards * (predicted[edge] - measured[edge]) / half_size)
        })
    }

    /// Root mean square of [`Prediction::edge_errors`]; infinite without a predicted box, absent where every edge is cut
    /// off.
    pub(crate) fn error(&self) -> Option<f64> {
        if self.predicted.is_none() {
            return Some(f64::INFINITY);
        }
        let errors = self.edge_errors();
        let count = errors.iter().flatten().count();
        (count > 0).then(|| (errors.iter().flatten().map(|e| e * e).sum::<f64>() / count as f64).sqrt())
    }
}

/// IoU of a measured and a predicted box in an image `[0, 0, width, height]`.
fn cut_iou(measured: &BoundingBox, predicted: &BoundingBox, cut_off: [bool; 4], image: Option<[f64; 4]>) -> f64 {
    let (mut a, mut b) = (measured.edges(), predicted.edges());
    for edge in 0..4 {
        let inwards = if edge < 2 { f64::max } else { f64::min };
        if let Some(image) = image {
            (a[edge], b[edge]) = (inwards(a[edge], image[edge]), inwards(b[edge], image[edge]));
        }
        if cut_off[edge] {
            b[edge] = inwards(a[edge], b[edge]);
        }
    }
    match (BoundingBox::new(a), BoundingBox::new(b)) {
        (Ok(a), Ok(b)) => a.iou(&b),
        // One of them lies outside of the image.
        _ => 0.0,
    }
}

/// Views of one object that are left out together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fold {
    /// Index of the object among the estimates.
    pub object: usize,
    /// The views that are left out, as indices into [`ObjectViews::views`].
    pub views: Vec<usize>,
    /// Whether `posterior` starts from the fit to all views, which is quick, instead of the object's own starts. If several
    /// bodies fit the other views, the left-out ones influence which one is found.
    pub warm_start: bool,
}

/// The predictions of the views of a [`Fold`] from the other views of the object.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct FoldPrediction {
    /// One prediction for each view that was left out and has a box or an ellipse; none if the other views determine no
    /// body.
    pub predictions: Vec<Prediction>,
    /// Number of views used for the body.
    pub fitted_views: usize,
    /// Median over these views of the root mean square edge error ([`Prediction::error`]) that the fit leaves in them; only
    /// where a view that was left out has an error above 0.2, and may contradict the others.
    pub fitted_error: Option<f64>,
}

/// Leaves the views of a fold out, fits the others by `fit` and predicts those left out.
pub(crate) fn predict_fold(
    object: &ObjectViews,
    left_out: &[usize],
    border_margin: f64,
    fit: impl FnOnce(ObjectViews) -> Option<Body>,
) -> FoldPrediction {
    let kept = |(index, view): (usize, &View)| (!left_out.contains(&index)).then_some(*view);
    let views: Vec<View> = object.views.iter().enumerate().filter_map(kept).collect();
    let fitted_views = views.len();
    let ObjectViews { object_index, category_index, .. } = *object;
    let Some(body) = fit(ObjectViews { object_index, category_index, views: views.clone() }) else {
        return FoldPrediction { fitted_views, ..Default::default() };
    };
    let compare = |view: &View, body: &Body| Prediction::new(object_index, view, body, border_margin);
    let predictions: Vec<Prediction> =
        left_out.iter().filter_map(|&index| compare(object.views.get(index)?, &body)).collect();
    let mut fitted_error = None;
    if predictions.iter().filter_map(Prediction::error).any(|error| error > LARGE_ERROR) {
        let mut errors: Vec<f64> = views.iter().filter_map(|view| compare(view, &body)?.error()).collect();
        errors.sort_by(f64::total_cmp);
        fitted_error = errors.get(errors.len() / 2).copied();
    }
    FoldPrediction { predictions, fitted_views, fitted_error }
}

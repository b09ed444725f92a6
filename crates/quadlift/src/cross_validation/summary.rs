//! Summaries of predictions of single views for objects and the scene.

use super::{CrossValidationOptions, Extent};
use crate::optimize::median::median;
use crate::solve::{Estimate, Fold, FoldPrediction, LARGE_ERROR, Prediction};
use crate::sorting::StableSort;

/// Predictions of left-out views of a scene, summarized.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CrossValidation {
    /// How much was cross-validated.
    pub extent: Extent,
    /// The objects with left-out views, in the order of the estimates. With [`Extent::Sample`] only some of their views
    /// are left out.
    pub objects: Vec<ObjectCrossValidation>,
}

/// Predictions of left-out views of an object, summarized.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectCrossValidation {
    /// Index of its estimate in [`crate::solve::SceneSolution::estimates`].
    pub estimate_index: usize,
    /// The predictions, in the order of the object's views.
    pub predictions: Vec<Prediction>,
    /// Left-out views that could not be predicted, because the others determine no body.
    pub not_predicted: usize,
    /// The outlier view, which contradicts the others, as an index into `predictions`.
    pub odd: Option<usize>,
}

/// Minimum error of the prediction of an outlier view, relative to the residuals of the used views.
const ODD_RATIO: f64 = 5.0;

/// Parameters of a body.
const PARAMETERS: f64 = 9.0;

/// Error below which a fit counts as exact.
const EXACT: f64 = 1e-3;

impl ObjectCrossValidation {
    /// Mean IoU of the predicted and the measured boxes of the left-out views; absent if none could be predicted.
    pub fn iou(&self) -> Option<f64> {
        mean(self.predictions.iter().map(|prediction| prediction.iou))
    }

    /// The prediction of the view in a frame.
    pub fn of_frame(&self, frame_index: usize) -> Option<&Prediction> {
        self.predictions.iter().find(|prediction| prediction.frame_index == frame_index)
    }

    /// Median of the errors of the predicted edges (`Prediction::edge_errors`), without their signs.
    pub fn edge_error(&self) -> Option<f64> {
        median_edge_error(self.predictions.iter())
    }

    /// The outlier view: a fit to the other views agrees with each of them much better than with it. This needs at
    /// least four views; the worst of several is reported.
    pub fn suspect_view(&self) -> Option<&Prediction> {
        self.predictions.get(self.odd?)
    }
}

impl CrossValidation {
    /// Mean IoU of the predicted and the measured boxes: the mean over the objects of [`ObjectCrossValidation::iou`], or
    /// over the views of a sample.
    pub fn iou(&self) -> Option<f64> {
        match self.extent {
            Extent::All => mean(self.objects.iter().filter_map(ObjectCrossValidation::iou)),
            _ => mean(self.predictions().map(|prediction| prediction.iou)),
        }
    }

    /// Median of the errors of the predicted edges (`Prediction::edge_errors`), without their signs.
    pub fn edge_error(&self) -> Option<f64> {
        median_edge_error(self.predictions())
    }

    /// All predictions, in the order of the objects and their views.
    pub fn predictions(&self) -> impl Iterator<Item = &Prediction> {
        self.objects.iter().flat_map(|object| &object.predictions)
    }

    /// What is known of the object of an estimate, by the estimate's index.
    pub fn of_estimate(&self, index: usize) -> Option<&ObjectCrossValidation> {
        let position = self.objects.binary_search_by_key(&index, |object| object.estimate_index).ok()?;
        Some(&self.objects[position])
    }
}

/// Sorts the predictions by object; `folds` are in the order of the objects.
pub(crate) fn summarize(
    estimates: &[Estimate],
    folds: &[Fold],
    predicted: Vec<FoldPrediction>,
    options: &CrossValidationOptions,
) -> CrossValidation {
    let mut objects: Vec<ObjectCrossValidation> = Vec::new();
    // The oddness of each prediction beside it.
    let mut oddness: Vec<Vec<f64>> = Vec::new();
    for (fold, predicted) in folds.iter().zip(predicted) {
        if objects.last().is_none_or(|object| object.estimate_index != fold.object) {
            objects.push(ObjectCrossValidation { estimate_index: fold.object, ..Default::default() });
            oddness.push(Vec::new());
        }
        let (Some(object), Some(oddness)) = (objects.last_mut(), oddness.last_mut()) else { continue };
        if predicted.predictions.is_empty() {
            object.not_predicted += fold.views.len();
        }
        oddness.extend(predicted.predictions.iter().map(|prediction| oddness_of(prediction, &predicted)));
        object.predictions.extend(predicted.predictions);
    }
    for (object, oddness) in objects.iter_mut().zip(oddness) {
        let mut paired: Vec<(Prediction, f64)> =
            std::mem::take(&mut object.predictions).into_iter().zip(oddness).collect();
        let place = |prediction: &Prediction| {
            let views = &estimates[object.estimate_index].views;
            views.iter().position(|view| view.frame_index == prediction.frame_index)
        };
        paired.stable_sort_by_key(|(prediction, _)| place(prediction));
        let oddest = (0..paired.len()).max_by(|&a, &b| paired[a].1.total_cmp(&paired[b].1));
        object.odd = oddest.filter(|&index| paired[index].1 > ODD_RATIO);
        object.predictions = paired.into_iter().map(|(prediction, _)| prediction).collect();
    }
    CrossValidation { extent: options.extent, objects }
}

/// Error of a prediction over the noise that the fit to the other views shows; 0 where it is small, or where the fit has
/// too few views to show any.
fn oddness_of(prediction: &Prediction, fold: &FoldPrediction) -> f64 {
    let dof = 1.0 - PARAMETERS / (4.0 * fold.fitted_views as f64);
    match (prediction.error(), fold.fitted_error) {
        (Some(error), Some(fitted)) if error > LARGE_ERROR && dof > 0.0 => {
            // What a fit leaves in its views is less than their noise, because it follows them.
            error / (fitted / dof.sqrt()).max(EXACT)
        }
        _ => 0.0,
    }
}

fn median_edge_error<'a>(predictions: impl Iterator<Item = &'a Prediction>) -> Option<f64> {
    let mut errors: Vec<f64> = predictions.flat_map(Prediction::edge_errors).flatten().map(f64::abs).collect();
    median(&mut errors)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

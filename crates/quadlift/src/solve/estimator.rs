//! Estimates one object from its views, without a scene.

use std::sync::Arc;

use super::bounding::{add_bounds, bounds_of_estimate};
use super::closed_form::solve_closed_form;
use super::estimate::Estimate;
use super::evidence::estimate;
use super::options::Method;
use super::posterior::{PosePoints, PosteriorContext};
use super::validate::OptionError;
use crate::observer::{Unobserved, Watch};
use crate::scene::{ObjectViews, View};

/// Estimates one object from its views, by any method.
///
/// In a scene, the default method estimates noise levels from all objects, which improves the weights of boxes; with a
/// scene, prefer [`crate::localize()`]. What takes a category or the vertical, such as [`super::PosteriorOptions::priors`], has no effect
/// here.
///
/// ```
/// use nalgebra::Matrix3x4;
/// use quadlift::geometry::{BoundingBox, Projection};
/// use quadlift::scene::View;
/// use quadlift::solve::{Estimator, PosteriorOptions};
///
/// // Four cameras (focal length 500 px, images of 640 x 480) look along +z at something 5 m ahead.
/// let views: Vec<View> = [-1.5, -0.5, 0.5, 1.5]
///     .into_iter()
///     .map(|x| {
///         let p = Matrix3x4::new(500.0, 0.0, 320.0, -500.0 * x, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
///         let u = 320.0 - 100.0 * x;
///         let bounding_box = BoundingBox::new([u - 50.0, 190.0, u + 50.0, 290.0])?;
///         Ok(View::from_box(Projection::from_matrix(p)?, bounding_box).with_image_size(640.0, 480.0))
///     })
///     .collect::<Result<_, Box<dyn std::error::Error>>>()?;
/// let estimate = Estimator::new(PosteriorOptions::default())?.fit(&views);
/// let center = estimate.center.expect("the views determine it");
/// assert!((center.z - 5.0).abs() < 0.3, "{}: {center}", estimate.status.name());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Estimator {
    method: Method,
}

impl Estimator {
    /// An estimator of this method: [`Method`], or [`super::PosteriorOptions`] for the default one.
    ///
    /// # Errors
    /// [`OptionError`] names the option of the method that is out of range.
    pub fn new(method: impl Into<Method>) -> Result<Self, OptionError> {
        let method = method.into();
        method.validate()?;
        Ok(Self { method })
    }

    /// Estimates the object of these views. It never fails: [`Estimate::status`] describes the outcome.
    pub fn fit(&self, views: &[View]) -> Estimate {
        let mut object = ObjectViews { object_index: 0, category_index: None, views: views.to_vec() };
        let Method::Posterior(options) = &self.method else {
            let mut estimate = solve_closed_form(&object, &self.method, false);
            estimate.bounds = bounds_of_estimate(&estimate, &object.views, None);
            return estimate;
        };
        object.views.iter_mut().for_each(|view| *view = view.within_margin(options.border_margin));
        let context = PosteriorContext {
            categories: &[],
            up: None,
            pose_unknowns: Arc::default(),
            pose_points: PosePoints::default(),
            cameras: views.iter().filter_map(|view| view.projection.center_in_world()).collect(),
            seed: 0,
            has_cues: views.iter().any(|view| !view.cues.is_empty()),
            with_enclosing: false,
            options,
            watch: &Watch::new(&Unobserved, 1),
        };
        let (mut solution, ..) = estimate(1, &|_| object.clone(), &context, &|_| Vec::new());
        add_bounds(&mut solution, &|_| object.clone(), None);
        solution.estimates.swap_remove(0)
    }
}

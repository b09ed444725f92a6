//! Constant inputs of association: near cameras, detection rates, options.

use nalgebra::Vector3;

use super::frame_order::FrameOrder;
use super::observations::{BoxObservation, Observations};
use super::sizes::LogSize;
use crate::association::options::{AssociateOptions, IdPolicy};
use crate::association::statistics::DetectionRate;
use crate::geometry::point_tree::PointTree;
use crate::scene::Scene;
use crate::solve::CategoryPriors;

/// Ratio of the semi-axes of an ellipsoid that touches about the same planes as a real object to half its extents:
/// between an ellipsoid's and a cuboid's.
const TOUCHING_SIZE: f64 = 1.15;

/// Minimum standard deviation of a log radius: real objects touch their boxes in different ways.
const MIN_SIZE_SD: f64 = 0.25;

/// The prior size of the objects of a category.
pub(crate) fn given_size(priors: &CategoryPriors, category: &str) -> Option<LogSize> {
    let size = priors.of(category)?.size?;
    let half = size.mean.map(|x| (0.5 * x).ln());
    let spread: f64 = (0..3).map(|i| (size.sd[i] / size.mean[i]).powi(2)).sum();
    Some(LogSize {
        mean: half.iter().sum::<f64>() / 3.0 + TOUCHING_SIZE.ln(),
        sd: (spread.sqrt() / 3.0).max(MIN_SIZE_SD),
    })
}

/// Constant inputs.
#[derive(Debug)]
pub(crate) struct AssociationContext<'a> {
    pub options: &'a AssociateOptions,
    /// Centers of the cameras.
    pub camera_tree: PointTree,
    /// The order in which objects are grown, and which frames pair up.
    pub order: FrameOrder,
    pub rate: DetectionRate,
    /// Longest focal length, pixels.
    pub longest_focal: f64,
    /// Sizes of the categories as the options give them.
    pub given_sizes: Vec<Option<LogSize>>,
    /// Whether ids are evidence.
    pub weighs_ids: bool,
}

impl<'a> AssociationContext<'a> {
    /// Prepares a scene's boxes.
    pub(crate) fn new(scene: &Scene, observations: &Observations, options: &'a AssociateOptions) -> Self {
        let cameras = &observations.cameras;
        let camera_tree = PointTree::new(cameras.iter().map(|c| c.center).collect());
        let given = |category: &Option<u32>| given_size(&options.priors, &scene.categories[(*category)? as usize]);
        Self {
            options,
            order: FrameOrder::new(cameras, &camera_tree),
            camera_tree,
            rate: DetectionRate::new(cameras.len().max(observations.boxes.len())),
            longest_focal: cameras.iter().map(|c| c.focal).fold(0.0, f64::max),
            given_sizes: observations.categories.iter().map(given).collect(),
            weighs_ids: options.ids == IdPolicy::Evidence && observations.boxes.iter().any(|b| b.id.is_some()),
        }
    }

    /// Whether the object id of a box is trusted.
    pub(crate) fn is_trusted(&self, observation: &BoxObservation) -> bool {
        self.options.ids == IdPolicy::Trust && observation.id.is_some()
    }

    /// Frames whose cameras are near enough for an object of this size to appear as large as the boxes, ascending.
    pub(crate) fn frames_near(&self, center: &Vector3<f64>, longest_semi_axis: f64, least_half_size: f64) -> Vec<u32> {
        let range = 1.2 * self.longest_focal * longest_semi_axis / least_half_size.max(1e-9);
        self.camera_tree.within(center, range)
    }
}

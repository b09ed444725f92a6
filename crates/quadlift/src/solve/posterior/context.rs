//! Input shared by the objects of a scene.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::shared::pose_points::PosePoints;
use super::shared::pose_unknowns::PoseUnknowns;
use crate::geometry::BodyKind;
use crate::observer::Watch;
use crate::scene::ObjectViews;
use crate::solve::options::{CategoryPrior, PosteriorOptions};

/// Data shared by the objects of a scene.
#[derive(Debug, Clone)]
pub(crate) struct PosteriorContext<'a> {
    /// Names of the categories, by index.
    pub categories: &'a [String],
    /// World direction against gravity.
    pub up: Option<Unit<Vector3<f64>>>,
    /// Centers of all cameras, for the ground plane.
    pub cameras: Vec<Point3<f64>>,
    /// Which motion corrects the pose of which camera.
    pub pose_unknowns: Arc<PoseUnknowns>,
    /// Points from which poses are corrected beside the objects, if there are any.
    pub pose_points: PosePoints,
    /// Seed of the hypotheses and of the random starts.
    pub seed: u64,
    /// Whether detections have depths or 3D boxes.
    pub has_cues: bool,
    /// Whether estimates have an enclosing ellipsoid, see [`crate::LocalizeOptions::enclosing`].
    pub with_enclosing: bool,
    /// The estimator's options.
    pub options: &'a PosteriorOptions,
    /// Who watches.
    pub watch: &'a Watch<'a>,
}

impl PosteriorContext<'_> {
    /// The prior of an object that one box locates: of known size, on the ground below cameras of known height.
    pub(super) fn standing_size(&self, views: &ObjectViews) -> Option<&CategoryPrior> {
        let PosteriorOptions { ground_plane, priors, camera_height, .. } = self.options;
        let category = priors.of(&self.categories[views.category_index?])?;
        let stands = (*ground_plane || category.on_ground) && self.up.is_some() && camera_height.is_some();
        (stands && category.size.is_some()).then_some(category)
    }

    /// What an object is fitted as before its kind is known: where the size of its category is known a cuboid, because lengths, widths
    /// and heights are those of boxes; an ellipsoid of that size would be nearer to the cameras than the object.
    pub(super) fn first_kind(&self, views: &ObjectViews) -> BodyKind {
        let prior = views.category_index.and_then(|index| self.options.priors.of(&self.categories[index]));
        if prior.is_some_and(|prior| prior.size.is_some()) { BodyKind::Cuboid } else { BodyKind::Ellipsoid }
    }

    /// Whether poses are corrected.
    pub(super) fn corrects_poses(&self) -> bool {
        self.options.pose_noise.is_some() || self.options.refine_poses.is_some()
    }

    /// Whether the objects share more than noise levels: the ground, corrected poses, or sizes.
    pub(in crate::solve) fn has_shared_unknowns(&self) -> bool {
        let PosteriorOptions { ground_plane, priors, learn_sizes, .. } = self.options;
        let on_ground = *ground_plane || priors.by_category.values().any(|prior| prior.on_ground);
        self.corrects_poses() || *learn_sizes || (on_ground && self.up.is_some())
    }
}

#[cfg(test)]
impl<'a> PosteriorContext<'a> {
    /// That of tests: no cues, no direction against gravity, exact poses.
    pub(super) fn of_test(scene: &'a crate::scene::Scene, options: &'a PosteriorOptions, watch: &'a Watch<'a>) -> Self {
        Self {
            has_cues: false,
            categories: &scene.categories,
            up: None,
            cameras: Vec::new(),
            pose_unknowns: Arc::default(),
            pose_points: PosePoints::default(),
            seed: 0,
            with_enclosing: false,
            options,
            watch,
        }
    }
}

//! Options of the estimators.

use std::collections::BTreeMap;

use super::noise_model::NoiseModel;
use crate::geometry::BodyKind;

/// The estimator for each object, with its options.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Method {
    /// Maximum a posteriori refinement: the default.
    Posterior(PosteriorOptions),
    /// Tangent planes of box edges, closed form.
    Planes,
    /// Conditioned closed form (LfD).
    Lfd,
    /// The paper's closed form (PfD), in pixel coordinates.
    Pfd,
    /// The paper's regularized estimator (section 4.1).
    Reg(RegOptions),
}

impl Default for Method {
    fn default() -> Self {
        Self::Posterior(PosteriorOptions::default())
    }
}

impl From<PosteriorOptions> for Method {
    fn from(options: PosteriorOptions) -> Self {
        Self::Posterior(options)
    }
}

impl Method {
    /// The minimum number of views of the method.
    pub fn min_views(&self) -> usize {
        match self {
            Self::Posterior(_) | Self::Reg(_) => 2,
            Self::Planes | Self::Lfd | Self::Pfd => 3,
        }
    }

    /// The options of [`Method::Posterior`], if it is the method.
    pub fn posterior_options(&self) -> Option<&PosteriorOptions> {
        if let Self::Posterior(options) = self { Some(options) } else { None }
    }

    /// The options of [`Method::Posterior`] for modification, if it is the method.
    pub fn posterior_options_mut(&mut self) -> Option<&mut PosteriorOptions> {
        if let Self::Posterior(options) = self { Some(options) } else { None }
    }
}

/// Prior knowledge about the objects of one category.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CategoryPrior {
    /// Full extents in world units: length, width, height (the height along the object's vertical axis), with the
    /// standard deviation of each.
    pub size: Option<SizePrior>,
    /// Standard deviation in radians of the angle between the object's vertical axis and the scene's `up`.
    pub upright_sd: Option<f64>,
    /// Whether the objects stand on the ground plane.
    pub on_ground: bool,
}

/// Full extents of a category: length, width, height, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizePrior {
    /// Mean length, width and height; all positive.
    pub mean: [f64; 3],
    /// Standard deviations of length, width and height; all positive.
    pub sd: [f64; 3],
}

/// Priors by category name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CategoryPriors {
    /// The prior of each category; others have none.
    pub by_category: BTreeMap<String, CategoryPrior>,
}

impl CategoryPriors {
    /// The prior of a category, or the default prior "*".
    pub fn of(&self, category: &str) -> Option<&CategoryPrior> {
        self.by_category.get(category).or_else(|| self.by_category.get("*"))
    }
}

/// Standard deviations of the errors of camera poses, independent between frames.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PoseNoise {
    /// Rotation about each axis, radians; positive.
    pub rotation_sd: f64,
    /// Translation along each axis, world units; positive.
    pub translation_sd: f64,
}

/// How the errors of camera poses change from frame to frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PoseMotion {
    /// The evidence of the boxes decides how fast they change: each frame has an error of its own, or errors last about 10,
    /// 30 or 100 frames (docs/method.md, section 11.2).
    Auto,
    /// Each frame has an error of its own: structure from motion, AR frameworks.
    Independent,
    /// Errors change slowly, over about 100 frames: GPS, odometry that drifts.
    Slow,
}

/// The default of [`PosteriorOptions::border_margin`].
pub(crate) const BORDER_MARGIN: f64 = 0.025;

/// Options of the maximum a posteriori estimator.
#[derive(Debug, Clone)]
pub struct PosteriorOptions {
    /// The kind of body. `None` selects it for each object, by the evidence of its boxes and of the other objects of the scene
    /// and category (docs/method.md, section 9). Ellipsoids are preferred unless the evidence is clear.
    pub body: Option<BodyKind>,
    /// Priors by category; empty by default.
    pub priors: CategoryPriors,
    /// Whether the sizes of categories are learned from the objects of the scene: each object gets the size of the others of its
    /// category as a prior (docs/method.md, section 21). Categories whose size [`PosteriorOptions::priors`] tells keep that. Has no effect
    /// on [`super::Estimator`], which knows one object.
    pub learn_sizes: bool,
    /// Shape prior: standard deviation of the log semi-axes about their mean. Tuned: with 0.5 the covariance of narrow
    /// baselines is too wide (median NEES 7.0 of 8.3; with 0.4 it is 7.2), and real boxes gain nothing.
    #[doc(hidden)]
    pub shape_sd: f64,
    /// Whether to search for gross outliers among the views if the residuals of a plain fit suggest some.
    #[doc(hidden)]
    pub robust: bool,
    /// Distance from the image border, as a share of the image's larger side, within which a box edge counts as cut off: it
    /// then bounds the object on one side only. Tuned on 27 cars of KITTI.
    #[doc(hidden)]
    pub border_margin: f64,
    /// Mean half size of a box, in pixels, at which the constant part of the edge noise equals the part that is proportional
    /// to the size. 0 makes the noise proportional to the size. Tuned on 27 cars of KITTI.
    #[doc(hidden)]
    pub pixel_noise_size: f64,
    /// Whether each edge has a heavy-tailed loss, which down-weights single wrong edges.
    #[doc(hidden)]
    pub heavy_tails: bool,
    /// Whether to estimate the correlation of an edge's errors between neighboring views, which lowers their weight.
    #[doc(hidden)]
    pub correlated_views: bool,
    /// Whether to detect objects that stand upright, with one axis along the scene's `up` (docs/method.md, section 10). Has no
    /// effect without `up`, and on categories with an `upright_sd` or a size.
    pub upright: bool,
    /// Whether all objects stand on a common ground plane, which is estimated. Otherwise only objects whose prior has
    /// [`CategoryPrior::on_ground`]. Needs the scene's `up`.
    pub ground_plane: bool,
    /// Height of the cameras above the ground plane in world units, if known.
    pub camera_height: Option<f64>,
    /// Whether edges that another box probably hides have their own noise level.
    #[doc(hidden)]
    pub occluded_edges: bool,
    /// Prior of pose corrections, one per frame, which are then estimated. `None` takes the poses as exact. It helps only if
    /// each frame shows several objects.
    pub pose_noise: Option<PoseNoise>,
    /// Whether poses are corrected, those of frames that a rig took at one time step together, with levels of their errors that are
    /// estimated, too (those of [`PosteriorOptions::pose_noise`], where it is given), and how the errors change from frame to frame.
    pub refine_poses: Option<PoseMotion>,
    /// Whether the places of cameras in their rig ([`crate::scene::Frame::rig`]) are corrected with the poses; the default. Errors of
    /// extrinsics that are taken as exact move the whole rig.
    pub refine_extrinsics: bool,
    /// Whether scenes of boxes alone are fitted by the scan and the evidence of all objects (docs/method.md, section 24), instead of the
    /// estimator of all other scenes.
    #[doc(hidden)]
    pub by_evidence: bool,
    /// Whether covariances include errors that the views of an object share, and differences between objects. Estimates do not
    /// depend on it.
    #[doc(hidden)]
    pub common_errors: bool,
    /// Noise levels. `None` estimates them from the residuals of all objects together.
    pub noise_model: Option<NoiseModel>,
}

impl Default for PosteriorOptions {
    fn default() -> Self {
        Self {
            body: None,
            priors: CategoryPriors::default(),
            learn_sizes: false,
            shape_sd: 0.4,
            robust: true,
            border_margin: BORDER_MARGIN,
            pixel_noise_size: 67.0,
            heavy_tails: true,
            correlated_views: true,
            upright: true,
            ground_plane: false,
            camera_height: None,
            occluded_edges: true,
            pose_noise: None,
            refine_poses: None,
            refine_extrinsics: true,
            by_evidence: true,
            common_errors: true,
            noise_model: None,
        }
    }
}

/// Options of the paper's regularized estimator.
#[derive(Debug, Clone)]
pub struct RegOptions {
    /// Weight of the sphere regularizer (PfD equation 14), in the units of pixel-coordinate conics.
    pub lambda: f64,
}

impl Default for RegOptions {
    fn default() -> Self {
        Self { lambda: 1e16 }
    }
}

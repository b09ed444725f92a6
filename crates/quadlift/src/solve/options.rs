//! What can be chosen about the estimators.

use std::collections::BTreeMap;

use super::sigmas::Sigmas;
use crate::geometry::Body;

/// Which estimator solves for each object, with its options.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Method {
    /// Maximum a posteriori refinement: the default.
    Map(MapOptions),
    /// Tangent planes of box edges, closed form.
    Planes,
    /// Conditioned closed form (LfD).
    Lfd,
    /// The paper's closed form (PfD), in pixel coordinates.
    Pfd,
    /// The paper's regularised estimator (section 4.1).
    Reg(RegOptions),
}

impl Default for Method {
    fn default() -> Self {
        Self::Map(MapOptions::default())
    }
}

impl From<MapOptions> for Method {
    fn from(options: MapOptions) -> Self {
        Self::Map(options)
    }
}

impl Method {
    /// The fewest views with which the method can give an answer.
    pub fn fewest_views(&self) -> usize {
        match self {
            Self::Map(_) | Self::Reg(_) => 2,
            Self::Planes | Self::Lfd | Self::Pfd => 3,
        }
    }

    /// The options of [`Method::Map`], where it is that.
    pub fn map_options(&self) -> Option<&MapOptions> {
        if let Self::Map(options) = self { Some(options) } else { None }
    }

    /// The options of [`Method::Map`] to change, where it is that.
    pub fn map_options_mut(&mut self) -> Option<&mut MapOptions> {
        if let Self::Map(options) = self { Some(options) } else { None }
    }
}

/// The kind of body that is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum BodyKind {
    /// An ellipsoid.
    #[default]
    Ellipsoid,
    /// A cuboid.
    Cuboid,
    /// A cylinder with an elliptic base.
    Cylinder,
    /// A superellipsoid with this exponent of its support function, in [1, 2] (1 cuboid, 2 ellipsoid).
    Superellipsoid(f64),
}

impl BodyKind {
    /// The kind of a body.
    pub fn of(body: &Body) -> Self {
        match body {
            Body::Ellipsoid(_) => Self::Ellipsoid,
            Body::Cuboid(_) => Self::Cuboid,
            Body::Cylinder(_) => Self::Cylinder,
            Body::Superellipsoid(body) => Self::Superellipsoid(body.support_exponent),
        }
    }
}

/// What is known beforehand about the objects of one category.
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
    /// The prior of a category, or the one named "*" for all that have none of their own.
    pub fn of(&self, category: &str) -> Option<&CategoryPrior> {
        self.by_category.get(category).or_else(|| self.by_category.get("*"))
    }
}

/// How wrong the poses of the cameras may be: standard deviations of each frame's error, independent of the others'.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseNoise {
    /// Of the turn about each axis, radians; positive.
    pub rotation_sd: f64,
    /// Of the shift along each axis, world units; positive.
    pub translation_sd: f64,
}

/// The default of [`MapOptions::border_margin`].
pub(crate) const BORDER_MARGIN: f64 = 0.025;

/// Options of the maximum a posteriori estimator.
#[derive(Debug, Clone)]
pub struct MapOptions {
    /// The kind of body; without one it is chosen for each object, from its boxes and from what the other objects of the scene
    /// and of its category are: an ellipsoid where nothing else is clear.
    pub body: Option<BodyKind>,
    /// Priors by category; empty by default.
    pub priors: CategoryPriors,
    /// Standard deviation of the deviation of log semi-axes from their mean: the shape prior. With 0.5 the covariance of
    /// narrow baselines is too wide (median NEES 7.0 of 8.3, with 0.4 7.2), and real boxes come out no better.
    pub shape_sd: f64,
    /// Look for gross outliers among the views where the plain fit's residuals show some.
    pub robust: bool,
    /// Share of the image's larger side within which a box edge counts as cut off by the border, and tells only
    /// that the object reaches at least so far.
    pub border_margin: f64,
    /// Mean half size of a box, in pixels, at which the part of the edge noise that is constant in pixels equals the
    /// part that is proportional to the size; 0 for noise proportional to the size throughout.
    pub pixel_noise_size: f64,
    /// Whether single edges that do not fit count less (a heavy-tailed loss per edge).
    pub heavy_tails: bool,
    /// Whether the correlation of an edge's errors from view to view is estimated, so that many views that err alike
    /// do not count as many.
    pub correlated_views: bool,
    /// Whether it is found out which objects stand upright, some axis of theirs along the scene's `up`: those for which the
    /// measurements of all objects speak. Says nothing where `up` is not known, and of categories that have an
    /// `upright_sd` or a size.
    pub upright: bool,
    /// Whether all objects stand on a common ground plane, which is estimated; otherwise those whose category's prior
    /// says so do. Needs the scene's `up`.
    pub ground_plane: bool,
    /// Height of the cameras above the ground plane in world units, where it is known.
    pub camera_height: Option<f64>,
    /// Whether box edges that another box probably hides have a noise level of their own.
    pub hidden_edges: bool,
    /// Estimate a correction of every frame's pose with this prior; poses are taken as exact without it. Worth it only
    /// where several objects are seen in each frame.
    pub pose_noise: Option<PoseNoise>,
    /// Whether covariances know more than the noise of single measurements: errors that the views of an object have in
    /// common, and how much objects differ. It changes no estimate.
    pub common_errors: bool,
    /// Noise levels; without them they are estimated from the residuals of all objects together.
    pub sigmas: Option<Sigmas>,
}

impl Default for MapOptions {
    fn default() -> Self {
        Self {
            body: None,
            priors: CategoryPriors::default(),
            shape_sd: 0.4,
            robust: true,
            border_margin: BORDER_MARGIN,
            pixel_noise_size: 67.0,
            heavy_tails: true,
            correlated_views: true,
            upright: true,
            ground_plane: false,
            camera_height: None,
            hidden_edges: true,
            pose_noise: None,
            common_errors: true,
            sigmas: None,
        }
    }
}

/// Options of the paper's regularised estimator.
#[derive(Debug, Clone)]
pub struct RegOptions {
    /// Weight of the sphere regulariser (PfD equation 14), in the units of pixel-coordinate conics.
    pub lambda: f64,
}

impl Default for RegOptions {
    fn default() -> Self {
        Self { lambda: 1e16 }
    }
}

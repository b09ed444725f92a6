//! Kinds of measurement errors, each with a noise level of its own.

use crate::solve::noise_model::NOISE_NAMES;

/// A kind of measurement error with its own standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoiseGroup {
    /// Edge of a box, or another tangent line, relative to the half size (for boxes of a certain size, see
    /// [`crate::solve::posterior::residuals::measurements`]).
    Edge,
    /// Edge of a box that is probably hidden by another box.
    OccludedEdge,
    /// Center of an ellipse, relative to its mean semi-axis.
    EllipseCenter,
    /// Logarithm of the mean semi-axis of an ellipse.
    EllipseSize,
    /// Half the logarithm of the ratio of the semi-axes of an ellipse.
    EllipseAspect,
    /// Angle of an ellipse, times half the logarithm of its axis ratio.
    EllipseAngle,
    /// Shape of an ellipse beside a box: half the logarithm of its axis ratio as a vector at twice its angle.
    Shape,
    /// Any residual of an ellipse that may cover only a part of the object.
    PartialEllipse,
    /// Logarithm of the depth of the visible surface.
    Depth,
    /// Logarithm of the distance of a 3D box.
    BoxDistance,
    /// Direction of the center of a 3D box, each way, radians.
    BoxDirection,
    /// Logarithm of an extent of a 3D box.
    BoxSize,
    /// Rotation of a 3D box about an axis, radians.
    BoxRotation,
}

impl NoiseGroup {
    /// All groups, in the order of their indices.
    pub(crate) const ALL: [Self; GROUPS] = [
        Self::Edge,
        Self::OccludedEdge,
        Self::EllipseCenter,
        Self::EllipseSize,
        Self::EllipseAspect,
        Self::EllipseAngle,
        Self::Shape,
        Self::PartialEllipse,
        Self::Depth,
        Self::BoxDistance,
        Self::BoxDirection,
        Self::BoxSize,
        Self::BoxRotation,
    ];

    /// Name in reports.
    pub(super) fn name(self) -> &'static str {
        NOISE_NAMES[self as usize]
    }

    /// Whether it is an edge, hidden or not.
    #[inline]
    pub(crate) fn is_edge(self) -> bool {
        matches!(self, Self::Edge | Self::OccludedEdge)
    }

    /// Whether it is an error of a depth or of a 3D box.
    #[inline]
    pub(crate) fn is_cue(self) -> bool {
        self as usize >= Self::Depth as usize
    }

    /// Index of those groups whose errors have a correlation between views: edges, ellipses, cues.
    #[inline]
    pub(crate) fn correlated_with(self) -> usize {
        if self.is_edge() { 0 } else { 1 + usize::from(self.is_cue()) }
    }

    /// Index of its kind among those with errors common to views.
    pub(crate) fn common_class(self) -> usize {
        (self as usize).saturating_sub(1)
    }

    /// Whether single residuals may be far off: edges, shapes of masks, parts, and cues.
    #[inline]
    pub(crate) fn has_heavy_tails(self) -> bool {
        self.is_edge() || self.is_cue() || matches!(self, Self::Shape | Self::PartialEllipse)
    }
}

/// Number of kinds of correlations between views ([`NoiseGroup::correlated_with`]).
pub(crate) const CORRELATIONS: usize = 3;

/// Number of noise groups.
pub(super) const GROUPS: usize = 13;

//! Kinds of measurement errors, each with a noise level of its own.

use crate::solve::sigmas::SIGMA_NAMES;

/// A kind of measurement error with its own standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoiseGroup {
    /// Edge of a box, or another tangent line, relative to the half size (for boxes of a certain size, see
    /// [`crate::solve::map::residuals::measurements`]).
    Edge,
    /// Edge of a box that is probably hidden by another box.
    HiddenEdge,
    /// Centre of an ellipse, relative to its mean semi-axis.
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
}

impl NoiseGroup {
    /// All groups, in the order of their indices.
    pub(crate) const ALL: [Self; GROUPS] = [
        Self::Edge,
        Self::HiddenEdge,
        Self::EllipseCenter,
        Self::EllipseSize,
        Self::EllipseAspect,
        Self::EllipseAngle,
        Self::Shape,
        Self::PartialEllipse,
    ];

    /// Name in reports.
    pub(super) fn name(self) -> &'static str {
        SIGMA_NAMES[self as usize]
    }

    /// Whether it is an edge, hidden or not.
    #[inline]
    pub(crate) fn is_edge(self) -> bool {
        matches!(self, Self::Edge | Self::HiddenEdge)
    }

    /// Index of its kind among those with errors common to views.
    pub(crate) fn common_class(self) -> usize {
        (self as usize).saturating_sub(1)
    }

    /// Whether single residuals may be far off: edges, shapes of masks, and parts.
    #[inline]
    pub(crate) fn has_heavy_tails(self) -> bool {
        self.is_edge() || matches!(self, Self::Shape | Self::PartialEllipse)
    }
}

/// Number of noise groups.
pub(super) const GROUPS: usize = 8;

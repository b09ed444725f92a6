//! Which measurements of detections are used.

use crate::scene::{Detection, View};

/// Which of a detection's measurements are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeasurementKind {
    /// What the detection has. Of one with box and ellipse `map` takes place and size from the box's edges and the shape
    /// from the ellipse; `planes` takes the box, `lfd`, `pfd` and `reg` take the ellipse.
    #[default]
    Auto,
    /// The box; detections without one take no part.
    Box,
    /// The ellipse; detections without one take no part.
    Ellipse,
    /// Box and ellipse, as with `Auto`; detections that lack one of them take no part.
    BoxAndEllipse,
    /// The supporting lines of the mask, in the place of the box's edges, with `map` and `planes`; detections without
    /// any ([`Detection::support_lines`]) take no part.
    Mask,
}

impl MeasurementKind {
    /// Whether a detection has what is used.
    pub(super) fn are_in(self, detection: &Detection) -> bool {
        match self {
            Self::Auto => true,
            Self::Box => detection.bounding_box.is_some(),
            Self::Ellipse => detection.ellipse.is_some(),
            Self::BoxAndEllipse => detection.bounding_box.is_some() && detection.ellipse.is_some(),
            Self::Mask => detection.support_lines.as_deref().is_some_and(|lines| lines.bounding_box().is_some()),
        }
    }

    /// Removes from a view what is not used.
    pub(super) fn keep_only(self, view: &mut View) {
        if self != Self::Mask {
            view.support_lines = None;
        }
        match self {
            Self::Auto | Self::BoxAndEllipse => {}
            Self::Box => view.ellipse = None,
            Self::Ellipse => view.bounding_box = None,
            Self::Mask => {
                view.ellipse = None;
                view.bounding_box = view.support_lines.and_then(|lines| lines.bounding_box());
            }
        }
    }
}

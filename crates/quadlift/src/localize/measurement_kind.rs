//! Selection of the measurements of detections.

use crate::scene::{Detection, View};

/// Which measurements of a detection are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeasurementKind {
    /// All measurements of the detection. With box and ellipse, `posterior` uses the box for position and size and the
    /// ellipse for shape; `planes` uses the box; `lfd`, `pfd` and `reg` use the ellipse. With an outline or an oriented box
    /// ([`Detection::tangent_lines`]), `posterior` and `planes` use its tangent lines instead of the edges of the box.
    #[default]
    Auto,
    /// The box; detections without one are skipped.
    Box,
    /// The ellipse; detections without one are skipped.
    Ellipse,
    /// Box and ellipse, as with `Auto`; detections without either of them are skipped.
    BoxAndEllipse,
    /// The tangent lines of mask, outline or oriented box instead of the edges of the box, with `posterior` and `planes`; detections
    /// without any ([`Detection::tangent_lines`]) are skipped.
    Mask,
}

impl MeasurementKind {
    /// Whether a detection has the selected measurement.
    pub(super) fn are_in(self, detection: &Detection) -> bool {
        match self {
            Self::Auto => true,
            Self::Box => detection.bounding_box.is_some(),
            Self::Ellipse => detection.ellipse.is_some(),
            Self::BoxAndEllipse => detection.bounding_box.is_some() && detection.ellipse.is_some(),
            Self::Mask => detection.tangent_lines.as_deref().is_some_and(|lines| lines.bounding_box().is_some()),
        }
    }

    /// Removes unused measurements from a view.
    pub(super) fn keep_only(self, view: &mut View) {
        if !matches!(self, Self::Auto | Self::Mask) {
            view.tangent_lines = None;
        }
        match self {
            Self::Auto | Self::BoxAndEllipse => {}
            Self::Box => view.ellipse = None,
            Self::Ellipse => view.bounding_box = None,
            Self::Mask => {
                view.ellipse = None;
                view.bounding_box = view.tangent_lines.and_then(|lines| lines.bounding_box());
            }
        }
    }
}

//! The outline or the oriented box of a kept view, reduced to what its tangent lines need, as plain numbers.

use crate::geometry::OrientedBox;
use crate::scene::{self, Outlines, Shape, check_outline, extreme_corners};

/// Outline or oriented box of a kept view, in the image as it is, in single precision.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MapShape {
    /// The corners of the outline that its tangent lines touch; none of an oriented box.
    corners: Vec<[f32; 2]>,
    /// Center, size and angle of an oriented box.
    oriented_box: Option<[f32; 5]>,
    /// Which lines another outline of the frame hides, as bits.
    hidden: u8,
    /// Whether a box was measured, too.
    has_box: bool,
}

impl MapShape {
    /// The shape of a detection in a frame whose lines are known; `None` without a shape.
    pub(super) fn of(shape: &Shape, frame: &scene::Frame, hidden: u8, has_box: bool) -> Option<Self> {
        let rounded = |[x, y]: [f64; 2]| [x as f32, y as f32];
        let outline = shape.outline.map(|corners| extreme_corners(corners, frame));
        let kept = match (outline, shape.oriented_box) {
            (Some(corners), _) => {
                Self { corners: corners.into_iter().map(rounded).collect(), oriented_box: None, hidden, has_box }
            }
            (None, Some(turned)) => {
                let (center, size) = (turned.center(), turned.size());
                let numbers = [center.x, center.y, size.x, size.y, turned.angle()].map(|x| x as f32);
                Self { corners: Vec::new(), oriented_box: Some(numbers), hidden, has_box }
            }
            (None, None) => return None,
        };
        // Rounding may leave nothing of a tiny one.
        kept.is_valid().then_some(kept)
    }

    /// The corners of the outline that its tangent lines touch.
    pub fn outline(&self) -> Option<Vec<[f64; 2]>> {
        (!self.corners.is_empty()).then(|| self.corners.iter().map(|corner| corner.map(f64::from)).collect())
    }

    /// The oriented box.
    pub fn oriented_box(&self) -> Option<OrientedBox> {
        let [x, y, width, height, angle] = self.oriented_box?.map(f64::from);
        OrientedBox::new([x, y].into(), [width, height].into(), angle).ok()
    }

    /// Whether a box was measured, too.
    pub fn has_box(&self) -> bool {
        self.has_box
    }

    /// Gives a detection, whose box is known, the tangent lines.
    pub(super) fn add_to(&self, detection: &mut scene::Detection, frame: &scene::Frame) {
        let (outline, has_box) = (self.outline(), self.has_box);
        let occluded_lines = Some(std::array::from_fn(|k| self.hidden & (1 << k) != 0));
        let shape = Shape { outline: outline.as_deref(), oriented_box: self.oriented_box(), occluded_lines };
        // The box around an outline is no measurement beside it.
        let around = detection.bounding_box.filter(|_| !has_box);
        let in_image = detection.box_in_image;
        if around.is_some() {
            detection.bounding_box = None;
        }
        // Checked where it was kept; without lines the box remains.
        let _ = Outlines::default().add(0, detection, has_box, frame, &shape);
        if around.is_some() {
            (detection.bounding_box, detection.box_in_image) = (around, in_image);
        }
    }

    /// Whether all numbers are in their ranges.
    pub(super) fn is_valid(&self) -> bool {
        match self.outline() {
            Some(corners) => self.oriented_box.is_none() && check_outline(&corners).is_ok(),
            None => self.oriented_box().is_some(),
        }
    }
}

/// Hidden lines as bits.
pub(super) fn line_bits(hidden: impl Iterator<Item = bool>) -> u8 {
    hidden.enumerate().map(|(k, hidden)| u8::from(hidden) << k).sum()
}

//! What can be corrected in the records of a scene file.

use quadlift::diagnosis::Correction;

use super::rounding::{nearest_unit, usual_width};

/// What is corrected in the records of a scene file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RecordCorrection {
    /// One of the usual mistakes.
    Known(Correction),
    /// The boxes were measured in images of this width and height, in pixels; they are scaled to the cameras' images.
    ImageSize([f64; 2]),
    /// The boxes were measured in letterboxed images of this width and height, in pixels, that need not be square: the
    /// image was scaled to fit, keeps its proportions and has equal margins on both sides.
    Letterbox([f64; 2]),
    /// The translations of the poses are in a unit of this length in metres; the scene is in metres afterwards.
    PoseUnit(f64),
}

impl RecordCorrection {
    /// What undoes one of the usual mistakes in a scene whose images have one size, in pixels, where that is known. Sizes
    /// of images that were found by the self-check are rounded: to a usual width where one is near, to whole pixels else.
    pub fn of(correction: &Correction, image_size: Option<[f64; 2]>) -> Self {
        match (*correction, image_size) {
            (Correction::ImageScale(factor), Some([width, height])) => {
                let measured = usual_width(width / factor);
                Self::ImageSize([measured, (height * measured / width).round().max(1.0)])
            }
            (Correction::Lengths(factor), _) => Self::PoseUnit(nearest_unit(factor)),
            (Correction::Letterbox(side), _) => Self::Known(Correction::Letterbox(usual_width(side))),
            (other, _) => Self::Known(other),
        }
    }

    /// The place in the order in which corrections are applied: the format of boxes before their pixels, everything that
    /// belongs to a frame before detections move to other frames.
    pub(super) fn place(&self) -> u8 {
        match self {
            Self::Known(Correction::Boxes(_)) => 0,
            Self::Known(Correction::FrameOffset(_) | Correction::ReversedFrames) => 3,
            Self::Known(Correction::AlphabeticalFrames | Correction::NumericFrames) => 2,
            _ => 1,
        }
    }
}

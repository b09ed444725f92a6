//! Corrections of the records of a scene file.

use quadlift::diagnosis::Correction;

use super::rounding::{nearest_unit, usual_width};

/// A correction of the records of a scene file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RecordCorrection {
    /// One of the common mistakes.
    Known(Correction),
    /// The boxes were measured in images of this width and height, in pixels; they are scaled to the cameras' images.
    ImageSize([f64; 2]),
    /// The boxes were measured in letterboxed images of this width and height, in pixels, that need not be square: the
    /// image was scaled to fit, keeps its proportions and has equal margins on both sides.
    Letterbox([f64; 2]),
    /// The detections give this number to frame number 0.
    FrameOffset(i64),
    /// The translations of the poses are in a unit of this length in meters; the scene is in meters afterwards.
    PoseUnit(f64),
}

impl RecordCorrection {
    /// Whether pictures are turned by 90 degrees, so that their width is the height of the cameras' images.
    pub fn turns_sides(&self) -> bool {
        matches!(self, Self::Known(Correction::TurnedPictures { orientation, .. }) if *orientation > 4)
    }
}

impl RecordCorrection {
    /// The correction of one of the common mistakes in a scene with one image size, in pixels, if known. Image sizes
    /// from the consistency check are rounded: to a common width if one is near, otherwise to whole pixels.
    pub(crate) fn of(correction: &Correction, image_size: Option<[f64; 2]>) -> Self {
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

    /// The order in which corrections are applied: box formats before pixels, and everything within a frame before
    /// detections move to other frames.
    pub(super) fn place(&self) -> u8 {
        match self {
            Self::Known(Correction::Boxes(_)) => 0,
            Self::FrameOffset(_) | Self::Known(Correction::FrameOffset(_) | Correction::ReversedFrames) => 3,
            Self::Known(Correction::AlphabeticalFrames | Correction::NumericFrames) => 2,
            _ => 1,
        }
    }
}

/// What corrections say about detections that are added to a scene.
#[derive(Debug, Clone, Copy, Default)]
pub struct DetectionPixels {
    /// Width and height in pixels of the images on which the detector ran.
    pub image_size: Option<[f64; 2]>,
    /// Whether the pictures are turned by 90 degrees, which a correction undoes.
    pub turned: bool,
    /// The number that the detections give to frame number 0.
    pub frame_offset: Option<i64>,
    /// Whether the boxes have another format, which a correction undoes: until then they may look reversed.
    pub boxes_follow: bool,
}

impl DetectionPixels {
    /// What is dealt with where detections are added, and the corrections of the scene afterwards.
    pub fn split(corrections: Vec<RecordCorrection>) -> (Self, Vec<RecordCorrection>) {
        let mut found = Self::default();
        let others = corrections.into_iter().filter(|correction| {
            found.turned |= correction.turns_sides();
            found.boxes_follow |= matches!(correction, RecordCorrection::Known(Correction::Boxes(_)));
            match *correction {
                RecordCorrection::ImageSize(size) => found.image_size = Some(size),
                RecordCorrection::FrameOffset(offset) => found.frame_offset = Some(offset),
                _ => return true,
            }
            false
        });
        let others = others.collect();
        (found, others)
    }
}

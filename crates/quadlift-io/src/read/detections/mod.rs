//! Readers of the files of detectors, trackers and annotators, one format each.
//!
//! A reader returns [`DetectionFiles`]: the detections per image, with the identification of each image ([`ImageKey`]).
//! [`add_detections`] matches the images to the frames of a scene and adds the detections in the convention of the
//! scene file. Track ids become object ids (`t7` for the number 7); classes become categories by name.

mod files;
mod shapes;
mod coco;
mod kitti_labels;
mod label_studio_links;
mod names;
mod original_names;
mod cvat;
mod label_studio_brush;
mod label_studio;
mod labelme;
mod table;
mod csv;
mod boxer;
mod voc;
mod yolo_columns;
pub(crate) mod yolo;
mod mot;
mod matching;
mod add;

#[cfg(test)]
mod tests;

pub use add::{AddOptions, AddedDetections, add_detections};
pub use files::{Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey, Numbering, Outline};
pub use matching::MatchBy;
pub(crate) use matching::numbers_of_frames;

/// The formats of detections, in the order of recognition.
pub(crate) const DETECTIONS: &[DetectionFormat] = &[
    mot::FORMAT,
    yolo::FORMAT,
    kitti_labels::FORMAT,
    labelme::FORMAT,
    label_studio::FORMAT,
    coco::FORMAT,
    voc::FORMAT,
    cvat::FORMAT,
    boxer::FORMAT,
    csv::FORMAT,
];

//! Readers of the files of detectors, trackers and annotators, one format each.
//!
//! A reader returns [`DetectionFiles`]: the detections per image, with the identification of each image ([`ImageKey`]).
//! [`add_detections`] matches the images to the frames of a scene and adds the detections in the convention of the
//! scene file. Track ids become object ids (`t7` for the number 7); classes become categories by name.

mod add;
pub mod boxer;
pub mod coco;
pub mod csv;
pub mod cvat;
mod files;
pub mod kitti;
pub mod label_studio;
mod label_studio_brush;
mod label_studio_links;
pub mod labelme;
pub mod mot;
pub mod names;
mod original_names;
mod shapes;
pub mod supervision;
mod table;
pub mod voc;
pub mod yolo;
mod yolo_columns;

mod matching;

#[cfg(test)]
mod tests;

use std::path::Path;

pub use add::{AddOptions, AddedDetections, add_detections};
pub use files::{Detected, DetectedImage, DetectionFiles, File, ImageKey, LabelFile, Numbering, Outline};
pub use matching::MatchBy;
pub(crate) use matching::numbers_of_frames;

use self::csv::TableOptions;
use self::mot::MotOptions;
use self::yolo::YoloOptions;
use crate::detect::DetectionFormat;
use crate::error::ReadError;

/// Reads detections of a format that was recognised, as each reader does by default.
///
/// `annotations` is the data set that names images and categories of a list of COCO results; the options are for those
/// formats that have them.
///
/// # Errors
/// [`ReadError`] as the reader of the format.
pub fn read_detections(
    format: DetectionFormat,
    path: &Path,
    annotations: Option<&Path>,
    options: &TableOptions,
) -> Result<DetectionFiles, ReadError> {
    let names = options.names;
    match format {
        DetectionFormat::Coco => coco::read_coco(path, annotations),
        DetectionFormat::Mot => mot::read_mot(path, &MotOptions { names, ..Default::default() }),
        DetectionFormat::Yolo => yolo::read_yolo(path, &YoloOptions { names, ..Default::default() }),
        DetectionFormat::Kitti => kitti::read_kitti_labels(path),
        DetectionFormat::Csv => csv::read_csv(path, options),
        DetectionFormat::Supervision => supervision::read_supervision(path, options),
        DetectionFormat::LabelMe => labelme::read_labelme(path),
        DetectionFormat::Voc => voc::read_voc(path),
        DetectionFormat::Cvat => cvat::read_cvat(path),
        DetectionFormat::LabelStudio => label_studio::read_label_studio(path),
        DetectionFormat::Boxer => boxer::read_boxer(path),
    }
}

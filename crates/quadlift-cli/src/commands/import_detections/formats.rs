//! The formats of detections with their options.

use std::path::{Path, PathBuf};

use quadlift_io::ReadError;
use quadlift_io::detect::DetectionFormat;
use quadlift_io::read::PixelCenters;
use quadlift_io::read::detections::DetectionFiles;
use quadlift_io::read::detections::boxer::read_boxer;
use quadlift_io::read::detections::coco::read_coco;
use quadlift_io::read::detections::csv::{TableOptions, read_csv};
use quadlift_io::read::detections::cvat::read_cvat;
use quadlift_io::read::detections::kitti::read_kitti_labels;
use quadlift_io::read::detections::label_studio::read_label_studio;
use quadlift_io::read::detections::labelme::read_labelme;
use quadlift_io::read::detections::mot::{MotKind, MotOptions, read_mot};
use quadlift_io::read::detections::names::{ClassNames, read_names};
use quadlift_io::read::detections::supervision::read_supervision;
use quadlift_io::read::detections::voc::read_voc;
use quadlift_io::read::detections::yolo::{ExtraColumns, YoloKind, YoloOptions, read_yolo};

use super::Common;
use crate::commands::import::formats::Pixels;

/// A format and where to read it.
#[derive(clap::Subcommand)]
pub enum Format {
    /// COCO: annotations or a list of results, with boxes, polygons and masks
    Coco {
        /// The file, or the folder of a Roboflow export
        #[arg(value_name = "PATH")]
        path: PathBuf,
        /// The data set that names images and categories of a list of results
        #[arg(long, value_name = "FILE.json")]
        annotations: Option<PathBuf>,
        #[command(flatten)]
        common: Common,
    },
    /// MOTChallenge: detections, tracks or ground truth
    Mot {
        /// The file, or the folder of a sequence with gt/gt.txt or det/det.txt
        #[arg(value_name = "PATH")]
        path: PathBuf,
        /// Columns after the box: auto, det (confidence), gt (flag, class, visibility) or class (confidence, class)
        #[arg(long, value_enum, value_name = "WHAT", default_value_t = MotColumns::Auto, hide_possible_values = true)]
        columns: MotColumns,
        /// Coordinate of the left edge of the first pixel: 1 as in MOTChallenge, or 0 as written by many trackers
        #[arg(long, value_name = "0|1", default_value_t = 1, value_parser = clap::value_parser!(u8).range(0..=1))]
        box_origin: u8,
        #[command(flatten)]
        names: Names,
        #[command(flatten)]
        common: Common,
    },
    /// Ultralytics YOLO: label files with boxes, polygons or rotated boxes, and track ids
    Yolo {
        /// Folder of label files (or of the run, with `labels`), or a single file
        #[arg(value_name = "PATH")]
        path: PathBuf,
        /// Coordinates after the class: auto, box, polygon or obb (the corners of a rotated box)
        #[arg(long, value_enum, value_name = "WHAT", default_value_t = YoloShapes::Auto, hide_possible_values = true)]
        kind: YoloShapes,
        /// Columns after the coordinates: auto, none, score, track or score+track
        #[arg(long, value_enum, value_name = "WHAT", default_value_t = YoloColumns::Auto, hide_possible_values = true)]
        columns: YoloColumns,
        #[command(flatten)]
        names: Names,
        #[command(flatten)]
        common: Common,
    },
    /// KITTI labels or results of the tracking or object benchmark
    Kitti {
        /// File of a sequence (tracking), or folder with one file per image (objects)
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A CSV table of boxes
    Csv {
        /// The file, with a header or with the columns frame, x0, y0, x1, y1 [, score]
        #[arg(value_name = "FILE.csv")]
        path: PathBuf,
        #[command(flatten)]
        table: TableArgs,
        #[command(flatten)]
        common: Common,
    },
    /// The file of supervision's CSVSink or JSONSink
    Supervision {
        /// The file
        #[arg(value_name = "FILE")]
        path: PathBuf,
        #[command(flatten)]
        table: TableArgs,
        #[command(flatten)]
        common: Common,
    },
    /// LabelMe's annotations
    Labelme {
        /// Folder with one file per image, or a single file
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
    /// Pascal VOC: XML files with boxes, as written by labelImg, CVAT and Roboflow
    Voc {
        /// Folder with one file per image, or a single file
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
    /// Boxer's and WildDet3D's CSV of 3D boxes per frame, matched by time
    Boxer {
        /// The file (boxer_3dbbs.csv)
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
    /// CVAT's XML: boxes, polygons, masks and ellipses of images, or tracks of a video
    Cvat {
        /// The file, or the folder of an export with annotations.xml
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
    /// Label Studio's JSON or JSON-MIN: shapes of images, or tracks of a video
    LabelStudio {
        /// The export
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
}

/// The names of the classes.
#[derive(clap::Args)]
pub struct Names {
    /// Class names: a list with one name per line, or the `names` of a .yaml file
    #[arg(long, value_name = "FILE")]
    names: Option<PathBuf>,
}

impl Names {
    pub fn read(&self) -> Result<Option<ClassNames>, ReadError> {
        self.names.as_deref().map(read_names).transpose()
    }
}

/// Options of tables.
#[derive(clap::Args)]
pub struct TableArgs {
    /// The column that identifies the image of a row (default: detected by name)
    #[arg(long, value_name = "NAME")]
    frame_column: Option<String>,
    #[command(flatten)]
    names: Names,
    #[command(flatten)]
    pixels: Pixels,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum MotColumns {
    Auto,
    Det,
    Gt,
    Class,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum YoloShapes {
    Auto,
    Box,
    Polygon,
    Obb,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum YoloColumns {
    Auto,
    None,
    Score,
    Track,
    #[value(name = "score+track")]
    ScoreAndTrack,
}

impl Format {
    /// Common parts of every format: its name, the file or folder, and shared options.
    pub fn parts(&self) -> (DetectionFormat, &Path, &Common) {
        match self {
            Self::Coco { path, common, .. } => (DetectionFormat::Coco, path, common),
            Self::Mot { path, common, .. } => (DetectionFormat::Mot, path, common),
            Self::Yolo { path, common, .. } => (DetectionFormat::Yolo, path, common),
            Self::Kitti { path, common, .. } => (DetectionFormat::Kitti, path, common),
            Self::Csv { path, common, .. } => (DetectionFormat::Csv, path, common),
            Self::Supervision { path, common, .. } => (DetectionFormat::Supervision, path, common),
            Self::Labelme { path, common, .. } => (DetectionFormat::LabelMe, path, common),
            Self::Voc { path, common, .. } => (DetectionFormat::Voc, path, common),
            Self::Cvat { path, common, .. } => (DetectionFormat::Cvat, path, common),
            Self::LabelStudio { path, common, .. } => (DetectionFormat::LabelStudio, path, common),
            Self::Boxer { path, common, .. } => (DetectionFormat::Boxer, path, common),
        }
    }

    /// Origin of pixel coordinates.
    pub fn pixel_centers(&self) -> PixelCenters {
        match self {
            Self::Kitti { pixels, .. } => pixels.centers(),
            Self::Csv { table, .. } | Self::Supervision { table, .. } => table.pixels.centers(),
            _ => PixelCenters::Half,
        }
    }

    pub fn read(&self) -> Result<DetectionFiles, ReadError> {
        match self {
            Self::Coco { path, annotations, .. } => read_coco(path, annotations.as_deref()),
            Self::Mot { path, columns, box_origin, names, .. } => {
                let kind = match columns {
                    MotColumns::Auto => MotKind::Auto,
                    MotColumns::Det => MotKind::Detections,
                    MotColumns::Gt => MotKind::GroundTruth,
                    MotColumns::Class => MotKind::Classes,
                };
                let names = names.read()?;
                read_mot(path, &MotOptions { kind, boxes_from_zero: *box_origin == 0, names: names.as_ref() })
            }
            Self::Yolo { path, kind, columns, names, .. } => {
                let kind = match kind {
                    YoloShapes::Auto => YoloKind::Auto,
                    YoloShapes::Box => YoloKind::Box,
                    YoloShapes::Polygon => YoloKind::Polygon,
                    YoloShapes::Obb => YoloKind::TurnedBox,
                };
                let extra = match columns {
                    YoloColumns::Auto => ExtraColumns::Auto,
                    YoloColumns::None => ExtraColumns::None,
                    YoloColumns::Score => ExtraColumns::Score,
                    YoloColumns::Track => ExtraColumns::Track,
                    YoloColumns::ScoreAndTrack => ExtraColumns::ScoreAndTrack,
                };
                let names = names.read()?;
                read_yolo(path, &YoloOptions { kind, extra, names: names.as_ref() })
            }
            Self::Kitti { path, .. } => read_kitti_labels(path),
            Self::Csv { path, table, .. } => {
                let names = table.names.read()?;
                read_csv(path, &table.options(names.as_ref()))
            }
            Self::Supervision { path, table, .. } => {
                let names = table.names.read()?;
                read_supervision(path, &table.options(names.as_ref()))
            }
            Self::Labelme { path, .. } => read_labelme(path),
            Self::Voc { path, .. } => read_voc(path),
            Self::Cvat { path, .. } => read_cvat(path),
            Self::LabelStudio { path, .. } => read_label_studio(path),
            Self::Boxer { path, .. } => read_boxer(path),
        }
    }
}

impl TableArgs {
    fn options<'a>(&'a self, names: Option<&'a ClassNames>) -> TableOptions<'a> {
        TableOptions { frame_column: self.frame_column.as_deref(), names }
    }
}

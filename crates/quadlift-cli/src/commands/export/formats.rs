//! The formats with their options.

use std::path::PathBuf;

use quadlift_io::ReadError;
use quadlift_io::read::kitti::read_cam_from_rect;
use quadlift_io::write::bop::bop_results;
use quadlift_io::write::boxer::boxer;
use quadlift_io::write::coco::coco;
use quadlift_io::write::geodesy::Place;
use quadlift_io::write::geojson::{GeoJsonOptions, geojson};
use quadlift_io::write::glb::glb;
use quadlift_io::write::kitti::{KittiLabelOptions, kitti_labels};
use quadlift_io::write::mcap::mcap;
use quadlift_io::write::ply::ply;
use quadlift_io::write::ros::ros;
use quadlift_io::write::{BodyChoice, CheckedScene, Document};

use super::{Common, rerun};
use crate::args;

/// A format and its output.
#[derive(clap::Subcommand)]
pub enum Format {
    #[command(flatten)]
    Bodies(BodyFormat),
    /// CSV: one row per object
    Csv {
        #[command(flatten)]
        common: Common,
        /// Write a second table with the residual of each view of each object
        #[arg(long, value_name = "FILE")]
        views: Option<PathBuf>,
    },
    /// TUM: the trajectory of a camera, as given or refined
    Tum {
        #[command(flatten)]
        common: Common,
        /// The camera, by its id in the scene, if frames have several
        #[arg(long, value_name = "ID")]
        camera: Option<String>,
    },
    /// COLMAP: a folder with the model of the cameras, as given or refined, in text form
    Colmap {
        #[command(flatten)]
        common: Common,
    },
    /// Parquet: a folder of tables with the whole scene file
    Parquet {
        #[command(flatten)]
        common: Common,
    },
    /// Rerun: a folder that examples/to_rerun.py logs as a recording
    Rerun(rerun::Args),
}

/// A format that contains only objects with bodies.
#[derive(clap::Subcommand)]
pub enum BodyFormat {
    /// PLY: meshes of the bodies and camera frusta
    Ply {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        #[command(flatten)]
        cameras: Cameras,
    },
    /// glTF binary: one node per object, and camera frusta; metres, y up
    Glb {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        #[command(flatten)]
        cameras: Cameras,
    },
    /// KITTI tracking labels: upright boxes in the camera frame of each image
    Kitti {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        #[command(flatten)]
        frames: Frames,
        /// KITTI calibration file of the sequence: write locations in the axes of camera 0
        #[arg(long, value_name = "FILE")]
        calib: Option<PathBuf>,
    },
    /// BOP results: poses of the bodies in each frame, millimetres
    Bop {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        frames: Frames,
        /// Value of the column scene_id
        #[arg(long, value_name = "N", default_value_t = 0)]
        scene_id: u64,
    },
    /// CSV of oriented 3D boxes per frame, as Boxer writes them
    Boxer {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        #[command(flatten)]
        frames: Frames,
    },
    /// COCO annotations: the boxes of the bodies in each frame
    Coco {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        #[command(flatten)]
        frames: Frames,
    },
    /// GeoJSON: objects as points on Earth with their error ellipses
    #[command(name = "geojson")]
    GeoJson {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        /// Place of the world's origin: degrees (WGS84), and metres above the ellipsoid (default: the scene's reference_lla)
        #[arg(long, value_name = "LAT,LON,ALT", value_parser = args::place, allow_hyphen_values = true)]
        origin: Option<Place>,
        /// World direction whose horizontal part is north
        #[arg(long, value_name = "X,Y,Z", default_value = "0,1,0", value_parser = args::three_numbers, allow_hyphen_values = true)]
        north: [f64; 3],
    },
    /// MCAP: a log of ROS 2 with 3D detections, markers, cameras and 2D detections
    Mcap {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        /// Name of the world frame in the headers
        #[arg(long, value_name = "NAME", default_value = "map")]
        frame_id: String,
    },
    /// JSON in the structure of ROS 2's vision_msgs/Detection3DArray
    Ros {
        #[command(flatten)]
        common: Common,
        #[command(flatten)]
        bodies: Bodies,
        /// Name of the world frame in the header
        #[arg(long, value_name = "NAME", default_value = "map")]
        frame_id: String,
    },
}

/// Which bodies.
#[derive(clap::Args)]
pub struct Bodies {
    /// Export the enclosing bodies, which contain the real objects, instead of the tangent ones
    #[arg(long)]
    enclosing: bool,
}

/// The frusta of cameras.
#[derive(clap::Args)]
pub struct Cameras {
    /// Depth of the camera frusta in world units; 0 omits them (default: a tenth of the distance to the objects)
    #[arg(long, value_name = "DEPTH", value_parser = args::not_negative)]
    frusta: Option<f64>,
}

/// In which frames an object is written.
#[derive(clap::Args)]
pub struct Frames {
    /// Write only the frames in which the object was detected, instead of all in which it is visible
    #[arg(long)]
    only_detected: bool,
}

impl Bodies {
    fn choice(&self) -> BodyChoice {
        if self.enclosing { BodyChoice::Enclosing } else { BodyChoice::Tangent }
    }
}

impl BodyFormat {
    pub fn common(&self) -> &Common {
        match self {
            Self::Ply { common, .. }
            | Self::Glb { common, .. }
            | Self::Kitti { common, .. }
            | Self::Bop { common, .. }
            | Self::Boxer { common, .. }
            | Self::Coco { common, .. }
            | Self::GeoJson { common, .. }
            | Self::Mcap { common, .. }
            | Self::Ros { common, .. } => common,
        }
    }

    pub fn choice(&self) -> BodyChoice {
        match self {
            Self::Ply { bodies, .. }
            | Self::Glb { bodies, .. }
            | Self::Kitti { bodies, .. }
            | Self::Boxer { bodies, .. }
            | Self::Coco { bodies, .. }
            | Self::GeoJson { bodies, .. }
            | Self::Mcap { bodies, .. }
            | Self::Ros { bodies, .. } => bodies.choice(),
            // A pose has no size.
            Self::Bop { .. } => BodyChoice::Tangent,
        }
    }

    pub fn document(&self, scene: &CheckedScene) -> Result<Document, ReadError> {
        Ok(match self {
            Self::Ply { cameras, .. } => ply(scene, cameras.frusta),
            Self::Glb { cameras, .. } => glb(scene, cameras.frusta),
            Self::Kitti { frames, calib, .. } => {
                let cam_from_rect = calib.as_deref().map(read_cam_from_rect).transpose()?;
                kitti_labels(scene, &KittiLabelOptions { only_detected: frames.only_detected, cam_from_rect })
            }
            Self::Bop { frames, scene_id, .. } => bop_results(scene, *scene_id, frames.only_detected),
            Self::Boxer { frames, .. } => boxer(scene, frames.only_detected),
            Self::Coco { frames, .. } => coco(scene, frames.only_detected),
            Self::GeoJson { common, origin, north, .. } => {
                let options = GeoJsonOptions { origin: *origin, north: *north };
                geojson(scene, &options).map_err(|error| error.in_file(&common.scene))?
            }
            Self::Mcap { frame_id, .. } => mcap(scene, frame_id),
            Self::Ros { frame_id, .. } => ros(scene, frame_id),
        })
    }
}

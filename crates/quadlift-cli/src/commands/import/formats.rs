//! The formats with their options.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use quadlift_io::mcap::{McapOptions, read_mcap};
use quadlift_io::read::arkit::{ArkitOptions, read_arkit};
use quadlift_io::read::bop::{BopOptions, read_bop};
use quadlift_io::read::colmap::{DEFAULT_POINTS, read_colmap};
use quadlift_io::read::kitti::{KittiOptions, read_kitti};
use quadlift_io::read::kitti_raw::{KittiRawOptions, read_kitti_raw};
use quadlift_io::read::nerfstudio::read_nerfstudio;
use quadlift_io::read::nuscenes::{NuscenesOptions, read_nuscenes};
use quadlift_io::read::opensfm::read_opensfm;
use quadlift_io::read::projections::read_projections;
use quadlift_io::read::tum::{TumOptions, read_tum};
use quadlift_io::read::{Import, PixelCenters};

use super::Common;
use crate::args;
use crate::files::make_folder;
use crate::logs::{KeepGoing, LogArgs, LogPoses, tell_problems};
use crate::output::Output;

/// A format and where to read it.
#[derive(clap::Subcommand)]
pub enum Format {
    /// A COLMAP model, text or binary
    Colmap {
        /// Folder of the model (or the one that holds sparse/0)
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Maximum number of sparse points to keep, evenly spread; 0 keeps none and does not read their file
        #[arg(long, value_name = "N", default_value_t = DEFAULT_POINTS)]
        points: usize,
        #[command(flatten)]
        common: Common,
    },
    /// nerfstudio's or instant-ngp's transforms.json
    Nerfstudio {
        /// The file, or its folder
        #[arg(value_name = "PATH")]
        path: PathBuf,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// OpenSfM's or OpenDroneMap's reconstruction.json
    #[command(name = "opensfm")]
    OpenSfm {
        /// The file, or its folder
        #[arg(value_name = "PATH")]
        path: PathBuf,
        /// Maximum number of points to keep, evenly spread; 0 keeps none
        #[arg(long, value_name = "N", default_value_t = DEFAULT_POINTS)]
        points: usize,
        #[command(flatten)]
        common: Common,
    },
    /// A capture of an iPhone or iPad (ARKit): Polycam, Record3D or 3D Scanner App
    Arkit {
        /// Folder of the capture
        #[arg(value_name = "DIR")]
        path: PathBuf,
        #[command(flatten)]
        size: Size,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A TUM trajectory with an intrinsics file
    Tum {
        /// The trajectory: lines `time tx ty tz qx qy qz qw`
        #[arg(value_name = "FILE")]
        path: PathBuf,
        /// File with one line: fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS as in COLMAP
        #[arg(long, value_name = "FILE")]
        intrinsics: PathBuf,
        /// File with lines `time image`: each image gets the pose nearest in time
        #[arg(long, value_name = "FILE")]
        image_list: Option<PathBuf>,
        /// Maximum time difference between an image and its pose, in seconds
        #[arg(long, value_name = "SECONDS", default_value_t = 0.02, value_parser = args::positive)]
        time_tolerance: f64,
        #[command(flatten)]
        size: Size,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A sequence of KITTI's tracking benchmark
    Kitti {
        /// Folder with calib, oxts and label_02
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Name of the sequence, such as 0001
        #[arg(long, value_name = "NAME")]
        sequence: String,
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        size: Size,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A drive of KITTI's raw data
    KittiRaw {
        /// Folder of the drive, with oxts
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Number of the camera: 0, 1 (grey), 2 or 3 (colour)
        #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=3))]
        camera: u8,
        /// Folder of the calibration files (default: the parent folder of the drive)
        #[arg(long, value_name = "DIR")]
        calibration: Option<PathBuf>,
        #[command(flatten)]
        part: Part,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A scene of nuScenes, from its tables
    Nuscenes {
        /// Folder of the data set, or of its tables (v1.0-mini)
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Name of the scene, such as scene-0061 (required if there are several)
        #[arg(long, value_name = "NAME")]
        scene: Option<String>,
        /// Cameras, such as CAM_FRONT,CAM_BACK (default: all)
        #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
        channels: Vec<String>,
        /// Read the images between the key frames too
        #[arg(long)]
        sweeps: bool,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A scene of a BOP data set
    Bop {
        /// Folder of the scene, such as test/000002
        #[arg(value_name = "DIR")]
        path: PathBuf,
        /// Number of the object whose model frame becomes the world frame (required if the scene has no world poses)
        #[arg(long, value_name = "ID")]
        world_object: Option<u64>,
        /// models_info.json (default: searched for in `models` of the parent folders)
        #[arg(long, value_name = "FILE")]
        models: Option<PathBuf>,
        #[command(flatten)]
        size: Size,
        #[command(flatten)]
        common: Common,
    },
    /// A list of 3x4 projections, CSV or JSON
    Projections {
        /// The file
        #[arg(value_name = "FILE")]
        path: PathBuf,
        #[command(flatten)]
        size: Size,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// A log in MCAP, of ROS 2 or Foxglove: cameras, transforms and 2D detections
    Mcap {
        /// The log
        #[arg(value_name = "LOG.mcap")]
        path: PathBuf,
        #[command(flatten)]
        log: LogArgs,
        #[command(flatten)]
        keep_going: KeepGoing,
        #[command(flatten)]
        poses: LogPoses,
        /// Write the compressed images of the log into this folder, for `quadlift segment` and reports
        #[arg(long, value_name = "DIR")]
        write_images: Option<PathBuf>,
        #[command(flatten)]
        pixels: Pixels,
        #[command(flatten)]
        common: Common,
    },
    /// Tables of `quadlift export parquet`, converted back to a scene
    Parquet {
        /// Folder of the tables
        #[arg(value_name = "DIR")]
        path: PathBuf,
        #[command(flatten)]
        common: Common,
    },
}

/// The size of the images.
#[derive(clap::Args)]
pub struct Size {
    /// Width and height of the images in pixels, if the files do not contain them
    #[arg(long, value_name = "WxH", value_parser = args::image_size)]
    pub image_size: Option<[f64; 2]>,
}

/// The origin of pixel coordinates.
#[derive(clap::Args)]
pub struct Pixels {
    /// Position of the centre of the first pixel: 0 (integer) or 0.5 (half) [default: half]
    #[arg(long, value_enum, value_name = "WHERE")]
    pixel_centers: Option<Centers>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Centers {
    Integer,
    Half,
}

impl Pixels {
    pub fn centers(&self) -> PixelCenters {
        match self.pixel_centers {
            Some(Centers::Integer) => PixelCenters::Integer,
            Some(Centers::Half) | None => PixelCenters::Half,
        }
    }

    /// Whether the option is given.
    pub fn is_given(&self) -> bool {
        self.pixel_centers.is_some()
    }
}

/// A part of a sequence.
#[derive(clap::Args)]
pub struct Part {
    /// First and last frame, from 0 (default: all)
    #[arg(long, value_name = "FIRST-LAST", value_parser = args::frame_range)]
    pub frames: Option<RangeInclusive<usize>>,
}

impl Format {
    /// Common parts of every format: its name, the input path, and shared options.
    pub fn parts(&self) -> (&'static str, &Path, &Common) {
        match self {
            Self::Colmap { path, common, .. } => ("COLMAP", path, common),
            Self::Nerfstudio { path, common, .. } => ("nerfstudio", path, common),
            Self::OpenSfm { path, common, .. } => ("OpenSfM", path, common),
            Self::Arkit { path, common, .. } => ("an ARKit capture", path, common),
            Self::Tum { path, common, .. } => ("a TUM trajectory", path, common),
            Self::Kitti { path, common, .. } => ("KITTI tracking", path, common),
            Self::KittiRaw { path, common, .. } => ("KITTI raw", path, common),
            Self::Nuscenes { path, common, .. } => ("nuScenes", path, common),
            Self::Bop { path, common, .. } => ("BOP", path, common),
            Self::Projections { path, common, .. } => ("projections", path, common),
            Self::Mcap { path, common, .. } => ("a log in MCAP", path, common),
            Self::Parquet { path, common, .. } => ("Parquet", path, common),
        }
    }

    /// Whether the format is another form of the scene file: then nothing is added to the scene.
    pub fn is_scene(&self) -> bool {
        matches!(self, Self::Parquet { .. })
    }

    /// Reads it; what is left out is printed.
    pub fn read(&self, out: &Output) -> anyhow::Result<Import> {
        Ok(match self {
            Self::Colmap { path, points, .. } => read_colmap(path, *points)?,
            Self::Nerfstudio { path, pixels, .. } => read_nerfstudio(path, pixels.centers())?,
            Self::OpenSfm { path, points, .. } => read_opensfm(path, *points)?,
            Self::Arkit { path, size, pixels, .. } => {
                read_arkit(path, &ArkitOptions { image_size: size.image_size, pixel_centers: pixels.centers() })?
            }
            Self::Tum { path, intrinsics, image_list, time_tolerance, size, pixels, .. } => {
                let options = TumOptions {
                    intrinsics,
                    image_size: size.image_size,
                    image_list: image_list.as_deref(),
                    time_tolerance: *time_tolerance,
                    pixel_centers: pixels.centers(),
                };
                read_tum(path, &options)?
            }
            Self::Kitti { path, sequence, part, size, pixels, .. } => {
                let options = KittiOptions {
                    sequence: sequence.clone(),
                    frames: part.frames.clone(),
                    image_size: size.image_size,
                    pixel_centers: pixels.centers(),
                };
                read_kitti(path, &options)?
            }
            Self::KittiRaw { path, camera, calibration, part, pixels, .. } => {
                let options = KittiRawOptions {
                    camera: *camera,
                    frames: part.frames.clone(),
                    calibration: calibration.clone(),
                    pixel_centers: pixels.centers(),
                };
                read_kitti_raw(path, &options)?
            }
            Self::Nuscenes { path, scene, channels, sweeps, pixels, .. } => {
                let options = NuscenesOptions {
                    scene: scene.clone(),
                    channels: channels.clone(),
                    sweeps: *sweeps,
                    pixel_centers: pixels.centers(),
                };
                read_nuscenes(path, &options)?
            }
            Self::Bop { path, world_object, models, size, .. } => {
                let options = BopOptions {
                    world_object: *world_object,
                    models_info: models.clone(),
                    image_size: size.image_size,
                };
                read_bop(path, &options)?
            }
            Self::Projections { path, size, pixels, .. } => read_projections(path, size.image_size, pixels.centers())?,
            Self::Mcap { path, log, keep_going, poses, write_images, pixels, .. } => {
                if let Some(folder) = write_images {
                    make_folder(folder)?;
                }
                let options = log.options(poses.time_tolerance, pixels, keep_going.keep_going);
                let found = read_mcap(path, McapOptions { image_folder: write_images.clone(), ..options })?;
                tell_problems(&found, out);
                found.import
            }
            #[cfg(feature = "parquet")]
            Self::Parquet { path, .. } => {
                // The reader turns panics of the crate parquet on damaged files into errors: say it once, not twice.
                let hook = std::panic::take_hook();
                std::panic::set_hook(Box::new(|_| {}));
                let import = quadlift_io::tables::read_tables(path);
                std::panic::set_hook(hook);
                import?
            }
            #[cfg(not(feature = "parquet"))]
            Self::Parquet { .. } => return crate::error::usage(crate::words::NO_PARQUET),
        })
    }
}

//! `localize --cameras --detections`: the scene is made of other programs' files, whose formats are recognised.

use std::path::{Path, PathBuf};

use anyhow::Context;
use quadlift_io::detect::{CameraFormat, DetectionFormat, detect_cameras, detect_detections};
use quadlift_io::mcap::{McapOptions, read_mcap};
use quadlift_io::read::arkit::{ArkitOptions, read_arkit};
use quadlift_io::read::bop::{BopOptions, read_bop};
use quadlift_io::read::colmap::{DEFAULT_POINTS, read_colmap};
use quadlift_io::read::detections::csv::TableOptions;
use quadlift_io::read::detections::{add_detections, read_detections};
use quadlift_io::read::kitti::{KittiOptions, read_kitti};
use quadlift_io::read::kitti_raw::{KittiRawOptions, read_kitti_raw};
use quadlift_io::read::nerfstudio::read_nerfstudio;
use quadlift_io::read::nuscenes::{NuscenesOptions, read_nuscenes};
use quadlift_io::read::opensfm::read_opensfm;
use quadlift_io::read::projections::read_projections;
use quadlift_io::read::tum::{TumOptions, read_tum};
use quadlift_io::read::{Import, PixelCenters};
use quadlift_io::{SceneFile, read_scene_file};

use crate::commands::import::formats::{Part, Pixels};
use crate::commands::import::paths::{prefix_images, relative_to_file};
use crate::commands::import_detections::{Matching, Names, in_words, notes};
use crate::corrections::DetectionPixels;
use crate::error::usage;
use crate::logs::{KeepGoing, LogArgs, tell_problems};
use crate::output::{Output, one_line};
use crate::words::count;

/// Cameras and detections in other programs' files.
#[derive(clap::Args)]
#[command(next_help_heading = "Files of other programs")]
pub struct DirectArgs {
    /// Cameras and poses: whatever `quadlift import` reads, or a scene file
    #[arg(long, value_name = "PATH", requires = "detections")]
    cameras: Option<PathBuf>,

    /// Detections: whatever `quadlift import-detections` reads
    #[arg(long, value_name = "PATH", requires = "cameras")]
    detections: Option<PathBuf>,

    #[command(flatten)]
    names: Names,

    /// The data set that names images and categories of a list of COCO results
    #[arg(long, value_name = "FILE.json")]
    annotations: Option<PathBuf>,

    /// The column of a table that tells which image a row belongs to
    #[arg(long, value_name = "NAME")]
    frame_column: Option<String>,

    #[command(flatten)]
    matching: Matching,

    #[command(flatten)]
    pixels: Pixels,

    /// KITTI: name of the sequence, such as 0001 (default: that of the detections); nuScenes: name of the scene
    #[arg(long, value_name = "NAME")]
    sequence: Option<String>,

    #[command(flatten)]
    part: Part,

    /// TUM: file of the intrinsics
    #[arg(long, value_name = "FILE")]
    intrinsics: Option<PathBuf>,

    /// BOP: number of the object whose model frame is the world
    #[arg(long, value_name = "ID")]
    world_object: Option<u64>,
}

/// Ids of the options that say how files of other programs are read, without effect on scene files.
pub const ONLY_DIRECT: [&str; 8] =
    ["names", "annotations", "frame_column", "by", "sequence", "frames", "intrinsics", "world_object"];

impl DirectArgs {
    /// The minimum score of detections.
    pub fn min_score(&self) -> Option<f64> {
        self.matching.min_score
    }

    /// How near in time transforms must be in a log, and its pixels.
    pub fn log_options(&self) -> (f64, &Pixels) {
        (self.matching.time_tolerance.unwrap_or(McapOptions::default().time_tolerance), &self.pixels)
    }

    /// The first of the options that is given and has an effect on files of other programs and on logs alone.
    pub fn first_given(&self) -> Option<&'static str> {
        let given =
            [("--time-tolerance", self.matching.time_tolerance.is_some()), ("--pixel-centers", self.pixels.is_given())];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name)
    }

    /// Paths of cameras and detections, if given.
    pub fn paths(&self) -> Option<(&Path, &Path)> {
        self.cameras.as_deref().zip(self.detections.as_deref())
    }

    /// The scene, with the detections of one source. Paths of images are relative to the output. What was read is
    /// reported. Returns the number that the detections give to the frame number 0 too.
    pub fn read(
        &self,
        [cameras, detections]: [&Path; 2],
        output: Option<&Path>,
        (source, pixels): (Option<&str>, DetectionPixels),
        log: (&LogArgs, &KeepGoing),
        out: &Output,
    ) -> anyhow::Result<(SceneFile, i64)> {
        let (camera_format, camera_path) = detect_cameras(cameras)?;
        let detection_format = detect_detections(detections)?;
        let (mut file, camera_notes) =
            self.read_cameras((camera_format, &camera_path), (detections, pixels.image_size), output, log, out)?;
        let names = self.names.read()?;
        let table = TableOptions { frame_column: self.frame_column.as_deref(), names: names.as_ref() };
        let found = read_detections(detection_format, detections, self.annotations.as_deref(), &table)?;
        let found_notes = found.notes.clone();
        let pixel_centers = match detection_format {
            DetectionFormat::Kitti | DetectionFormat::Csv | DetectionFormat::Supervision => self.pixels.centers(),
            _ => PixelCenters::Half,
        };
        let source = source.unwrap_or(detection_format.name());
        let mut options = self.matching.options(source, pixels, pixel_centers);
        // Cameras may come with detections, such as KITTI labels.
        options.replace = true;
        file.objects.clear();
        let added = add_detections(&mut file, found, &options)?;
        let mut text = format!(
            "{}: {}, {}\n{}: {}, {}\n",
            cameras.display(),
            camera_format.name(),
            count(file.frames.len(), "frame"),
            detections.display(),
            detection_format.name(),
            one_line(&in_words(&added, source))
        );
        for note in [camera_notes, found_notes, notes(&added)].concat() {
            text.push_str(&format!("- {}\n", one_line(&note)));
        }
        out.report(&format!("{text}\n"))?;
        Ok((file, added.frame_offset))
    }

    fn read_cameras(
        &self,
        (format, path): (CameraFormat, &Path),
        (detections, image_size): (&Path, Option<[f64; 2]>),
        output: Option<&Path>,
        (log, keep_going): (&LogArgs, &KeepGoing),
        out: &Output,
    ) -> anyhow::Result<(SceneFile, Vec<String>)> {
        let Import { mut scene, image_folder, notes } = match format {
            CameraFormat::Scene => {
                let mut scene = read_scene_file(path)?;
                if let Some(output) = output {
                    scene.move_paths([path, output].map(|path| path.parent().unwrap_or(Path::new(""))))?;
                }
                return Ok((scene, Vec::new()));
            }
            CameraFormat::Colmap => read_colmap(path, DEFAULT_POINTS)?,
            CameraFormat::Nerfstudio => read_nerfstudio(path, self.pixels.centers())?,
            CameraFormat::OpenSfm => read_opensfm(path, DEFAULT_POINTS)?,
            CameraFormat::Arkit => {
                read_arkit(path, &ArkitOptions { image_size, pixel_centers: self.pixels.centers() })?
            }
            CameraFormat::Tum => {
                let Some(intrinsics) = &self.intrinsics else {
                    return usage("a TUM trajectory has no intrinsics: set their file with --intrinsics FILE");
                };
                let options = TumOptions {
                    intrinsics,
                    image_size,
                    image_list: None,
                    time_tolerance: 0.02,
                    pixel_centers: self.pixels.centers(),
                };
                read_tum(path, &options)?
            }
            CameraFormat::Kitti => {
                let of_detections = detections.file_stem().map(|stem| stem.to_string_lossy().into_owned());
                let exists = |name: &String| path.join("calib").join(format!("{name}.txt")).is_file();
                let Some(sequence) = self.sequence.clone().or(of_detections.filter(exists)) else {
                    return usage("the folder holds several KITTI sequences: choose one with --sequence NAME");
                };
                let options = KittiOptions {
                    sequence,
                    frames: self.part.frames.clone(),
                    image_size,
                    pixel_centers: self.pixels.centers(),
                };
                read_kitti(path, &options)?
            }
            CameraFormat::KittiRaw => {
                let options = KittiRawOptions {
                    camera: 2,
                    frames: self.part.frames.clone(),
                    calibration: None,
                    pixel_centers: self.pixels.centers(),
                };
                read_kitti_raw(path, &options)?
            }
            CameraFormat::Nuscenes => {
                let scene = self.sequence.clone();
                let pixel_centers = self.pixels.centers();
                read_nuscenes(path, &NuscenesOptions { scene, pixel_centers, ..NuscenesOptions::default() })?
            }
            CameraFormat::Bop => {
                read_bop(path, &BopOptions { world_object: self.world_object, models_info: None, image_size })?
            }
            CameraFormat::Projections => read_projections(path, image_size, self.pixels.centers())?,
            CameraFormat::Mcap => {
                let (time_tolerance, pixels) = self.log_options();
                let options = log.options(time_tolerance, pixels, keep_going.keep_going);
                let found = read_mcap(path, McapOptions { without_detections: true, ..options })?;
                tell_problems(&found, out);
                found.import
            }
        };
        if let Some((folder, output)) = image_folder.zip(output) {
            let prefix = relative_to_file(&folder, output)
                .with_context(|| format!("cannot find the folder {}", folder.display()))?;
            prefix_images(&mut scene, &prefix, &prefix);
        }
        Ok((scene, notes))
    }
}

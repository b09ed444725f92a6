//! The options of `quadlift localize`.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, RangedU64ValueParser, TypedValueParser};
use quadlift::cross_validation::Extent;
use quadlift::run::RunOptions;
use quadlift::solve::{BodyKind, Method, PoseMotion, PoseNoise, Sigmas};
use quadlift::{LocalizeOptions, MeasurementKind};
use quadlift_io::read_scene_file;
use quadlift_io::run::{FileOptions, PriorSource};

use super::direct::{DirectArgs, ONLY_DIRECT};
use crate::args::{self, BodyChoice, DetailName, SigmaSource};
use crate::association::{IdsName, When};
use crate::corrections::{CheckArgs, Corrections};
use crate::error::usage;
use crate::localization::file_options;
use crate::logs::{KeepGoing, LogArgs};

/// Estimate 3D objects from the detections of a scene
///
/// The result is a scene file: the cameras and frames of the scene, the estimated objects with status, uncertainty and
/// residuals, and the settings. The true objects of a scene, if it has any, are neither read nor copied.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Several scenes (several paths, a folder, or a pattern in quotes) are localised one after another; OUT is then a folder,
and each result has the file name of its scene. If a scene fails, it is reported and the others are still processed.

--cameras and --detections read files of other programs and detect their formats; the main options of `quadlift import`
and `quadlift import-detections` are available here too.

A log in MCAP (ROS 2, Foxglove) is read as `quadlift import mcap` reads it.

Examples:
  quadlift localize scene.json -o estimate.json --report estimate.html
  quadlift localize --cameras sparse/0 --detections runs/detect/predict -o objects.json
  quadlift localize street.json -o cars.json --source yolo --body cuboid --priors builtin
  quadlift localize log.mcap -o objects.json
  quadlift localize scenes/ -o estimates/
  quadlift localize 'scenes/kitti_*.json' -o estimates/ --json

Exit codes: 0 success; 1 a scene failed, or none of its objects could be localised; 2 wrong usage; 3 a scene is
inconsistent (poses, cameras and boxes do not fit together), and --accept-inconsistent is not given."
)]
pub struct Args {
    /// Scene files, folders that hold them, patterns in quotes, or logs in MCAP
    #[arg(required_unless_present = "cameras", conflicts_with = "cameras", value_name = "SCENE.json")]
    pub(super) scenes: Vec<PathBuf>,

    /// Output file (for several scenes: a folder); without it the result is only printed
    #[arg(short, long, value_name = "OUT.json")]
    pub(super) output: Option<PathBuf>,

    /// Write an HTML report (for several scenes: a folder)
    #[arg(long, value_name = "OUT.html")]
    pub(super) report: Option<PathBuf>,

    /// Level of detail of the result: full, or brief (no covariances, no figures of single views; a third of the size)
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = DetailName::Full, hide_possible_values = true)]
    pub(super) detail: DetailName,

    /// Estimator: map (refinement, the best), planes, lfd and pfd (closed forms), reg (the regularised one)
    #[arg(long, value_name = "METHOD", default_value = "map", value_parser = method(), hide_possible_values = true)]
    method: Method,

    /// Weight of the regulariser, for --method reg only [default: 1e16]
    #[arg(long, value_name = "X", value_parser = args::finite)]
    lambda: Option<f64>,

    /// Kind of body to fit: ellipsoid, cuboid, cylinder, superellipsoid:Q (Q from 1, cuboid, to 2, ellipsoid), or auto:
    /// selected for each object, an ellipsoid without evidence for another kind
    #[arg(long, value_name = "BODY", default_value = "auto", value_parser = args::body_choice)]
    body: BodyChoice,

    /// Use only the detections of this source; required if the scene has several
    #[arg(long, value_name = "NAME")]
    pub(super) source: Option<String>,

    /// Measurements to use: auto (what a detection has; if both, the box for position and size, the ellipse for shape),
    /// box, ellipse, box+ellipse, or mask (its outline, with map and planes; also outlines and turned boxes). Detections without the
    /// selected measurement are skipped
    #[arg(long, value_name = "WHAT", default_value = "auto", value_parser = observations(), hide_possible_values = true)]
    observations: MeasurementKind,

    /// Associate detections that show the same object first: auto (if any lack an id), never or always
    #[arg(long, value_enum, value_name = "WHEN", default_value_t = When::Auto, hide_possible_values = true)]
    pub(super) associate: When,

    /// How far to trust existing ids: trust, evidence or ignore [default: trust; with --associate always:
    /// evidence]
    #[arg(long, value_enum, value_name = "WHAT", hide_possible_values = true)]
    pub(super) ids: Option<IdsName>,

    /// Priors on categories: "builtin" (for scenes in metres), a TOML file, or "scene": the size of each category is learnt
    /// from its other objects. May be repeated for "scene" beside one of the others, which then wins
    #[arg(long, value_name = "builtin|FILE|scene")]
    priors: Vec<PathBuf>,

    /// Skip objects with fewer views
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    min_views: usize,

    /// Skip detections that are more occluded (KITTI: 0 visible, 1 partly, 2 largely, 3 unknown)
    #[arg(long, value_name = "LEVEL", value_parser = args::finite)]
    max_occluded: Option<f64>,

    /// Skip detections that are more truncated (KITTI: 0 entirely inside the image)
    #[arg(long, value_name = "LEVEL", value_parser = args::finite)]
    max_truncated: Option<f64>,

    /// Do not detect which objects stand upright (with an axis along the scene's `up`)
    #[arg(long)]
    no_upright: bool,

    /// All objects stand on a common ground plane, which is estimated (the scene needs `up`)
    #[arg(long)]
    ground_plane: bool,

    /// Height of the cameras above the ground plane in world units, if known
    #[arg(long, value_name = "H", value_parser = args::positive)]
    camera_height: Option<f64>,

    /// Correct the poses together with the objects. Errors of frames are independent, or slow (GPS, drifting odometry);
    /// auto (default) decides by the boxes. Results have the corrected poses
    #[arg(long, value_name = "MOTION", num_args = 0..=1, require_equals = true, default_missing_value = "auto",
          value_parser = pose_motion(), hide_possible_values = true)]
    refine_poses: Option<PoseMotion>,

    /// Take the places of cameras in their rig as exact: --refine-poses then corrects the pose of the rig alone (frames with
    /// the same `rig_frame` are taken by one rig)
    #[arg(long, requires = "refine_poses")]
    fixed_extrinsics: bool,

    /// Correct the poses: standard deviations of the rotation (radians) and shift (world units) of each frame
    #[arg(long, value_name = "RAD,LENGTH", value_parser = args::pose_noise)]
    pose_noise: Option<PoseNoise>,

    /// Use given noise levels instead of estimating them: from an earlier result, or by name
    /// (edge_relative=0.03,edge_px=2). Objects are then estimated independently of each other
    #[arg(long, value_name = "RESULT.json|NAME=X,...", value_parser = args::sigmas)]
    sigmas: Option<SigmaSource>,

    /// Leave out each view of each object, predict its box from the others, and report the agreement: a measure of
    /// quality without ground truth. Takes several times as long; the summary always checks a sample of views
    #[arg(long)]
    cross_validate: bool,

    /// Calibrate the confidence regions on an earlier result and the scene with its true objects (may be repeated): the
    /// result then lists calibrated limits
    #[arg(long, num_args = 2, value_names = ["RESULT.json", "TRUTH.json"], action = clap::ArgAction::Append)]
    pub(super) calibration: Vec<PathBuf>,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub(super) threads: Option<usize>,

    #[command(flatten)]
    pub(super) corrections: Corrections,

    #[command(flatten)]
    pub(super) check: CheckArgs,

    #[command(flatten)]
    pub(super) direct: DirectArgs,

    #[command(flatten)]
    pub(super) log: LogArgs,

    #[command(flatten)]
    pub(super) keep_going: KeepGoing,
}

/// The command, in which options that have no effect on scene files need `--cameras`.
pub fn with_requirements(command: clap::Command) -> clap::Command {
    ONLY_DIRECT.iter().fold(command, |command, id| command.mut_arg(id, |option| option.requires("cameras")))
}

impl Args {
    pub(super) fn options(&self) -> anyhow::Result<FileOptions> {
        let mut method = self.method.clone();
        let options_of_map = [
            (self.body.0.is_some_and(|body| body != BodyKind::Ellipsoid), "--body is an option"),
            (
                self.ground_plane || self.camera_height.is_some() || self.pose_noise.is_some(),
                "--ground-plane, --camera-height and --pose-noise are options",
            ),
            (self.refine_poses.is_some(), "--refine-poses is an option"),
            (self.no_upright, "--no-upright is an option"),
            (self.sigmas.is_some(), "--sigmas is an option"),
            (!self.priors.is_empty(), "--priors is an option"),
        ];
        match &mut method {
            Method::Map(map) => {
                map.body = self.body.0;
                map.upright = !self.no_upright;
                map.ground_plane = self.ground_plane;
                map.camera_height = self.camera_height;
                map.pose_noise = self.pose_noise;
                map.refine_poses = self.refine_poses;
                map.refine_extrinsics = !self.fixed_extrinsics;
                map.sigmas = self.sigmas.as_ref().map(read_sigmas).transpose()?;
                map.learn_sizes = self.priors.iter().any(|name| name.as_os_str() == "scene");
            }
            _ => {
                if let Some((_, what)) = options_of_map.into_iter().find(|(given, _)| *given) {
                    return usage(format!("{what} of --method map only"));
                }
                if !self.calibration.is_empty() {
                    return usage(
                        "--calibration is an option of --method map only: the other methods give no covariance",
                    );
                }
            }
        }
        match (&mut method, self.lambda) {
            (Method::Reg(reg), Some(lambda)) => reg.lambda = lambda,
            (_, Some(_)) => return usage("--lambda is an option of --method reg only"),
            _ => {}
        }
        let given: Vec<&PathBuf> = self.priors.iter().filter(|name| name.as_os_str() != "scene").collect();
        let priors = match given[..] {
            [] => PriorSource::None,
            [name] if name.as_os_str() == "builtin" => PriorSource::Builtin,
            [path] => PriorSource::File(path.clone()),
            [first, second, ..] => {
                return usage(format!(
                    "--priors is given as {} and as {}; expected one file or builtin, and scene beside it",
                    first.display(),
                    second.display()
                ));
            }
        };
        let mut localize = LocalizeOptions {
            method,
            source: self.source.clone(),
            min_views: self.min_views,
            max_occluded: self.max_occluded,
            max_truncated: self.max_truncated,
            measurements: self.observations,
            seed: self.seed,
            accept_inconsistent: self.check.accept_inconsistent,
            ..Default::default()
        };
        if self.cross_validate {
            localize.cross_validation.extent = Extent::All;
        }
        let run = RunOptions {
            localize,
            associate: self.associate.of_library(),
            ids: self.ids.map(IdsName::use_of_ids),
            fix: self.check.fix,
        };
        file_options(run, priors)
    }
}

/// Reads a method by its name.
fn method() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(Method::NAMES).try_map(|name| name.parse::<Method>())
}

/// Reads a kind of measurement by its name.
fn observations() -> impl TypedValueParser<Value = MeasurementKind> {
    PossibleValuesParser::new(MeasurementKind::NAMES).try_map(|name| name.parse::<MeasurementKind>())
}

/// Reads a motion of pose errors by its name.
fn pose_motion() -> impl TypedValueParser<Value = PoseMotion> {
    PossibleValuesParser::new(PoseMotion::NAMES).try_map(|name| name.parse::<PoseMotion>())
}

/// Noise levels that were given, or those of an earlier result.
fn read_sigmas(source: &SigmaSource) -> anyhow::Result<Sigmas> {
    match source {
        SigmaSource::Given(sigmas) => Ok(sigmas.clone()),
        SigmaSource::Result(path) => {
            let file = read_scene_file(path)?;
            file.noise_levels().map_err(|error| error.in_file(path).into())
        }
    }
}

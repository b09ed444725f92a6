//! The options of `quadlift localize`.

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use quadlift_io::options::{Spelling, check_needs_posterior};
use quadlift_io::run::FileOptions;

use super::direct::DirectArgs;
use crate::corrections::Corrections;
use crate::error::usage;
use crate::localization::{file_options, prior_source};
use crate::options::{Chosen, Localize};

/// Estimate 3D objects from detections
///
/// The result is a scene file: the cameras and frames of the scene, the estimated objects with status, uncertainty and
/// residuals, and the settings. The true objects of a scene, if it has any, are neither read nor copied.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Several scenes (several paths, a folder, or a pattern in quotes) are localized one after another; OUT is then a folder,
and each result has the file name of its scene. If a scene fails, it is reported and the others are still processed.

--cameras and --detections read files of other programs and detect their formats; the options of `quadlift import` are
available here too.

A log in MCAP (ROS 2, Foxglove) is read as `quadlift import mcap` reads it.

Examples:
  quadlift localize scene.json -o estimate.json --report estimate.html
  quadlift localize --cameras sparse/0 --detections runs/detect/predict -o objects.json
  quadlift localize street.json -o cars.json --source yolo --body cuboid --priors builtin
  quadlift localize log.mcap -o objects.json
  quadlift localize scenes/ -o estimates/
  quadlift localize 'scenes/kitti_*.json' -o estimates/ --json

Exit codes: 0 success; 1 a scene failed, or none of its objects could be localized; 2 wrong usage; 3 a scene is
inconsistent (poses, cameras and boxes do not fit together), and --allow-inconsistent is not given."
)]
pub(crate) struct Args {
    /// Scene files, folders that hold them, patterns in quotes, or logs in MCAP; - is the standard input
    #[arg(required_unless_present = "cameras", conflicts_with = "cameras", value_name = "SCENE.json")]
    pub(super) scenes: Vec<PathBuf>,

    /// Output file (for several scenes: a folder); without it the result is only printed
    #[arg(short, long, value_name = "OUT.json")]
    pub(super) output: Option<PathBuf>,

    /// Write an HTML report (for several scenes: a folder)
    #[arg(long, value_name = "OUT.html")]
    pub(super) report: Option<PathBuf>,

    /// Write results without covariances, figures of single views, and detections whose ids were given: a third of the size
    #[arg(long)]
    pub(super) compact: bool,

    /// Priors on categories: "builtin" (for scenes in meters), or a TOML file
    #[arg(long, value_name = "builtin|FILE.toml")]
    priors: Option<PathBuf>,

    #[command(flatten)]
    chosen: Chosen<Localize>,

    /// Calibrate the confidence regions on an earlier result and the scene with its true objects (may be repeated): the
    /// result then lists calibrated limits
    #[arg(long, num_args = 2, value_names = ["RESULT.json", "GROUND_TRUTH.json"], action = clap::ArgAction::Append)]
    pub(super) coverage: Vec<PathBuf>,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    pub(super) threads: Option<usize>,

    #[command(flatten)]
    pub(super) corrections: Corrections,

    #[command(flatten)]
    pub(super) direct: DirectArgs,
}

/// The command, in which the option that has no effect on scene files and logs needs `--cameras`.
pub(crate) fn with_requirements(command: clap::Command) -> clap::Command {
    command.mut_arg("by", |option| option.requires("cameras"))
}

impl Args {
    /// The options of the runs. Reads the priors.
    pub(super) fn options(&self) -> anyhow::Result<FileOptions> {
        let run = self.chosen.options()?;
        let of_posterior = [("priors", self.priors.is_some()), ("coverage", !self.coverage.is_empty())];
        for (name, _) in of_posterior.into_iter().filter(|(_, is_given)| *is_given) {
            check_needs_posterior(&run, name, Spelling::Flag).or_else(usage)?;
        }
        file_options(run, prior_source(self.priors.as_deref()))
    }
}

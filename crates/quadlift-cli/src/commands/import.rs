//! `quadlift import`: files of other programs become a scene file, or detections of one. A subcommand for each format, made
//! of its row.

pub(crate) mod matching;
pub(crate) mod paths;
pub(crate) mod words;
mod cameras;
mod detections;

use std::path::PathBuf;

use clap::error::ErrorKind;
use clap::{Arg, ArgMatches, FromArgMatches, value_parser};
use quadlift_io::formats;
use quadlift_io::read::{DetectionFormat, PoseFormat, READ, ReadOptions};

use crate::error::Outcome;
use crate::output::Output;
use crate::reading::{Given, arguments};

const ABOUT: &str = "Import cameras, poses or detections";

const LONG_ABOUT: &str = "\
Import cameras, poses or detections of another program

Cameras and poses become a scene file. Axes, transforms, pixel origins, quaternions and units are converted to the conventions
of scene files. Detections are added to a scene, --into: their images are matched to its frames by name, number or time. Track
ids become object ids; without them, `quadlift localize` associates the detections. Existing detections of the scene are kept
under their own source. Conversions and assumptions are printed and stored in the notes of the scene.";

const AFTER: &str = "\
Examples:
  quadlift import colmap model/ -o scene.json
  quadlift import kitti training/ --sequence 0001 --frames 90-106 -o scene.json
  quadlift import tum trajectory.txt --intrinsics camera.txt --image-size 640x480 -o scene.json
  quadlift import yolo runs/detect/predict --into scene.json -o detected.json
  quadlift import coco results.json --into scene.json -o detected.json --annotations instances.json
  quadlift import csv boxes.csv --into scene.json -o detected.json --min-score 0.5

Exit codes: 0 success; 1 a file could not be read or written, or no image is a frame of the scene; 2 wrong usage.";

/// A format, and what is read and written.
pub(crate) struct Args {
    path: PathBuf,
    given: Given<ReadOptions>,
    format: Format,
}

enum Format {
    Cameras(&'static PoseFormat, cameras::CameraArgs),
    Detections(&'static DetectionFormat, detections::DetectionArgs),
}

/// Whether a format of detections takes an option; that of time is for matching.
fn takes(format: &DetectionFormat, option: &str) -> bool {
    option == "time_tolerance" || format.options.contains(&option)
}

/// The subcommand of a format with the options of its kind and of its reader.
fn subcommand<A: clap::Args>(name: &'static str, about: &'static str, takes: impl Fn(&str) -> bool) -> clap::Command {
    let path = Arg::new("path").value_name("PATH").required(true).value_parser(value_parser!(PathBuf));
    let command = A::augment_args(clap::Command::new(name).arg(path.help("The file or folder")));
    command.args(arguments(READ, takes)).about(about).long_about(None::<&str>)
}

impl clap::Args for Args {
    fn augment_args(command: clap::Command) -> clap::Command {
        let cameras = formats::poses().map(|format| {
            let takes = |option: &str| format.options.contains(&option);
            subcommand::<cameras::CameraArgs>(format.name, format.about, takes)
        });
        let detections = formats::detections().map(|format| {
            subcommand::<detections::DetectionArgs>(format.name, format.about, |option| takes(format, option))
        });
        let command = command.about(ABOUT).long_about(LONG_ABOUT).after_help(AFTER);
        command.subcommand_required(true).arg_required_else_help(true).subcommands(cameras.chain(detections))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Args {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let missing = || clap::Error::new(ErrorKind::MissingSubcommand);
        let (name, matches) = matches.subcommand().ok_or_else(missing)?;
        let path = matches.get_one::<PathBuf>("path").ok_or_else(missing)?.clone();
        if let Some(format) = formats::poses().find(|format| format.name == name) {
            let given = Given::of(matches, READ, |option| format.options.contains(&option));
            let format = Format::Cameras(format, cameras::CameraArgs::from_arg_matches(matches)?);
            return Ok(Self { path, given, format });
        }
        let format = formats::detections().find(|format| format.name == name).ok_or_else(missing)?;
        let given = Given::of(matches, READ, |option| takes(format, option));
        let format = Format::Detections(format, detections::DetectionArgs::from_arg_matches(matches)?);
        Ok(Self { path, given, format })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let options = args.given.options();
    match &args.format {
        Format::Cameras(format, rest) => cameras::import(format, &args.path, &options, rest, out),
        Format::Detections(format, rest) => detections::import(format, &args.path, &options, rest, out),
    }
}

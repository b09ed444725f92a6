//! Logs of robots in MCAP: the options of `import mcap`, `localize` and `stream`.

use quadlift_io::mcap::{McapImport, McapOptions};
use serde_json::{Value, json};

use crate::args;
use crate::commands::import::formats::Pixels;
use crate::output::Output;

/// Problems that are printed, at most.
const MOST_TOLD: usize = 10;

/// How a log is read.
#[derive(clap::Args)]
#[command(next_help_heading = "Logs in MCAP")]
pub struct LogArgs {
    /// Topics to use instead of all others of their kinds
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    topics: Vec<String>,

    /// The frame in which objects are located [default: the root of the camera's transforms]
    #[arg(long, value_name = "NAME")]
    world_frame: Option<String>,

    /// The frame of the camera [default: the frame_id of its calibration]
    #[arg(long, value_name = "NAME")]
    camera_frame: Option<String>,

    /// Longest time between two transforms that is interpolated, in seconds [default: 1]
    #[arg(long, value_name = "SECONDS", value_parser = args::positive)]
    max_gap: Option<f64>,

    /// The boxes were measured in the rectified image: use the matrices P and R, not K and D
    #[arg(long)]
    rectified: bool,
}

/// Parts that cannot be used, which `quadlift stream` reports as events.
#[derive(clap::Args)]
#[command(next_help_heading = "Logs in MCAP")]
pub struct KeepGoing {
    /// Leave out what is damaged or cannot be read, and use the rest
    #[arg(long)]
    pub keep_going: bool,
}

/// How exact the poses of a log must be.
#[derive(clap::Args)]
#[command(next_help_heading = "Logs in MCAP")]
pub struct LogPoses {
    /// Maximum time between an image and the nearest transform before the first or after the last one, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = McapOptions::default().time_tolerance, value_parser = args::positive)]
    pub time_tolerance: f64,
}

impl LogArgs {
    /// The options of the reader.
    pub fn options(&self, time_tolerance: f64, pixels: &Pixels, keep_going: bool) -> McapOptions {
        let default = McapOptions::default();
        McapOptions {
            topics: self.topics.clone(),
            world_frame: self.world_frame.clone(),
            camera_frame: self.camera_frame.clone(),
            time_tolerance,
            longest_gap: self.max_gap.unwrap_or(default.longest_gap),
            rectified: self.rectified,
            pixel_centers: pixels.centers(),
            keep_going,
            ..default
        }
    }

    /// What must be the same when a stream goes on, by the names of the options; `null` where nothing is given.
    pub fn lasting(&self) -> [(String, Value); 4] {
        let options = [
            ("topics", json!(Some(&self.topics).filter(|topics| !topics.is_empty()))),
            ("world_frame", json!(self.world_frame)),
            ("camera_frame", json!(self.camera_frame)),
            ("rectified", json!(self.rectified.then_some(true))),
        ];
        options.map(|(name, value)| (name.to_owned(), value))
    }

    /// The first of these options that is given.
    pub fn first_given(&self) -> Option<&'static str> {
        let given = [
            ("--topics", !self.topics.is_empty()),
            ("--world-frame", self.world_frame.is_some()),
            ("--camera-frame", self.camera_frame.is_some()),
            ("--max-gap", self.max_gap.is_some()),
            ("--rectified", self.rectified),
        ];
        given.into_iter().find(|(_, is_given)| *is_given).map(|(name, _)| name)
    }
}

/// Prints what was left out of a log.
pub fn tell_problems(found: &McapImport, out: &Output) {
    found.problems.iter().take(MOST_TOLD).for_each(|problem| out.warning(problem));
    if found.problem_count > MOST_TOLD {
        out.warning(&format!("{} more problems of this log", found.problem_count - MOST_TOLD));
    }
}

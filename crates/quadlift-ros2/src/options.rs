//! What the node does, from its parameters.

use std::path::PathBuf;

use quadlift::online::OnlineOptions;
use quadlift::run::{AssociateWhen, RunOptions};
use quadlift::solve::PoseNoise;
use quadlift_io::mcap::LiveOptions;
use quadlift_io::options::{MAP, RUN, Spelling, set_options};
use quadlift_io::read::PixelCenters;
use quadlift_io::run::{FileOptions, PriorSource};
use quadlift_io::stream::{StoredPriors, lasting_options};
use serde_json::{Map, Value, json};

use crate::arguments::Arguments;
use crate::parameters::Parameters;

/// What the node does.
#[derive(Debug, Clone)]
pub struct Options {
    /// The name of the node's diagnostic status.
    pub status_name: String,
    /// Topics of detections, with their absolute names.
    pub detections_topics: Vec<String>,
    /// Topics of calibrations.
    pub camera_info_topics: Vec<String>,
    /// Whether lost messages of detections are sent again.
    pub reliable_detections: bool,
    /// How messages become frames.
    pub live: LiveOptions,
    /// The map.
    pub map: OnlineOptions,
    /// How the objects of the map are estimated.
    pub estimates: FileOptions,
    /// Options that a state goes on with, as `quadlift stream` writes them.
    pub lasting: Map<String, Value>,
    /// Noise of the poses.
    pub pose_noise: Option<PoseNoise>,
    /// What is written and read.
    pub files: Files,
    /// Whether the node goes on from its state.
    pub resume: bool,
    /// Time between estimates in seconds.
    pub publish_period: f64,
}

/// Files of the map.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Files {
    /// The state.
    pub state: Option<PathBuf>,
    /// The result.
    pub map: Option<PathBuf>,
}

impl Files {
    /// The files of these names; an empty name is none.
    pub fn new(state: &str, map: &str) -> Self {
        let path = |name: &str| (!name.is_empty()).then(|| PathBuf::from(name));
        Self { state: path(state), map: path(map) }
    }
}

impl Options {
    /// The options of a command line. A file of priors is read.
    ///
    /// # Errors
    /// A text that names the parameter.
    pub fn new(arguments: &Arguments) -> Result<Self, String> {
        let parameters = &arguments.parameters;
        let topics = |name: &str| -> Result<Vec<String>, String> {
            let topics: Vec<String> = parameters.texts(name).iter().map(|topic| arguments.resolve(topic)).collect();
            if topics.is_empty() {
                return Err(format!("the parameter {name} is empty; expected a topic"));
            }
            Ok(topics)
        };
        let (detections_topics, camera_info_topics) = (topics("detections_topics")?, topics("camera_info_topics")?);
        let live = live_options(parameters, &detections_topics, &camera_info_topics)?;
        let (priors, stored_priors) = match parameters.text("priors") {
            "" => (PriorSource::None, None),
            "builtin" => (PriorSource::Builtin, Some(StoredPriors::Name("builtin".to_owned()))),
            path => (PriorSource::File(path.into()), Some(StoredPriors::Name(path.to_owned()))),
        };
        let mut run = RunOptions { associate: AssociateWhen::Never, ..RunOptions::default() };
        set_options(RUN, &parameters.chosen(RUN), &mut run, Spelling::Parameter)?;
        let pose_noise = run.localize.method.posterior_options().and_then(|map| map.pose_noise);
        let estimates = FileOptions::new(run, priors).map_err(|error| error.to_string())?;
        let mut map = OnlineOptions { priors: estimates.category_priors(), ..OnlineOptions::default() };
        set_options(MAP, &parameters.chosen(MAP), &mut map, Spelling::Parameter)?;
        map.validate().map_err(|error| error.to_string())?;
        let mut lasting = lasting_options(&map, stored_priors.as_ref(), pose_noise, None);
        // As `quadlift stream` names them for logs; what is usual is left out.
        lasting.insert("rectified".to_owned(), json!(live.rectified.then_some(true)));
        lasting.insert("world_frame".to_owned(), json!(Some(&live.world_frame).filter(|frame| *frame != "map")));
        Ok(Self {
            reliable_detections: match parameters.text("detections_reliability") {
                "reliable" => true,
                "best_effort" => false,
                other => {
                    return Err(format!(
                        "the parameter detections_reliability is \"{other}\"; expected reliable or best_effort"
                    ));
                }
            },
            lasting,
            live,
            map,
            estimates,
            pose_noise,
            status_name: format!("{}: consistency", arguments.full_name().trim_start_matches('/')),
            files: Files::new(parameters.text("state_file"), parameters.text("map_file")),
            resume: parameters.is_set("resume"),
            publish_period: publish_period(parameters.double("publish_period"))?,
            detections_topics,
            camera_info_topics,
        })
    }
}

/// Checks the time between estimates.
///
/// # Errors
/// A text if it is out of its range.
pub fn publish_period(seconds: f64) -> Result<f64, String> {
    match seconds {
        0.0..=86_400.0 => Ok(seconds),
        _ => Err(format!("the parameter publish_period is {seconds}; expected seconds from 0 to 86400")),
    }
}

fn live_options(parameters: &Parameters, detections: &[String], cameras: &[String]) -> Result<LiveOptions, String> {
    Ok(LiveOptions {
        world_frame: parameters.text("world_frame").trim_start_matches('/').to_owned(),
        cameras: cameras.len(),
        rectified: parameters.is_set("rectified"),
        pixel_centers: match parameters.text("pixel_centers") {
            "half" => PixelCenters::Half,
            "integer" => PixelCenters::Integer,
            other => return Err(format!("the parameter pixel_centers is \"{other}\"; expected half or integer")),
        },
        time_tolerance: parameters.double("time_tolerance"),
        longest_gap: parameters.double("max_gap"),
        longest_wait: parameters.double("transform_timeout"),
        reorder: if detections.len() > 1 { parameters.double("reorder_time") } else { 0.0 },
        kept: parameters.double("transform_buffer"),
        most_waiting: parameters.size("queue_size"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::Wish;

    fn options(sets: &[&str]) -> Result<Options, String> {
        let words = sets.iter().flat_map(|set| ["-p", set]);
        let words = ["--ros-args"].into_iter().chain(words).map(str::to_owned);
        match Arguments::read(words)? {
            Wish::Run(arguments) => Options::new(&arguments),
            Wish::Print(_) => Err(String::new()),
        }
    }

    #[test]
    fn defaults_are_those_of_the_program() {
        let found = options(&[]).unwrap();
        assert_eq!(found.map, OnlineOptions::default());
        assert_eq!(found.live, LiveOptions::default());
        assert_eq!(found.detections_topics, ["/detections"]);
        assert_eq!(found.files, Files::default());
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        for (set, expected) in [
            ("ids:=never", "the parameter ids is \"never\""),
            ("pixel_centers:=left", "pixel_centers"),
            ("pose_noise:=[0.1]", "expected 2 positive numbers"),
            ("body:=ball", "expected one of auto"),
            ("min_views:=1", "the parameter min_views is 1; expected a whole number of at least 2"),
            ("max_views:=-4", "expected a whole number of at least 4"),
            ("publish_period:=-1.0", "publish_period"),
            ("detections_topics:=[]", "expected a topic"),
            ("detections_reliability:=never", "expected reliable or best_effort"),
            ("priors:=no.toml", "no.toml"),
        ] {
            let error = options(&[set]).unwrap_err();
            assert!(error.contains(expected), "{set}: {error}");
        }
    }
}

//! Options on how the images of detections are matched with the frames of a scene; `localize` has them too.

use quadlift_io::correct::DetectionPixels;
use quadlift_io::read::detections::{AddOptions, MatchBy};
use quadlift_io::read::{DetectionFormat, ReadOptions};

use crate::args;

/// Matching of images and selection of detections.
#[derive(clap::Args)]
pub(crate) struct Matching {
    /// How to match images to frames: auto, name, stem (name without extension), index or time
    #[arg(long = "match", value_enum, value_name = "HOW", default_value_t = By::Auto, hide_possible_values = true)]
    by: By,

    /// Skip detections with a lower score, such as 0.5
    #[arg(long, value_name = "S", value_parser = args::finite)]
    pub min_score: Option<f64>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum By {
    Auto,
    Name,
    Stem,
    Index,
    Time,
}

impl Matching {
    /// How detections of a format are added, given the options of its reader.
    pub(crate) fn options<'a>(
        &self,
        source: &'a str,
        pixels: DetectionPixels,
        format: &DetectionFormat,
        reading: &ReadOptions,
    ) -> AddOptions<'a> {
        AddOptions {
            match_by: match self.by {
                By::Auto => MatchBy::Auto,
                By::Name => MatchBy::Name,
                By::Stem => MatchBy::Stem,
                By::Index => MatchBy::Index,
                By::Time => MatchBy::Time,
            },
            frame_offset: pixels.frame_offset,
            image_size: pixels.image_size,
            turned: pixels.turned,
            source,
            min_score: self.min_score,
            ..AddOptions::of(format, reading)
        }
    }
}

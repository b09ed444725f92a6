//! Options on how the images of detections are matched with the frames of a scene; `localize` has them too.

use quadlift_io::read::PixelCenters;
use quadlift_io::read::detections::{AddOptions, MatchBy};

use crate::args;

/// Matching of images and selection of detections.
#[derive(clap::Args)]
pub struct Matching {
    /// How to match images to frames: auto, name, stem (name without extension), index or time
    #[arg(long = "match", value_enum, value_name = "HOW", default_value_t = By::Auto, hide_possible_values = true)]
    by: By,

    /// Number that the detections give to frame number 0 of the scene (default: inferred from format and names). For
    /// scene files, or if images are matched by name: the detections of frame number N belong to frame number 0
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub frame_offset: Option<i64>,

    /// Maximum time difference between an image and a frame, in seconds [default: 0.02]
    #[arg(long, value_name = "SECONDS", value_parser = args::positive)]
    pub time_tolerance: Option<f64>,

    /// Skip detections with a lower score
    #[arg(long, value_name = "S", value_parser = args::finite)]
    pub min_score: Option<f64>,

    /// Width and height in pixels of the images on which the detector ran: boxes are scaled to the image size of the
    /// cameras if it differs or is unknown
    #[arg(long, value_name = "WxH", value_parser = args::image_size)]
    pub image_size: Option<[f64; 2]>,
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
    /// The options of the reader.
    pub fn options<'a>(&self, source: &'a str, pixel_centers: PixelCenters) -> AddOptions<'a> {
        AddOptions {
            match_by: match self.by {
                By::Auto => MatchBy::Auto,
                By::Name => MatchBy::Name,
                By::Stem => MatchBy::Stem,
                By::Index => MatchBy::Index,
                By::Time => MatchBy::Time,
            },
            frame_offset: self.frame_offset,
            time_tolerance: self.time_tolerance.unwrap_or(AddOptions::default().time_tolerance),
            image_size: self.image_size,
            source,
            min_score: self.min_score,
            replace: false,
            pixel_centers,
        }
    }
}

//! Views of scenes and results: pages that open in any browser ([`report()`], [`page()`]) and pictures of single frames
//! ([`Picture`]), and the content of Rerun recordings ([`recording()`]).
//!
//! A page is one HTML file. What draws it is a small TypeScript program (`viewer/` in the repository), whose built form
//! is part of this crate.
#![forbid(unsafe_code)]

mod data;
mod colors;
mod cues;
mod frame_image;
mod labels;
mod masks;
mod outline;
mod page;
mod picture;
mod run;
mod poses;
mod scores;
mod content;
mod objects;
mod thumbnails;
mod document;
mod recording;
mod live;

pub use content::{Content, MAX_BYTES, MAX_DETECTIONS, MAX_FRAMES, MAX_OBJECTS};
pub use data::{
    GivenPose, Report, ReportBody, ReportDetections, ReportFrame, ReportObject, ReportScores, ScoreColumn, ScoreRow,
};
pub use document::{report, report_of_frames};
pub use frame_image::{FrameImage, frame_image, frame_jpeg};
pub use labels::{Labels, label};
pub use live::{LiveEvent, LiveMap, LiveRecord};
pub use page::page;
pub use picture::{Label, Picture, write_labels};
pub use recording::{Recording, RecordingFrame, recording};
pub use scores::{Scores, TrueObjectScores};

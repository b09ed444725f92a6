//! The diagnostic status of the node, as the tools of ROS show it (`rqt_robot_monitor`, Foxglove).

use quadlift_io::mcap::CdrWriter;

use crate::bytes::Bytes;
use crate::estimation::stamp;

/// Whether poses, cameras and boxes agree.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StatusLevel {
    /// There are too few frames to know.
    NotChecked,
    /// They agree.
    Ok,
    /// They contradict each other, for this reason.
    Error(String),
}

/// The status of the node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Status {
    /// The node with what is checked.
    pub name: String,
    /// What was found.
    pub level: StatusLevel,
    /// Number of frames of the map.
    pub frames: u64,
    /// Number of its objects.
    pub objects: usize,
}

impl Status {
    /// A `diagnostic_msgs/DiagnosticArray` with this status, at the time of the last frame.
    pub fn message(&self, last: Option<(&str, f64)>) -> Bytes {
        const SECOND: i64 = 1_000_000_000;
        let at = last.map_or(0, |(id, time)| stamp(id, time));
        let (level, text) = match &self.level {
            StatusLevel::NotChecked => (0, "not checked so far: too few frames"),
            StatusLevel::Ok => (0, "poses, cameras and boxes are consistent"),
            StatusLevel::Error(words) => (2, words.as_str()),
        };
        let mut message = CdrWriter::default();
        message.i32(at.div_euclid(SECOND) as i32).u32(at.rem_euclid(SECOND) as u32).text("");
        message.u32(1).u8(level).text(&self.name).text(text).text("");
        let values = [("frames", self.frames.to_string()), ("objects", self.objects.to_string())];
        message.u32(values.len() as u32);
        for (key, value) in values {
            message.text(key).text(&value);
        }
        Bytes(message.finish())
    }
}

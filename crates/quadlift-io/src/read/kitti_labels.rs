//! KITTI's label files: a line for each object, in each frame (tracking benchmark) or of one image (object benchmark).

use std::path::Path;

use nalgebra::{Matrix4, Rotation3, Vector3};

use super::poses::matrix4;
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::text::{Line, lines};

/// One line.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct KittiLabel {
    /// Line of the file, from 1.
    pub line: usize,
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Track id; -1 for regions that are not labeled.
    pub track: i64,
    /// Type, as it is written (`Car`, `DontCare`, ...).
    pub kind: String,
    /// Truncation: a level from 0 to 2 (tracking) or a share from 0 to 1 (objects); -1 where there is none.
    pub truncated: f64,
    /// Occlusion level, 0 to 3; -1 where there is none.
    pub occluded: f64,
    /// Left, top, right, bottom in pixels.
    pub bounding_box: [f64; 4],
    /// Height, width, length.
    pub size: [f64; 3],
    /// Middle of the bottom face in the rectified axes of camera 0.
    pub location: [f64; 3],
    /// Turn about the y axis in radians.
    pub rotation_y: f64,
    /// Score of a detector.
    pub score: Option<f64>,
}

impl KittiLabel {
    /// Whether there is a box in space.
    pub(crate) fn has_cuboid(&self) -> bool {
        self.size.iter().all(|x| *x > 0.0)
    }

    /// The pose of the cuboid's center in the rectified axes of camera 0: x along the length, y down, z along the
    /// width.
    pub(crate) fn rect_from_object(&self) -> Matrix4<f64> {
        let [x, y, z] = self.location;
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), self.rotation_y);
        matrix4(rotation.matrix(), &Vector3::new(x, y - 0.5 * self.size[0], z))
    }

    /// Half the length, height and width.
    pub(crate) fn half_extents(&self) -> Vector3<f64> {
        let [height, width, length] = self.size;
        Vector3::new(length, height, width) * 0.5
    }
}

/// Which of KITTI's benchmarks a file belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Benchmark {
    /// 17 fields, the first two are the frame and the track id; 18 with a score.
    Tracking,
    /// 15 fields, for one image; 16 with a score.
    Object,
}

/// The labels of a sequence in the bytes of a file of the tracking benchmark; the path serves for messages.
pub(crate) fn parse_labels(path: &Path, bytes: &[u8]) -> Result<Vec<KittiLabel>, ReadError> {
    parse_labels_of(path, bytes, Benchmark::Tracking)
}

/// The labels in the bytes of a file; without frames and tracks these are 0 and -1.
pub(crate) fn parse_labels_of(path: &Path, bytes: &[u8], benchmark: Benchmark) -> Result<Vec<KittiLabel>, ReadError> {
    let lines = lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment());
    lines.map(|line| label(&line, benchmark)).collect()
}

fn label(line: &Line, benchmark: Benchmark) -> Result<KittiLabel, ReadError> {
    let mut fields = line.fields();
    let (frame, track) = match benchmark {
        Benchmark::Tracking => (fields.whole("the number of a frame")?, fields.whole("a track id, a whole number")?),
        Benchmark::Object => (0, -1),
    };
    let label = KittiLabel {
        line: line.number,
        frame,
        track,
        kind: fields.word("a type such as Car")?.to_owned(),
        truncated: fields.number("a truncation level")?,
        occluded: fields.number("an occlusion level")?,
        bounding_box: {
            fields.number("the angle alpha")?;
            fields.numbers("a box left, top, right, bottom")?
        },
        size: fields.numbers("height, width, length")?,
        location: fields.numbers("a location x, y, z")?,
        rotation_y: fields.number("the angle rotation_y")?,
        score: if fields.is_empty() { None } else { Some(fields.number("a score")?) },
    };
    if !fields.is_empty() {
        let expected = if benchmark == Benchmark::Tracking { "17 or 18" } else { "15 or 16" };
        return Err(line.error(format!("expected {expected} fields; found more: {}", fields.rest())));
    }
    Ok(label)
}

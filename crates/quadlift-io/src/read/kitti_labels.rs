//! KITTI's label files of the tracking benchmark: a line for each object in each frame.

use std::path::Path;

use nalgebra::{Matrix4, Rotation3, Vector3};

use super::poses::matrix4;
use super::text::lines;
use crate::error::{ReadError, as_utf8};

/// One line: 17 fields, or 18 with a score.
#[derive(Debug, Clone, PartialEq)]
pub struct KittiLabel {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Track id; -1 for regions that are not labelled.
    pub track: i64,
    /// Type, as it is written (`Car`, `DontCare`, ...).
    pub kind: String,
    /// Truncation level, 0 to 2; -1 where there is none.
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
    pub fn has_cuboid(&self) -> bool {
        self.size.iter().all(|x| *x > 0.0)
    }

    /// The pose of the cuboid's centre in the rectified axes of camera 0: x along the length, y down, z along the
    /// width.
    pub fn rect_from_object(&self) -> Matrix4<f64> {
        let [x, y, z] = self.location;
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), self.rotation_y);
        matrix4(rotation.matrix(), &Vector3::new(x, y - 0.5 * self.size[0], z))
    }

    /// Half the length, height and width.
    pub fn half_extents(&self) -> Vector3<f64> {
        let [height, width, length] = self.size;
        Vector3::new(length, height, width) * 0.5
    }
}

/// The labels in the bytes of a file; the path serves for messages.
pub fn parse_labels(path: &Path, bytes: &[u8]) -> Result<Vec<KittiLabel>, ReadError> {
    let mut labels = Vec::new();
    for line in lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let frame = fields.whole("the number of a frame")?;
        let track = fields.whole("a track id, a whole number")?;
        let kind = fields.word("a type such as Car")?.to_owned();
        let truncated = fields.number("a truncation level")?;
        let occluded = fields.number("an occlusion level")?;
        fields.number("the angle alpha")?;
        let bounding_box = fields.numbers("a box left, top, right, bottom")?;
        let size = fields.numbers("height, width, length")?;
        let location = fields.numbers("a location x, y, z")?;
        let rotation_y = fields.number("the angle rotation_y")?;
        let score = if fields.is_empty() { None } else { Some(fields.number("a score")?) };
        if !fields.is_empty() {
            return Err(line.error(format!("expected 17 or 18 fields; found more: {}", fields.rest())));
        }
        labels.push(KittiLabel {
            frame,
            track,
            kind,
            truncated,
            occluded,
            bounding_box,
            size,
            location,
            rotation_y,
            score,
        });
    }
    Ok(labels)
}

//! Errors of scenes.

/// Why points are no outline.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OutlineError {
    /// Fewer than three points.
    #[error("the outline has {0} points; expected three or more")]
    TooFewPoints(usize),
    /// A number is NaN or infinite.
    #[error("the outline holds a number that is not finite")]
    NotFinite,
    /// All points lie on a line.
    #[error("all points of the outline lie on a line; expected a polygon")]
    Flat,
}

/// Why something cannot be added to a scene.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// Two frames have the same id.
    #[error("the frame id \"{0}\" is used twice")]
    DuplicateFrame(String),
    /// A detection names a frame that does not exist.
    #[error("unknown frame \"{0}\"")]
    UnknownFrame(String),
    /// A detection has no box, outline, oriented box or ellipse, and no 3D box with a center.
    #[error(
        "the detection has none of \"box\", \"outline\", \"oriented_box\" and \"ellipse\", and no \"box3d\" with a center"
    )]
    NothingMeasured,
    /// Points are no outline.
    #[error(transparent)]
    Outline(#[from] OutlineError),
    /// A cue of a detection is out of range.
    #[error(transparent)]
    Cue(#[from] super::cues::CueError),
    /// One source has two detections of one object in one frame.
    #[error(
        "object \"{object}\" is detected twice in frame \"{frame}\" by the same source (first by detections[{first}])"
    )]
    DuplicateDetection {
        /// Id of the object.
        object: String,
        /// Id of the frame.
        frame: String,
        /// Index of the first of the two detections.
        first: usize,
        /// Index of the second one, which may not have been added.
        second: usize,
    },
    /// An image size is not positive.
    #[error("the image size is {width} x {height}; expected two positive numbers")]
    ImageSize {
        /// Width in pixels.
        width: f64,
        /// Height in pixels.
        height: f64,
    },
    /// The up direction is zero or not finite.
    #[error("\"up\" is not a direction: [{}, {}, {}]", .0[0], .0[1], .0[2])]
    Up([f64; 3]),
    /// A detection points to a frame, object, category or source that the scene does not have.
    #[error("detections[{detection}] has the {what} index {index}, of {count}")]
    IndexOutOfRange {
        /// Index of the detection.
        detection: usize,
        /// What is indexed: "frame", "object", "category", "source", "cue source".
        what: &'static str,
        /// The index.
        index: u32,
        /// How many there are.
        count: usize,
    },
    /// A tracked point is not finite, or was observed in a frame that the scene does not have or twice in one.
    #[error("points[{point}]: {problem}")]
    Point {
        /// Index of the point.
        point: usize,
        /// What is wrong.
        problem: String,
    },
    /// More frames, detections or names than a 32-bit index can count.
    #[error("the scene is too large: more than 4294967295 entries")]
    TooLarge,
}

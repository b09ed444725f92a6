//! Causes of disagreement by name: a closed list that files and programs may rely on.

use super::agreement::Agreement;
use super::correction::Correction;

/// The kind of mistake that explains why a scene is inconsistent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum CauseName {
    /// Poses map from the camera to the world instead of from the world to the camera.
    CameraToWorld,
    /// Camera axes are OpenGL's (y up, z backwards) instead of OpenCV's.
    #[cfg_attr(feature = "serde", serde(rename = "opengl_axes"))]
    OpenGlAxes,
    /// Poses map from a camera with OpenGL's axes to the world (nerfstudio, Blender).
    #[cfg_attr(feature = "serde", serde(rename = "opengl_camera_to_world"))]
    OpenGlCameraToWorld,
    /// Camera axes are a robot's body axes (x forward, y left, z up).
    BodyAxes,
    /// Poses map from a robot's body (x forward, y left, z up) to the world.
    BodyToWorld,
    /// World and camera axes are left-handed (Unity).
    LeftHandedAxes,
    /// Poses map from the camera to the world, both left-handed (Unity).
    LeftHandedCameraToWorld,
    /// The translation is the camera center.
    CenterAsTranslation,
    /// The rotation is transposed, the translation is right.
    TransposedRotation,
    /// Quaternions were read as x, y, z, w instead of w, x, y, z, or the other way round.
    QuaternionOrder,
    /// The focal length is wrong.
    FocalLength,
    /// The intrinsics are in units of the image size.
    NormalizedIntrinsics,
    /// The principal point is far from the middle of the image, as after reading a transposed `K`.
    PrincipalPoint,
    /// The images are distorted, the camera is a pinhole.
    MissingDistortion,
    /// Boxes were measured in images of another size.
    ImageSize,
    /// Boxes were measured in letterboxed images.
    Letterbox,
    /// Boxes were measured in pictures turned or mirrored against the camera, as by their EXIF orientation.
    PictureOrientation,
    /// Boxes are in units of the image size.
    NormalizedBoxes,
    /// The four numbers of a box were read in another format.
    BoxFormat,
    /// x and y of the boxes are swapped.
    SwappedXy,
    /// Detections belong to frames some places earlier or later.
    FrameOffset,
    /// Detections were given to frames in another order of their names.
    FrameOrder,
    /// Ids of objects do not stay with their objects.
    ObjectIds,
    /// Frames have the pose of another frame, although they show something else.
    DuplicatePoses,
    /// The boxes of some frames contradict those of the others.
    ContradictingFrames,
    /// The detections of one camera of a rig are of another time step than those of the other cameras.
    CameraOffset,
    /// The trajectory changes its scale.
    ScaleJump,
    /// `up` is not the direction in which the cameras are upright.
    Up,
    /// Lengths do not fit the priors on sizes: they are in another unit.
    LengthUnit,
    /// The estimates explain the boxes only with errors of their edges that explain anything.
    EdgeNoise,
    /// Boxes are not where the other views predict them.
    HeldOutViews,
    /// The outlines contradict the boxes; they were left out.
    Outlines,
    /// The depths contradict the boxes; they were left out.
    Depths,
    /// The 3D boxes contradict the 2D boxes; they were left out.
    Boxes3d,
}

impl CauseName {
    /// All causes.
    pub const ALL: [Self; 34] = [
        Self::CameraToWorld,
        Self::OpenGlAxes,
        Self::OpenGlCameraToWorld,
        Self::BodyAxes,
        Self::BodyToWorld,
        Self::LeftHandedAxes,
        Self::LeftHandedCameraToWorld,
        Self::CenterAsTranslation,
        Self::TransposedRotation,
        Self::QuaternionOrder,
        Self::FocalLength,
        Self::NormalizedIntrinsics,
        Self::PrincipalPoint,
        Self::MissingDistortion,
        Self::ImageSize,
        Self::Letterbox,
        Self::PictureOrientation,
        Self::NormalizedBoxes,
        Self::BoxFormat,
        Self::SwappedXy,
        Self::FrameOffset,
        Self::FrameOrder,
        Self::ObjectIds,
        Self::DuplicatePoses,
        Self::ContradictingFrames,
        Self::CameraOffset,
        Self::ScaleJump,
        Self::Up,
        Self::LengthUnit,
        Self::EdgeNoise,
        Self::HeldOutViews,
        Self::Outlines,
        Self::Depths,
        Self::Boxes3d,
    ];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::CameraToWorld => "camera_to_world",
            Self::OpenGlAxes => "opengl_axes",
            Self::OpenGlCameraToWorld => "opengl_camera_to_world",
            Self::BodyAxes => "body_axes",
            Self::BodyToWorld => "body_to_world",
            Self::LeftHandedAxes => "left_handed_axes",
            Self::LeftHandedCameraToWorld => "left_handed_camera_to_world",
            Self::CenterAsTranslation => "center_as_translation",
            Self::TransposedRotation => "transposed_rotation",
            Self::QuaternionOrder => "quaternion_order",
            Self::FocalLength => "focal_length",
            Self::NormalizedIntrinsics => "normalized_intrinsics",
            Self::PrincipalPoint => "principal_point",
            Self::MissingDistortion => "missing_distortion",
            Self::ImageSize => "image_size",
            Self::Letterbox => "letterbox",
            Self::PictureOrientation => "picture_orientation",
            Self::NormalizedBoxes => "normalized_boxes",
            Self::BoxFormat => "box_format",
            Self::SwappedXy => "swapped_xy",
            Self::FrameOffset => "frame_offset",
            Self::FrameOrder => "frame_order",
            Self::ObjectIds => "object_ids",
            Self::DuplicatePoses => "duplicate_poses",
            Self::ContradictingFrames => "contradicting_frames",
            Self::CameraOffset => "camera_offset",
            Self::ScaleJump => "scale_jump",
            Self::Up => "up",
            Self::LengthUnit => "length_unit",
            Self::EdgeNoise => "edge_noise",
            Self::HeldOutViews => "held_out_views",
            Self::Outlines => "outlines",
            Self::Depths => "depths",
            Self::Boxes3d => "boxes3d",
        }
    }
}

/// A mistake that explains why a scene is inconsistent.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cause {
    /// Which mistake.
    pub name: CauseName,
    /// Its parameter: the factor on focal lengths (`focal_length`), the factor on the box coordinates (`image_size`),
    /// the side of the letterboxed image in pixels (`letterbox`), the coefficient of a radial lens
    /// (`missing_distortion`), the EXIF orientation (`picture_orientation`), the number of frames (`frame_offset`), of
    /// time steps (`camera_offset`), the fraction of the frames (`duplicate_poses`), the factor on the later part of the trajectory
    /// (`scale_jump`), the factor on all lengths (`length_unit`), the noise in half sizes of the boxes (`edge_noise`), the mean IoU
    /// (`held_out_views`); with [`Self::frames`] their share, but for `camera_offset`. Absent if the mistake has no parameter.
    pub value: Option<f64>,
    /// The correction, if there is one.
    pub correction: Option<Correction>,
    /// The ids of the frames that have the mistake; empty if all have it.
    pub frames: Vec<String>,
    /// Agreement of the scene as it is.
    pub before: Agreement,
    /// Agreement after the correction; equal to `before` if boxes do not determine the mistake.
    pub after: Agreement,
}

impl Cause {
    /// The cause that a correction corrects.
    pub(crate) fn new(correction: Correction, before: Agreement, after: Agreement) -> Self {
        let value = correction.value();
        Self { correction: Some(correction), value, after, ..Self::unexplained(correction.cause(), before) }
    }

    /// A cause without a number and a correction.
    pub(crate) fn unexplained(name: CauseName, before: Agreement) -> Self {
        Self { name, value: None, correction: None, frames: Vec::new(), before, after: before }
    }
}

//! Corrections of common mistakes: they undo the effect of a wrong convention on a scene (docs/method.md, section
//! 16.2).
//!
//! Each correction is a pure map of one part of the input: poses, intrinsics, boxes or the frames of detections. Scenes
//! in memory and records of files are corrected by the same maps.

use nalgebra::{Matrix3, Point3, Quaternion, Rotation3, UnitQuaternion, Vector2, Vector3};

use super::camera::CameraParts;
use super::pixel_map::PixelMap;
use crate::geometry::{BoundingBox, Ellipse, Intrinsics};
use crate::scene::frame_names::{lexicographic_places, natural_places};

/// How the numbers of a box were read, and how they are meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum BoxFormat {
    /// Two corners were read as corner and size: `[x0, y0, x1, y1]` as `[x, y, w, h]`.
    CornersReadAsSize,
    /// Center and size were read as corner and size: `[cx, cy, w, h]` as `[x, y, w, h]`.
    CenterReadAsCorner,
    /// Corner and size were read as center and size: `[x, y, w, h]` as `[cx, cy, w, h]`.
    CornerReadAsCenter,
    /// Corner and size were read as two corners: `[x, y, w, h]` as `[x0, y0, x1, y1]`.
    SizeReadAsCorners,
    /// Center and size were read as two corners: `[cx, cy, w, h]` as `[x0, y0, x1, y1]`.
    CenterSizeReadAsCorners,
    /// Two corners were read as center and size: `[x0, y0, x1, y1]` as `[cx, cy, w, h]`.
    CornersReadAsCenter,
    /// x and y are exchanged: `[y0, x0, y1, x1]` was read as `[x0, y0, x1, y1]`.
    SwappedAxes,
}

/// A correction of one of the common mistakes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Correction {
    /// The poses map from the camera to the world; they are inverted.
    InvertPoses,
    /// The camera axes are OpenGL's (x right, y up, z backwards).
    OpenGlAxes,
    /// The poses map from a camera with OpenGL's axes to the world (nerfstudio, Blender).
    InvertOpenGlPoses,
    /// The camera axes are a robot's body axes (x forward, y left, z up).
    BodyAxes,
    /// The poses map from a robot's body (x forward, y left, z up) to the world.
    InvertBodyPoses,
    /// World and camera axes are left-handed (Unity: x right, y up, z forward).
    LeftHandedAxes,
    /// The poses map from the camera to the world, both left-handed.
    InvertLeftHandedPoses,
    /// The translation of `cam_from_world` holds the camera center.
    CenterAsTranslation,
    /// The rotation of `cam_from_world` is transposed, its translation is right.
    TransposedRotation,
    /// Quaternions `w, x, y, z` were read as `x, y, z, w`, or the other way round.
    QuaternionOrder {
        /// Whether they were `w, x, y, z`, read as `x, y, z, w`.
        was_wxyz: bool,
        /// Whether they rotate from camera to world, so that the camera centers are correct; otherwise the translations
        /// of `cam_from_world` are correct.
        world_from_cam: bool,
    },
    /// Focal lengths are multiplied by a factor.
    FocalFactor(f64),
    /// The intrinsics are in units of the image's width and height.
    NormalizedIntrinsics,
    /// The principal point is moved to the middle of the image, as a transposed `K` asks for.
    CenteredPrincipalPoint,
    /// The images are distorted by a radial lens (`SIMPLE_RADIAL`) with this coefficient.
    RadialDistortion(f64),
    /// The boxes were measured in images of another size; pixels are multiplied by a factor.
    ImageScale(f64),
    /// The boxes were measured in a letterboxed square image with this side, in pixels.
    Letterbox(f64),
    /// The boxes were fractions of a letterboxed square image that were multiplied by the sides of the camera's.
    NormalizedLetterbox,
    /// The boxes are in units of the image's width and height.
    NormalizedBoxes,
    /// The boxes were measured in pictures that were turned or mirrored against those of the cameras, as viewers turn them by
    /// the EXIF orientation.
    TurnedPictures {
        /// The EXIF orientation, 2 to 8: 6 where the pictures were turned by 90 degrees clockwise.
        orientation: u8,
        /// Whether the boxes were fractions of the turned picture that were multiplied by the sides of the camera's.
        fractions: bool,
    },
    /// The numbers of the boxes were read in another order.
    Boxes(BoxFormat),
    /// Detections of frame k belong to frame k + n.
    FrameOffset(i32),
    /// Detections were given to frames in alphabetical order of their names ("10" before "9") instead of by number.
    AlphabeticalFrames,
    /// Frames were in alphabetical order ("10" before "9"), detections were given to them by number.
    NumericFrames,
    /// Detections belong to the frames in reverse order.
    ReversedFrames,
    /// The world's direction against gravity is this one.
    Up([f64; 3]),
    /// Lengths of the poses are multiplied by a factor: they are in another unit.
    Lengths(f64),
}

impl Correction {
    /// The corrections of poses.
    pub const OF_POSES: [Self; 13] = [
        Self::InvertPoses,
        Self::OpenGlAxes,
        Self::InvertOpenGlPoses,
        Self::BodyAxes,
        Self::InvertBodyPoses,
        Self::LeftHandedAxes,
        Self::InvertLeftHandedPoses,
        Self::CenterAsTranslation,
        Self::TransposedRotation,
        Self::QuaternionOrder { was_wxyz: true, world_from_cam: true },
        Self::QuaternionOrder { was_wxyz: true, world_from_cam: false },
        Self::QuaternionOrder { was_wxyz: false, world_from_cam: true },
        Self::QuaternionOrder { was_wxyz: false, world_from_cam: false },
    ];
}

/// OpenGL's camera axes, from and to OpenCV's.
fn opengl() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
}

/// OpenCV's camera axes (x right, y down, z forward) from a robot's body axes (x forward, y left, z up).
fn cam_from_body() -> Matrix3<f64> {
    Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0)
}

/// A mirror of y.
fn mirror() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0))
}

impl Correction {
    /// The corrected pose of a camera, `R` and `t` of `cam_from_world`; unchanged if the correction does not affect
    /// poses.
    pub fn pose(&self, r: &Matrix3<f64>, t: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        let inverse = || (r.transpose(), -(r.transpose() * t));
        let turned = |by: Matrix3<f64>, (r, t): (Matrix3<f64>, Vector3<f64>)| (by * r, by * t);
        let mirrored = |(r, t): (Matrix3<f64>, Vector3<f64>)| (mirror() * r * mirror(), mirror() * t);
        match *self {
            Self::InvertPoses => inverse(),
            Self::OpenGlAxes => turned(opengl(), (*r, *t)),
            Self::InvertOpenGlPoses => turned(opengl(), inverse()),
            Self::BodyAxes => turned(cam_from_body(), (*r, *t)),
            Self::InvertBodyPoses => turned(cam_from_body(), inverse()),
            Self::LeftHandedAxes => mirrored((*r, *t)),
            Self::InvertLeftHandedPoses => mirrored(inverse()),
            Self::CenterAsTranslation => (*r, -(r * t)),
            Self::TransposedRotation => (r.transpose(), *t),
            Self::Lengths(factor) => (*r, t * factor),
            Self::QuaternionOrder { was_wxyz, world_from_cam } => reordered(r, t, was_wxyz, world_from_cam),
            _ => (*r, *t),
        }
    }

    /// Maps a world point to the world of the corrected poses: unchanged, except for corrections that mirror the world
    /// or change its unit. Points of the scene, such as those of a COLMAP model, move with it.
    pub fn world_point(&self, point: &Point3<f64>) -> Point3<f64> {
        match *self {
            Self::LeftHandedAxes | Self::InvertLeftHandedPoses => mirror() * point,
            Self::Lengths(factor) => point * factor,
            _ => *point,
        }
    }

    /// The corrected intrinsics of a camera whose image has this size in pixels; `None` if the size is needed but
    /// unknown, or if the result is invalid.
    pub fn intrinsics(&self, k: &Intrinsics, image_size: Option<Vector2<f64>>) -> Option<Intrinsics> {
        match *self {
            Self::FocalFactor(factor) => Intrinsics::new(k.fx * factor, k.fy * factor, k.cx, k.cy).ok(),
            Self::NormalizedIntrinsics => {
                let size = image_size?;
                Intrinsics::new(k.fx * size.x, k.fy * size.y, k.cx * size.x, k.cy * size.y).ok()
            }
            Self::CenteredPrincipalPoint => {
                let size = image_size?;
                Intrinsics::new(k.fx, k.fy, 0.5 * size.x, 0.5 * size.y).ok()
            }
            _ => Some(*k),
        }
    }

    /// The corrected box of a camera with these (correct) intrinsics and image size in pixels; `None` if it is not a
    /// valid box.
    pub(crate) fn bounding_box(
        &self,
        b: &BoundingBox,
        intrinsics: &Intrinsics,
        image_size: Option<Vector2<f64>>,
    ) -> Option<BoundingBox> {
        let edges = match *self {
            Self::RadialDistortion(k) => {
                let [x0, y0, x1, y1] = b.edges();
                let low = undistorted(&Vector2::new(x0, y0), intrinsics, k)?;
                let high = undistorted(&Vector2::new(x1, y1), intrinsics, k)?;
                [low.x, low.y, high.x, high.y]
            }
            _ => self.edges(b.edges(), image_size)?,
        };
        BoundingBox::new(edges).ok()
    }

    /// The corrected four numbers of a box, which may be invalid before; `None` if the image size, in pixels, is needed
    /// but unknown. Lenses have no effect here.
    pub fn edges(&self, [x0, y0, x1, y1]: [f64; 4], image_size: Option<Vector2<f64>>) -> Option<[f64; 4]> {
        let (w, h) = (x1 - x0, y1 - y0);
        Some(match *self {
            Self::Boxes(BoxFormat::CornersReadAsSize) => [x0, y0, w, h],
            Self::Boxes(BoxFormat::CenterReadAsCorner) => [x0 - 0.5 * w, y0 - 0.5 * h, x1 - 0.5 * w, y1 - 0.5 * h],
            Self::Boxes(BoxFormat::CornerReadAsCenter) => [x0 + 0.5 * w, y0 + 0.5 * h, x1 + 0.5 * w, y1 + 0.5 * h],
            Self::Boxes(BoxFormat::CornersReadAsCenter) => [0.5 * (x0 + x1), 0.5 * (y0 + y1), w, h],
            Self::Boxes(BoxFormat::SizeReadAsCorners) => [x0, y0, x0 + x1, y0 + y1],
            Self::Boxes(BoxFormat::CenterSizeReadAsCorners) => {
                [x0 - 0.5 * x1, y0 - 0.5 * y1, x0 + 0.5 * x1, y0 + 0.5 * y1]
            }
            Self::Boxes(BoxFormat::SwappedAxes) => [y0, x0, y1, x1],
            _ => self.pixel_map(image_size)?.edges([x0, y0, x1, y1]),
        })
    }

    /// The corrected ellipse; `None` if there is none. Box formats and lenses do not change ellipses.
    pub(crate) fn ellipse(&self, ellipse: &Ellipse, image_size: Option<Vector2<f64>>) -> Option<Ellipse> {
        self.pixel_map(image_size)?.ellipse(ellipse).ok()
    }

    /// The map from given to corrected pixels; `None` if the image size is needed but unknown. Identity if the correction
    /// does not affect pixels.
    pub fn pixel_map(&self, image_size: Option<Vector2<f64>>) -> Option<PixelMap> {
        Some(match *self {
            Self::ImageScale(factor) => PixelMap::scaling(Vector2::repeat(factor), Vector2::zeros()),
            Self::NormalizedBoxes => PixelMap::scaling(image_size?, Vector2::zeros()),
            Self::TurnedPictures { orientation, fractions } => {
                PixelMap::from_shown(orientation, image_size?, fractions)
            }
            Self::Letterbox(_) | Self::NormalizedLetterbox => {
                let size = image_size?;
                // The longer side fills the square, the shorter one has a margin on both sides.
                let square = Vector2::repeat(size.max());
                let measured = if let Self::Letterbox(side) = *self { Vector2::repeat(side) } else { size };
                PixelMap::scaling(square.component_div(&measured), (size - square) * 0.5)
            }
            _ => PixelMap::IDENTITY,
        })
    }

    /// For each frame, the frame to which its detections belong, or `None` if there is none. `ids` are the names of the
    /// frames in order. `None` if the correction keeps every detection in its frame.
    pub fn frames(&self, ids: &[&str]) -> Option<Vec<Option<usize>>> {
        let count = ids.len();
        match *self {
            Self::FrameOffset(n) => Some(
                (0..count)
                    .map(|k| usize::try_from(k as i64 + i64::from(n)).ok().filter(|frame| *frame < count))
                    .collect(),
            ),
            Self::ReversedFrames => Some((0..count).map(|k| Some(count - 1 - k)).collect()),
            Self::AlphabeticalFrames => Some(exchanged(&natural_places(ids), &lexicographic_places(ids))),
            Self::NumericFrames => Some(exchanged(&lexicographic_places(ids), &natural_places(ids))),
            _ => None,
        }
    }

    /// A whole camera, corrected.
    pub(crate) fn camera(&self, camera: &CameraParts, image_size: Option<Vector2<f64>>) -> Option<CameraParts> {
        let (rotation, translation) = self.pose(&camera.rotation, &camera.translation);
        Some(CameraParts { intrinsics: self.intrinsics(&camera.intrinsics, image_size)?, rotation, translation })
    }
}

/// The frame at the place in one order that each frame has in the other.
fn exchanged(from: &[usize], to: &[usize]) -> Vec<Option<usize>> {
    let mut frame_at = vec![0; to.len()];
    for (frame, &place) in to.iter().enumerate() {
        frame_at[place] = frame;
    }
    from.iter().map(|&place| frame_at.get(place).copied()).collect()
}

/// A pose whose quaternions were read in the wrong order, with the right one.
fn reordered(r: &Matrix3<f64>, t: &Vector3<f64>, was_wxyz: bool, world_from_cam: bool) -> (Matrix3<f64>, Vector3<f64>) {
    let center = -(r.transpose() * t);
    let read = if world_from_cam { r.transpose() } else { *r };
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(read));
    let [x, y, z, w] = [q.i, q.j, q.k, q.w];
    // [w, x, y, z] read as [x, y, z, w]: the number that was read as x is w.
    let meant = if was_wxyz { Quaternion::new(x, y, z, w) } else { Quaternion::new(z, w, x, y) };
    let rotation = UnitQuaternion::from_quaternion(meant).to_rotation_matrix().into_inner();
    if world_from_cam { (rotation.transpose(), -(rotation.transpose() * center)) } else { (rotation, *t) }
}

/// A pixel of a pinhole camera from one of a `SIMPLE_RADIAL` lens; `None` if the lens maps no point there.
fn undistorted(pixel: &Vector2<f64>, k: &Intrinsics, coefficient: f64) -> Option<Vector2<f64>> {
    let distorted = Vector2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy);
    let radius = distorted.norm();
    if radius == 0.0 {
        return Some(*pixel);
    }
    // r (1 + k r^2) = radius, by Newton's method.
    let mut r = radius;
    for _ in 0..20 {
        let slope = 1.0 + 3.0 * coefficient * r * r;
        if slope <= 0.0 {
            return None;
        }
        r -= (r * (1.0 + coefficient * r * r) - radius) / slope;
    }
    let straight = distorted * (r / radius);
    let pixel = Vector2::new(straight.x * k.fx + k.cx, straight.y * k.fy + k.cy);
    pixel.iter().all(|x| x.is_finite()).then_some(pixel)
}

/// A mistake: the inverse of a [`Correction`], which makes test scenes. [`Correction::Up`] has none: it sets the
/// correct value independent of the wrong one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mistake(pub Correction);

impl Mistake {
    /// The pose as the mistake writes it.
    pub fn pose(&self, r: &Matrix3<f64>, t: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        let turned_inverse = |by: Matrix3<f64>| {
            let (r, t) = (by * r, by * t);
            (r.transpose(), -(r.transpose() * t))
        };
        match self.0 {
            Correction::InvertOpenGlPoses => turned_inverse(opengl()),
            Correction::BodyAxes => (cam_from_body().transpose() * r, cam_from_body().transpose() * t),
            Correction::InvertBodyPoses => turned_inverse(cam_from_body().transpose()),
            Correction::InvertLeftHandedPoses => {
                let (r, t) = (mirror() * r * mirror(), mirror() * t);
                (r.transpose(), -(r.transpose() * t))
            }
            Correction::CenterAsTranslation => (*r, -(r.transpose() * t)),
            Correction::QuaternionOrder { was_wxyz, world_from_cam } => reordered(r, t, !was_wxyz, world_from_cam),
            Correction::Lengths(factor) => (*r, t / factor),
            // Their own inverses, or nothing.
            other => other.pose(r, t),
        }
    }

    /// The intrinsics as the mistake writes them.
    pub fn intrinsics(&self, k: &Intrinsics, image_size: Option<Vector2<f64>>) -> Option<Intrinsics> {
        match self.0 {
            Correction::FocalFactor(f) => Intrinsics::new(k.fx / f, k.fy / f, k.cx, k.cy).ok(),
            Correction::NormalizedIntrinsics => {
                let size = image_size?;
                Intrinsics::new(k.fx / size.x, k.fy / size.y, k.cx / size.x, k.cy / size.y).ok()
            }
            Correction::CenteredPrincipalPoint => Intrinsics::new(k.fx, k.fy, 0.0, 0.0).ok(),
            _ => Some(*k),
        }
    }

    /// The box as written by the mistake; `None` if it would be invalid.
    pub fn bounding_box(
        &self,
        b: &BoundingBox,
        intrinsics: &Intrinsics,
        image_size: Option<Vector2<f64>>,
    ) -> Option<BoundingBox> {
        let [x0, y0, x1, y1] = b.edges();
        let (w, h) = (x1 - x0, y1 - y0);
        let edges = match self.0 {
            Correction::Boxes(BoxFormat::CornersReadAsSize) => [x0, y0, x0 + x1, y0 + y1],
            Correction::Boxes(BoxFormat::SizeReadAsCorners) => [x0, y0, w, h],
            Correction::Boxes(BoxFormat::CenterSizeReadAsCorners) => [x0 + 0.5 * w, y0 + 0.5 * h, w, h],
            Correction::Boxes(BoxFormat::CornersReadAsCenter) => {
                return Correction::Boxes(BoxFormat::CenterSizeReadAsCorners).bounding_box(b, intrinsics, image_size);
            }
            Correction::Boxes(BoxFormat::CenterReadAsCorner) => {
                return Correction::Boxes(BoxFormat::CornerReadAsCenter).bounding_box(b, intrinsics, image_size);
            }
            Correction::Boxes(BoxFormat::CornerReadAsCenter) => {
                return Correction::Boxes(BoxFormat::CenterReadAsCorner).bounding_box(b, intrinsics, image_size);
            }
            Correction::Boxes(BoxFormat::SwappedAxes) => [y0, x0, y1, x1],
            Correction::RadialDistortion(k) => {
                let bend = |x: f64, y: f64| {
                    let p = Vector2::new((x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy);
                    let p = p * (1.0 + k * p.norm_squared());
                    Vector2::new(p.x * intrinsics.fx + intrinsics.cx, p.y * intrinsics.fy + intrinsics.cy)
                };
                let (low, high) = (bend(x0, y0), bend(x1, y1));
                [low.x, low.y, high.x, high.y]
            }
            other => other.pixel_map(image_size)?.inverse().edges([x0, y0, x1, y1]),
        };
        BoundingBox::new(edges).ok()
    }

    /// For each frame, the frame to which the mistake moves its detections; see [`Correction::frames`].
    pub fn frames(&self, ids: &[&str]) -> Option<Vec<Option<usize>>> {
        match self.0 {
            Correction::FrameOffset(n) => Correction::FrameOffset(-n).frames(ids),
            Correction::AlphabeticalFrames => Correction::NumericFrames.frames(ids),
            Correction::NumericFrames => Correction::AlphabeticalFrames.frames(ids),
            other => other.frames(ids),
        }
    }
}

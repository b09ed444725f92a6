//! Points of structure from motion with the pixels in which frames observed them: their tracks.

use nalgebra::{Point3, Vector2};

use super::error::SceneError;
use crate::geometry::Camera;

/// A point of the scene's surfaces and the pixels in which frames observed it.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPoint {
    /// Where it is said to be, in the world.
    pub position: Point3<f64>,
    /// Its observations, at most one in a frame, in the order of the frames.
    pub observations: Vec<PointObservation>,
}

/// A point in the image of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointObservation {
    /// Index into [`super::SceneParts::frames`].
    pub frame_index: u32,
    /// The pixel of [`super::Frame::projection`]: of the image without the distortion of its lens.
    pub pixel: Vector2<f64>,
    /// How many of these pixels one of the image is long here: 1 without a lens.
    pub stretch: f64,
}

impl PointObservation {
    /// A pixel that was measured in the image of a frame as it is, through its lens if it has one; `None` where the lens has no
    /// pinhole pixel for it ([`Camera::undistort_point`]).
    pub(crate) fn in_image(frame_index: u32, lens: Option<&Camera>, pixel: Vector2<f64>) -> Option<Self> {
        let Some(lens) = lens else { return Some(Self { frame_index, pixel, stretch: 1.0 }) };
        let at = |x: f64, y: f64| lens.undistort_point(&(pixel + Vector2::new(x, y)));
        let right = at(0.5, 0.0)? - at(-0.5, 0.0)?;
        let down = at(0.0, 0.5)? - at(0.0, -0.5)?;
        Some(Self { frame_index, pixel: at(0.0, 0.0)?, stretch: right.perp(&down).abs().sqrt() })
    }
}

/// Refuses points that are not finite, and observations in frames that the scene does not have or twice in one.
pub(super) fn check_points(points: &[TrackedPoint], frames: usize) -> Result<(), SceneError> {
    for (point, TrackedPoint { position, observations }) in points.iter().enumerate() {
        let refuse = |problem: String| Err(SceneError::Point { point, problem });
        if !position.iter().all(|x| x.is_finite()) {
            return refuse("the position is not finite".to_owned());
        }
        let mut before = None;
        for PointObservation { frame_index, pixel, stretch } in observations {
            if *frame_index as usize >= frames {
                return refuse(format!("it was observed in frame {frame_index}, of {frames}"));
            }
            if before >= Some(frame_index) {
                return refuse(format!("frame {frame_index} observed it twice, or after a later frame"));
            }
            if !(pixel.iter().all(|x| x.is_finite()) && stretch.is_finite() && *stretch > 0.0) {
                return refuse(format!("its pixel in frame {frame_index} is not finite"));
            }
            before = Some(frame_index);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{CameraModel, Projection};
    use crate::scene::{Frame, Scene, SceneParts};
    use nalgebra::Matrix3x4;

    fn frame() -> Frame {
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        Frame { id: "a".to_owned(), projection, image_size: None, lens: None, rig: None }
    }

    #[test]
    fn pixels_are_undistorted_with_their_stretch() {
        let pixel = Vector2::new(620.0, 240.0);
        let plain = PointObservation::in_image(3, None, pixel).unwrap();
        assert_eq!(plain, PointObservation { frame_index: 3, pixel, stretch: 1.0 });
        let fisheye = Camera::new(CameraModel::SimpleFisheye, &[300.0, 320.0, 240.0]).unwrap();
        let found = PointObservation::in_image(3, Some(&fisheye), pixel).unwrap();
        // One radian from the axis: 1 / cos^2 along the radius, tan(1) across.
        let expected = (1f64.cos().powi(-2) * 1f64.tan()).sqrt();
        assert!((found.pixel - Vector2::new(320.0 + 300.0 * 1f64.tan(), 240.0)).norm() < 1e-6);
        assert!((found.stretch / expected - 1.0).abs() < 1e-4, "{} {expected}", found.stretch);
        assert!(PointObservation::in_image(3, Some(&fisheye), Vector2::new(900.0, 240.0)).is_none());
    }

    #[test]
    fn wrong_points_are_refused() {
        let of = |change: &dyn Fn(&mut TrackedPoint)| {
            let seen = |frame_index| PointObservation { frame_index, pixel: Vector2::zeros(), stretch: 1.0 };
            let mut point = TrackedPoint { position: Point3::origin(), observations: vec![seen(0), seen(1)] };
            change(&mut point);
            let frames = vec![frame(), Frame { id: "b".to_owned(), ..frame() }];
            Scene::from_parts(SceneParts { frames, points: vec![point], ..Default::default() }).map(|_| ())
        };
        assert_eq!(of(&|_| {}), Ok(()));
        for change in [
            &(|point: &mut TrackedPoint| point.position.x = f64::NAN) as &dyn Fn(&mut TrackedPoint),
            &|point| point.observations[1].frame_index = 2,
            &|point| point.observations[1].frame_index = 0,
            &|point| point.observations[1].pixel.y = f64::INFINITY,
            &|point| point.observations[1].stretch = 0.0,
        ] {
            assert!(matches!(of(change), Err(SceneError::Point { point: 0, .. })));
        }
    }
}

//! Camera frusta: what a camera sees, up to a depth.

use nalgebra::{Point3, Vector2, Vector3};
use quadlift::geometry::ConvexBody;
use quadlift::scene::Frame;

use super::CheckedScene;

/// Default depth of the frusta, as a fraction of the median distance between cameras and objects.
const SHARE_OF_DISTANCE: f64 = 0.1;

impl CheckedScene<'_> {
    /// For each camera its center and the corners of its image (top left, top right, bottom right, bottom left) at a
    /// depth, in the world. Cameras without a center are skipped; a depth of zero skips all.
    pub(super) fn frusta(&self, depth: Option<f64>) -> Vec<[Point3<f64>; 5]> {
        let depth = depth.unwrap_or_else(|| SHARE_OF_DISTANCE * self.median_distance());
        if depth <= 0.0 {
            return Vec::new();
        }
        self.scene.frames.iter().filter_map(|frame| frustum(frame, depth)).collect()
    }

    /// Median distance of the cameras from the center of the objects; ten without cameras or objects.
    fn median_distance(&self) -> f64 {
        let n = self.objects.len().max(1) as f64;
        let middle = Point3::from(self.objects.iter().map(|o| o.body.center().coords).sum::<Vector3<f64>>() / n);
        let centers = self.scene.frames.iter().filter_map(|frame| frame.projection.center_in_world());
        let mut distances: Vec<f64> = centers.map(|center| (center - middle).norm()).collect();
        distances.sort_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied().filter(|_| !self.objects.is_empty()).unwrap_or(10.0)
    }
}

fn frustum(frame: &Frame, depth: f64) -> Option<[Point3<f64>; 5]> {
    let projection = &frame.projection;
    let center = projection.center_in_world()?;
    let m = projection.m();
    let axis = m.row(2).transpose().try_normalize(0.0)?;
    let principal = projection.project_point(&(center + axis))?;
    // Without an image size the principal point is used as the image center.
    let size = frame.image_size.unwrap_or(principal * 2.0);
    let corner = |x: f64, y: f64| {
        let pixel = Vector2::new(x * size.x, y * size.y);
        let pixel = frame.lens.and_then(|lens| lens.undistort_point(&pixel)).unwrap_or(pixel);
        let ray = projection.ray_in_world(&pixel)?;
        Some(center + ray * (depth / ray.dot(&axis)))
    };
    Some([center, corner(0.0, 0.0)?, corner(1.0, 0.0)?, corner(1.0, 1.0)?, corner(0.0, 1.0)?])
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;

    #[test]
    fn frusta_open_towards_what_the_camera_sees() {
        let file = test_scene::three_bodies();
        let scene = CheckedScene::new(&file, BodyChoice::Body).unwrap();
        let frusta = scene.frusta(Some(5.0));
        // The first camera looks along y from y = -10, its image is 640 pixels wide with a focal length of 500: at depth
        // 5 the corner is 3.2 to the left and 2.4 above.
        let expected = [[0.0, -10.0, 0.0], [-3.2, -5.0, 2.4], [3.2, -5.0, 2.4], [3.2, -5.0, -2.4], [-3.2, -5.0, -2.4]];
        for (found, expected) in frusta[0].iter().zip(expected) {
            assert!((found - Point3::from(expected)).norm() < 1e-12, "{found}");
        }
        assert_eq!((frusta.len(), scene.frusta(Some(0.0)).len()), (2, 0));
        // The objects' middle is (0, 0.5, -1/6); the cameras are 10.50 and 10.01 away from it, the upper median counts.
        let middle = Vector3::new(0.0, 0.5, -1.0 / 6.0);
        let depth = scene.frusta(None)[0][1].y + 10.0;
        assert!((depth - 0.1 * (Vector3::<f64>::new(0.0, -10.0, 0.0) - middle).norm()).abs() < 1e-12, "{depth}");
    }
}

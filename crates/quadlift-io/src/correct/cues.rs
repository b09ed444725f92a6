//! Depths and 3D boxes of detections, moved with the world of the corrected poses.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};
use quadlift::diagnosis::Correction;

use crate::scene_file::SceneFile;

/// Multiplies depths, the scales of depth images, point clouds and 3D boxes where the correction changes the unit of the world, and
/// mirrors point clouds and 3D boxes of the world where it mirrors the world. Those in the frame of a camera stay where they are: its axes are OpenCV's in every file.
pub(super) fn move_with_world(file: &mut SceneFile, correction: &Correction) {
    let origin = correction.world_point(&Point3::origin());
    let moved = |axis: usize| correction.world_point(&Matrix3::identity().column(axis).into_owned().into()) - origin;
    move_by(file, &Matrix3::from_columns(&[moved(0), moved(1), moved(2)]), &origin.coords);
}

/// The same for a world whose points `x` become `linear x + origin`; `linear` is a rotation or a mirror, times a factor.
pub(super) fn move_by(file: &mut SceneFile, linear: &Matrix3<f64>, origin: &Vector3<f64>) {
    if *linear == Matrix3::identity() && *origin == Vector3::zeros() {
        return;
    }
    let factor = linear.determinant().abs().cbrt();
    file.frames.iter_mut().filter_map(|frame| frame.depth.as_mut()).for_each(|depth| depth.scale *= factor);
    let world = linear.to_homogeneous().append_translation(origin);
    let larger = Matrix4::new_scaling(factor);
    for cloud in file.frames.iter_mut().filter_map(|frame| frame.point_cloud.as_mut()) {
        cloud.moved_by(if cloud.is_in_world() { &world } else { &larger });
    }
    file.point_cloud.iter_mut().for_each(|cloud| cloud.moved_by(&world));
    for record in &mut file.detections {
        record.move_cues(linear, origin);
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, SMatrix, SVector};
    use quadlift::geometry::{quaternion_from_rotation, rotation_from_quaternion};
    use serde_json::json;

    use super::*;
    use crate::correct::{Assumption, correct};
    use crate::scene_file::Box3dRecord;

    /// The axes of the camera see the box of the world in front of them.
    const POSE: [[f64; 4]; 3] = [[0.0, 1.0, 0.0, -1.0], [0.0, 0.0, -1.0, 2.0], [-1.0, 0.0, 0.0, 9.0]];

    fn box_of_world() -> Box3dRecord {
        let rotation = Rotation3::from_euler_angles(0.3, -0.4, 1.1);
        Box3dRecord {
            center: Some([1.0, 2.0, 3.0]),
            half_extents: Some([2.0, 1.0, 0.5]),
            rotation: Some(quaternion_from_rotation(&rotation)),
            frame: Some("world".into()),
            covariance: Some((0..9).map(|i| (0..9).map(|j| covariance()[(i, j)]).collect()).collect()),
            ..Default::default()
        }
    }

    /// Any covariance without zeros.
    fn covariance() -> SMatrix<f64, 9, 9> {
        let root = SMatrix::<f64, 9, 9>::from_fn(|i, j| 0.01 * (1.0 + (3 * i + 5 * j) as f64).sin());
        root * root.transpose() + SMatrix::identity() * 1e-4
    }

    fn corrected(assumed: &str, box3d: &Box3dRecord) -> SceneFile {
        let mut file: SceneFile = serde_json::from_value(json!({
            "format": "quadlift.scene", "version": 1,
            "cameras": [{"id": "c", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
            "frames": [{"id": "a", "camera": "c", "cam_from_world": POSE, "depth": {"path": "a.png", "scale": 2.0}}],
            "detections": [{"frame": "a", "object": "b", "box": [300, 200, 340, 260], "box3d": box3d,
                "depth": {"median": 8.5, "sd": 0.5, "source": "net"}}],
        }))
        .unwrap();
        correct(&mut file, &Assumption::corrections(&[assumed.parse().unwrap()]).unwrap()).unwrap();
        file
    }

    /// The corners of the box in the frame of the camera.
    fn corners(file: &SceneFile) -> Vec<Vector3<f64>> {
        let scene = file.to_scene().unwrap();
        let found = scene.detections[0].cues.as_deref().unwrap().box3d.unwrap();
        let corner = |k: usize| Vector3::from_fn(|axis, _| if k >> axis & 1 == 1 { 1.0 } else { -1.0 });
        let half = found.half_extents.unwrap();
        let place = |k| found.center.unwrap().coords + found.rotation.unwrap() * corner(k).component_mul(&half);
        (0..8).map(place).collect()
    }

    fn assert_same_corners(found: &[Vector3<f64>], expected: &[Vector3<f64>], what: &str) {
        for corner in expected {
            let nearest = found.iter().map(|other| (other - corner).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-9, "{what}: {found:?} {corner}");
        }
    }

    #[test]
    fn boxes_are_seen_where_they_were() {
        let given = corners(&corrected("boxes=xyxy", &box_of_world()));
        let seen = |assumed: &str| corners(&corrected(assumed, &box_of_world()));
        // Both axes of the camera and the world are left-handed, of which y points the other way.
        let mirrored: Vec<_> = given.iter().map(|p| Vector3::new(p.x, -p.y, p.z)).collect();
        assert_same_corners(&seen("poses=left-handed"), &mirrored, "left-handed");
        let smaller: Vec<_> = given.iter().map(|p| p * 0.01).collect();
        assert_same_corners(&seen("pose_unit=cm"), &smaller, "cm");
        // A box of the camera has the axes of OpenCV, whatever those of the poses are.
        let of_camera = Box3dRecord { frame: None, ..box_of_world() };
        let given = corners(&corrected("boxes=xyxy", &of_camera));
        assert_same_corners(&corners(&corrected("poses=left-handed", &of_camera)), &given, "camera");
        assert_same_corners(&corners(&corrected("poses=opengl", &of_camera)), &given, "camera");
    }

    #[test]
    fn lengths_are_those_of_the_new_unit() {
        let file = corrected("pose_unit=mm", &box_of_world());
        let depth = file.detections[0].depth.as_deref().unwrap();
        assert!((depth.median - 0.0085).abs() < 1e-15 && (depth.sd.unwrap() - 0.0005).abs() < 1e-15, "{depth:?}");
        assert_eq!(file.frames[0].depth.as_ref().unwrap().scale, 0.002);
        // Relative deviations do not change: the covariance is scaled with the distance.
        let sd = |file: &SceneFile| file.to_scene().unwrap().detections[0].cues.as_deref().unwrap().box3d.unwrap().sd;
        let (before, after) = (sd(&corrected("boxes=xyxy", &box_of_world())), sd(&file));
        for (a, b) in [(before.distance, after.distance), (before.direction, after.direction)] {
            assert!((a.unwrap() - b.unwrap()).abs() < 1e-12, "{before:?} {after:?}");
        }
        assert_eq!((before.size, before.rotation), (after.size, after.rotation));
    }

    /// Center, rotation vector and logarithms of the half extents of one box against those of another.
    fn difference(found: &Box3dRecord, from: &Box3dRecord) -> SVector<f64, 9> {
        let turn = |record: &Box3dRecord| rotation_from_quaternion(record.rotation.unwrap()).unwrap();
        let center = Vector3::from(found.center.unwrap()) - Vector3::from(from.center.unwrap());
        // Of a small turn, without the loss of digits of its angle.
        let small = (turn(from).inverse() * turn(found)).into_inner();
        let rotation = 0.5 * Vector3::new(small.m32 - small.m23, small.m13 - small.m31, small.m21 - small.m12);
        let sizes = [0, 1, 2].map(|k| (found.half_extents.unwrap()[k] / from.half_extents.unwrap()[k]).ln());
        SVector::from_iterator(center.iter().chain(rotation.iter()).chain(&sizes).copied())
    }

    /// The covariance of a moved box is that of the map from box to box, by differences.
    #[test]
    fn covariances_are_moved() {
        let mirror = Matrix3::from_diagonal(&[1.0, -1.0, 1.0].into());
        let turn = *Rotation3::from_euler_angles(0.2, 0.5, -0.3).matrix();
        for (factor, turn) in [(0.3, mirror), (2.0, turn), (1.0, turn * mirror)] {
            let moved = |change: &SVector<f64, 9>| {
                let given = box_of_world();
                let rotation = rotation_from_quaternion(given.rotation.unwrap()).unwrap()
                    * Rotation3::new(change.fixed_rows::<3>(3).into_owned());
                let mut changed = Box3dRecord {
                    center: given.center.map(|c| [0, 1, 2].map(|k| c[k] + change[k])),
                    half_extents: given.half_extents.map(|h| [0, 1, 2].map(|k| h[k] * change[6 + k].exp())),
                    rotation: Some(quaternion_from_rotation(&rotation)),
                    ..given
                };
                changed.move_by(&(turn * factor), &Vector3::zeros());
                changed
            };
            let start = moved(&SVector::zeros());
            let mut jacobian = SMatrix::<f64, 9, 9>::zeros();
            for k in 0..9 {
                let step = SVector::from_fn(|i, _| if i == k { 1e-5 } else { 0.0 });
                let change = (difference(&moved(&step), &start) - difference(&moved(&-step), &start)) / 2e-5;
                jacobian.set_column(k, &change);
            }
            let expected = jacobian * covariance() * jacobian.transpose();
            let rows = start.covariance.unwrap();
            let found = SMatrix::<f64, 9, 9>::from_fn(|i, j| rows[i][j]);
            assert!((found - expected).amax() < 1e-9, "{factor} {turn}: {found} {expected}");
        }
    }

    #[test]
    fn a_box_of_the_world_does_not_move_with_the_axes_of_cameras() {
        for assumed in ["poses=opengl", "poses=world-from-camera", "focal=2"] {
            let found = corrected(assumed, &box_of_world()).detections[0].box3d.take();
            assert_eq!(found.as_deref(), Some(&box_of_world()), "{assumed}");
        }
    }
}

//! The rule to compare with: the mean of the 3D boxes of an object, as detectors of single images fuse them over frames.

use quadlift::geometry::{Body, BodyKind};
use quadlift::nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use quadlift::scene::{Box3dCue, Detection, Scene};

/// A 3D box in the world.
fn in_world(scene: &Scene, detection: &Detection) -> Option<Body> {
    let Box3dCue { center: Some(center), half_extents: Some(half_extents), rotation: Some(rotation), .. } =
        detection.cues.as_ref()?.box3d?
    else {
        return None;
    };
    let projection = &scene.frames[detection.frame_index as usize].projection;
    let world_from_cam = projection.world_from_cam_rotation()?;
    let rotation = Rotation3::from_matrix_unchecked(world_from_cam * rotation.matrix());
    Some(Body {
        kind: BodyKind::Cuboid,
        center: projection.center_in_world()? + world_from_cam * center.coords,
        half_extents,
        rotation,
    })
}

/// The mean of the 3D boxes of an object (equal confidences): of centers and extents, and the mean axes of boxes that are turned by
/// half a circle against the first one where that brings them nearer.
pub(super) fn mean_box(scene: &Scene, object: usize) -> Option<Body> {
    let of_object = |d: &&Detection| d.object_index == Some(object as u32);
    let boxes: Vec<Body> = scene.detections.iter().filter(of_object).filter_map(|d| in_world(scene, d)).collect();
    let first = boxes.first()?.rotation;
    let count = boxes.len() as f64;
    let center = boxes.iter().fold(Vector3::zeros(), |sum, b| sum + b.center.coords) / count;
    let half_extents = boxes.iter().fold(Vector3::zeros(), |sum, b| sum + b.half_extents) / count;
    let half_turn = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let sum = boxes.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, b| {
        let turned = b.rotation * half_turn;
        let nearer = if turned.angle_to(&first) < b.rotation.angle_to(&first) { turned } else { b.rotation };
        sum + nearer.matrix()
    });
    Some(Body {
        kind: BodyKind::Cuboid,
        center: Point3::from(center),
        half_extents,
        rotation: Rotation3::from_matrix(&sum),
    })
}

//! KITTI's labels of the tracking benchmark: a line for each object in each frame, 17 fields. Meters, in the axes of each
//! frame's camera.
//!
//! The format supports rotation about the camera's y axis only: tilt is lost. Each body becomes the smallest upright
//! box that contains it, with the length along the longer of its two more horizontal axes; front and back are not
//! distinguished. The body is the box around the object, where there is one. Format: the development kit of the benchmark (`readme.txt`), as
//! [`crate::read::kitti`] reads it.

use std::f64::consts::PI;
use std::fmt::Write;

use nalgebra::{Matrix4, Vector3};
use quadlift::geometry::{CamFromWorld, ConvexBody};

use super::format::{ExportFormat, Writer};
use super::views::SeenObject;
use super::{CheckedScene, Document, Object, numbers_for};
use crate::read::kitti::read_cam_from_rect;

/// Options that a scene does not contain.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct KittiLabelOptions {
    /// Only frames in which the object was detected; otherwise all frames in which it is visible.
    pub only_detected: bool,
    /// From the rectified axes of KITTI's camera 0 to those of the scene's camera, in meters
    /// ([`crate::read::kitti::read_cam_from_rect`]); labels are written in the former. The identity where absent.
    pub cam_from_rect: Option<Matrix4<f64>>,
}

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "kitti",
    about: "KITTI tracking labels: upright boxes in the camera frame of each image",
    options: &["enclosing", "only_detected", "calib", "length_unit"],
    write: Writer::Bodies(|scene, options| {
        let cam_from_rect = options.calib.as_deref().map(read_cam_from_rect).transpose()?;
        Ok(kitti_labels(scene, &KittiLabelOptions { only_detected: options.only_detected, cam_from_rect }))
    }),
};

/// The labels of all frames, in their order. Frames and tracks have their ids as numbers, where all of these are whole
/// numbers (tracks also `t5`, as [`crate::read::kitti`] names them), or their positions.
pub(super) fn kitti_labels(scene: &CheckedScene, options: &KittiLabelOptions) -> Document {
    let (frames, by_position) = numbers_for(scene.scene.frames.iter().map(|frame| frame.id.as_str()), "");
    let (tracks, tracks_by_position) = numbers_for(scene.objects.iter().map(|object| object.id.as_str()), "t");
    let (meters, unit_note) = scene.meters();
    let rect_from_cam = options.cam_from_rect.and_then(|pose| pose.try_inverse()).unwrap_or_else(Matrix4::identity);
    let mut text = String::new();
    let mut labels = 0;
    for SeenObject { frame_index, object_index, bounding_box } in scene.seen_objects(options.only_detected) {
        let object = &scene.objects[object_index];
        let Some(pose) = scene.scene.frames[frame_index].projection.camera_pose() else { continue };
        let upright = UprightBox::around(object, &pose, meters, &rect_from_cam);
        let kind = object.category_name().replace(char::is_whitespace, "_");
        let kind = if object.category.is_some() { kind.as_str() } else { "Misc" };
        let [l, t, r, b] = bounding_box.edges();
        let UprightBox { size: [h, w, length], bottom: [x, y, z], rotation_y } = upright;
        let alpha = wrapped(rotation_y - x.atan2(z));
        // Truncation and occlusion are not estimated: -1, as the development kit has it. Writing to text cannot fail.
        let _ = write!(text, "{} {} {kind} -1 -1", frames[frame_index], tracks[object_index]);
        for number in [alpha, l, t, r, b, h, w, length, x, y, z, rotation_y] {
            // Zero is added to have no "-0".
            let _ = write!(text, " {:.6}", (number * 1e6).round() / 1e6 + 0.0);
        }
        text.push('\n');
        labels += 1;
    }
    let mut notes = vec!["tilt is lost: KITTI boxes rotate about the camera's y axis only".to_owned()];
    if options.cam_from_rect.is_none() {
        notes.push("locations are in the camera frame of each image; their P2 is K [I | 0]".to_owned());
    }
    if by_position {
        notes.push("frame ids have no numbers: frames were numbered from 0 in the order of the scene".to_owned());
    }
    if tracks_by_position {
        notes.push("object ids have no numbers: tracks were numbered from 0 in the order of the scene".to_owned());
    }
    notes.extend(unit_note);
    Document { content: text.into_bytes(), counts: vec![("label", labels)], notes }
}

/// A box of KITTI.
#[derive(Debug, Clone, Copy)]
struct UprightBox {
    /// Height, width, length.
    size: [f64; 3],
    /// Middle of the bottom face.
    bottom: [f64; 3],
    /// Turn about the y axis: of the x axis to the length.
    rotation_y: f64,
}

impl UprightBox {
    fn around(object: &Object, pose: &CamFromWorld, meters: f64, rect_from_cam: &Matrix4<f64>) -> Self {
        let rotation = pose.matrix().fixed_columns::<3>(0).into_owned();
        let body = object.boxed();
        let axes = rotation * body.rotation.matrix();
        // The two axes that are flatter in the camera, the longer one of them first.
        let mut flat = [0, 1, 2];
        flat.sort_by(|&a, &b| axes[(1, a)].abs().total_cmp(&axes[(1, b)].abs()));
        let along = if body.half_extents[flat[0]] >= body.half_extents[flat[1]] { flat[0] } else { flat[1] };
        let length = Vector3::new(axes[(0, along)], 0.0, axes[(2, along)]).normalize();
        let (height, width) = (Vector3::y(), length.cross(&Vector3::y()));
        let reach = |direction: &Vector3<f64>| meters * body.support(&(rotation.transpose() * direction));
        let center = (rotation * body.center.coords + pose.matrix().column(3)) * meters;
        let bottom = rect_from_cam.transform_point(&(center + height * reach(&height)).into());
        Self {
            size: [height, width, length].map(|direction| 2.0 * reach(&direction)),
            bottom: bottom.coords.into(),
            rotation_y: (-length.z).atan2(length.x),
        }
    }
}

/// An angle in [-pi, pi].
fn wrapped(angle: f64) -> f64 {
    angle - 2.0 * PI * (angle / (2.0 * PI)).round()
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;
    use crate::read::kitti_labels::parse_labels;
    use crate::scene_file::{BoundsRecord, SceneFile};
    use nalgebra::{Point3, Rotation3};
    use quadlift::geometry::{Body, BodyKind};

    fn labels(file: &SceneFile, options: &KittiLabelOptions) -> (String, Vec<String>) {
        let document = kitti_labels(&CheckedScene::new(file, BodyChoice::Body).unwrap(), options);
        (String::from_utf8(document.content).unwrap(), document.notes)
    }

    #[test]
    fn labels_have_their_seventeen_fields() {
        let (text, notes) = labels(&test_scene::three_bodies(), &KittiLabelOptions::default());
        insta::assert_snapshot!(text);
        assert_eq!(notes.len(), 3, "{notes:?}");
    }

    #[test]
    fn our_reader_finds_an_upright_cuboid_again() {
        let mut file = test_scene::three_bodies();
        // Lengths are millimeters; the world is that of the second camera, turned about its y axis.
        file.length_unit = Some("mm".into());
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.7)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let cuboid = Body {
            kind: BodyKind::Cuboid,
            center: Point3::new(1.0, 2.0, 3.0),
            half_extents: Vector3::new(1.0, 0.4, 0.3),
            rotation,
        };
        file.objects[1].set_true_body(&cuboid);
        let mut shift = Matrix4::identity();
        shift[(0, 3)] = 0.06;
        let options = KittiLabelOptions { cam_from_rect: Some(shift), ..KittiLabelOptions::default() };
        let (text, _) = labels(&file, &options);
        let labels = parse_labels("labels.txt".as_ref(), text.as_bytes()).unwrap();
        let scene = file.to_scene().unwrap();
        for (label, frame) in labels.iter().filter(|label| label.track == 1).zip(&scene.frames) {
            let pose = frame.projection.camera_pose().unwrap();
            // The corners are the same, whichever end is the front.
            let cam = label.rect_from_object();
            let half = label.half_extents();
            for corner in cuboid.corners() {
                let in_camera = pose.matrix() * corner.to_homogeneous() * 0.001;
                let local = cam.try_inverse().unwrap().transform_point(&(in_camera - Vector3::x() * 0.06).into());
                assert!((local.coords.abs() - half).amax() < 2e-6, "{local} {half}");
            }
            let seen = quadlift::geometry::project_bounding_box(&frame.projection, &cuboid).unwrap();
            for (a, b) in label.bounding_box.iter().zip(seen.edges()) {
                assert!((a - b).abs() < 1e-6);
            }
        }
        assert_eq!(labels.iter().map(|label| label.frame).collect::<Vec<_>>(), [90, 90, 90, 91, 91, 91]);
    }

    /// A label has the size of the box around its object, and its place.
    #[test]
    fn boxes_are_the_bounds_of_objects() {
        let mut file = test_scene::three_bodies();
        file.objects[0].bounds = Some(Box::new(BoundsRecord {
            center: [1.1, 0.5, 0.25],
            rotation: [1.0, 0.0, 0.0, 0.0],
            half_extents: [0.6, 0.3, 1.0],
            ..BoundsRecord::default()
        }));
        let (text, _) = labels(&file, &KittiLabelOptions::default());
        let label = &parse_labels("labels.txt".as_ref(), text.as_bytes()).unwrap()[0];
        // Length, height, width; the second camera looks at it from the end.
        let mut half: Vec<f64> = label.half_extents().iter().copied().collect();
        half.sort_by(f64::total_cmp);
        assert!(half.iter().zip([0.3, 0.6, 1.0]).all(|(a, b)| (a - b).abs() < 1e-6), "{half:?}");
        // The first camera stands at (0, -10, 0) and looks along y: the middle of the bottom is at x = 1.1 and .75 below it.
        let fields: Vec<&str> = text.lines().next().unwrap().split(' ').collect();
        assert_eq!(fields[13..16], ["1.100000", "0.750000", "10.500000"]);
    }

    #[test]
    fn a_tilted_body_is_held_by_its_box() {
        let mut file = test_scene::three_bodies();
        let rotation = Rotation3::from_euler_angles(0.4, -0.3, 1.0);
        let cuboid = Body {
            kind: BodyKind::Cuboid,
            center: Point3::origin(),
            half_extents: Vector3::new(0.3, 1.0, 0.4),
            rotation,
        };
        file.objects[1].set_true_body(&cuboid);
        let (text, _) = labels(&file, &KittiLabelOptions::default());
        let labels = parse_labels("labels.txt".as_ref(), text.as_bytes()).unwrap();
        let pose = file.to_scene().unwrap().frames[0].projection.camera_pose().unwrap();
        let object_from_cam = labels[1].rect_from_object().try_inverse().unwrap();
        let corners = cuboid.corners().map(|corner| {
            object_from_cam.transform_point(&(pose.matrix() * corner.to_homogeneous()).into()).coords.abs()
        });
        let reach = corners.into_iter().reduce(|a, b| a.sup(&b)).unwrap();
        assert!((reach - labels[1].half_extents()).amax() < 2e-6, "it touches all faces: {reach}");
    }
}

//! Camera poses that were refined with the objects (`localize --refine-poses`). Frames are shown from the refined poses,
//! which the objects belong to, and keep the given ones beside them.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::{Matrix3x4, Rotation3};
use quadlift::geometry::{CamFromWorld, Projection, rotation_vector};
use quadlift::scene::Scene;
use quadlift_io::{EntryError, SceneFile};
use serde_json::Value;

use crate::data::GivenPose;
use crate::run::three_digits;

/// The pose of a frame before and after its refinement.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RefinedPose {
    given: CamFromWorld,
    refined: CamFromWorld,
}

/// The refined poses of a result by the ids of their frames.
///
/// # Errors
/// [`EntryError`] names the first given or refined pose that is none.
pub(crate) fn refined_poses(estimate: &SceneFile) -> Result<BTreeMap<&str, RefinedPose>, EntryError> {
    let mut found = BTreeMap::new();
    for (index, frame) in estimate.frames.iter().enumerate() {
        let refused =
            |name: &str| EntryError::new(format!("frames[{index}].{name}"), "expected the 3x4 matrix of a camera");
        let (name, given) = match (frame.extra.get("given_cam_from_world"), frame.extra.get("given_projection")) {
            (Some(rows), _) => ("given_cam_from_world", matrix(rows).and_then(|rows| pose(&rows))),
            (None, Some(rows)) => ("given_projection", matrix(rows).and_then(|rows| pose_of_projection(&rows))),
            (None, None) => continue,
        };
        let given = given.ok_or_else(|| refused(name))?;
        let (name, refined) = match (&frame.cam_from_world, &frame.projection) {
            (Some(rows), _) => ("cam_from_world", pose(rows)),
            (None, Some(rows)) => ("projection", pose_of_projection(rows)),
            (None, None) => continue,
        };
        let refined = refined.ok_or_else(|| refused(name))?;
        found.insert(frame.id.as_str(), RefinedPose { given, refined });
    }
    Ok(found)
}

/// The scene with the refined poses of its frames. The scene may have the given poses or already the refined ones: only
/// the intrinsics of its frames are taken.
pub(crate) fn with_refined_poses<'a>(scene: &'a Scene, poses: &BTreeMap<&str, RefinedPose>) -> Cow<'a, Scene> {
    if poses.is_empty() {
        return Cow::Borrowed(scene);
    }
    let mut parts = scene.clone().into_parts();
    for frame in &mut parts.frames {
        let pose = poses.get(frame.id.as_str());
        if let Some(projection) = pose.and_then(|pose| with_pose(&frame.projection, &pose.refined)) {
            frame.projection = projection;
        }
    }
    // Poses make no scene invalid.
    Scene::from_parts(parts).map_or(Cow::Borrowed(scene), Cow::Owned)
}

/// Number of refined poses, and the medians of their corrections: name and text.
pub(crate) fn refined_overview(estimate: &SceneFile, poses: &BTreeMap<&str, RefinedPose>) -> Option<(String, String)> {
    let shift = median(poses.values().filter_map(RefinedPose::shift).collect())?;
    let angle = median(poses.values().map(RefinedPose::angle).collect())?;
    let text = format!(
        "{} of {} frames, median {} {}, {} deg",
        poses.len(),
        estimate.frames.len(),
        three_digits(shift),
        estimate.length_unit.as_deref().unwrap_or("units"),
        three_digits(angle.to_degrees())
    );
    Some(("poses refined".to_owned(), text))
}

impl RefinedPose {
    /// The given pose of a frame with this projection, for the page.
    pub(crate) fn for_page(&self, projection: &Projection) -> Option<GivenPose> {
        let given = with_pose(projection, &self.given)?;
        Some(GivenPose {
            projection: given.matrix().transpose().iter().copied().collect(),
            shift: self.shift()?,
            angle: self.angle(),
        })
    }

    /// Distance between the given and the refined center, world units.
    fn shift(&self) -> Option<f64> {
        let center = |pose: &CamFromWorld| Projection::from_matrix(*pose.matrix()).ok()?.center_in_world();
        Some((center(&self.refined)? - center(&self.given)?).norm())
    }

    /// Angle between the given and the refined axes, radians.
    fn angle(&self) -> f64 {
        let [given, refined] =
            [&self.given, &self.refined].map(|pose| pose.matrix().fixed_columns::<3>(0).into_owned());
        let turn = Rotation3::from_matrix_unchecked(refined * given.transpose());
        rotation_vector(&turn).norm()
    }
}

/// The same camera at another pose; `None` where it has no center (see [`Projection::camera_pose`]).
fn with_pose(projection: &Projection, pose: &CamFromWorld) -> Option<Projection> {
    Projection::from_matrix(projection.m() * projection.world_from_cam_rotation()? * pose.matrix()).ok()
}

fn matrix(value: &Value) -> Option<[[f64; 4]; 3]> {
    serde_json::from_value(value.clone()).ok()
}

fn pose(rows: &[[f64; 4]; 3]) -> Option<CamFromWorld> {
    CamFromWorld::new(Matrix3x4::from_fn(|i, j| rows[i][j])).ok()
}

fn pose_of_projection(rows: &[[f64; 4]; 3]) -> Option<CamFromWorld> {
    Projection::from_matrix(Matrix3x4::from_fn(|i, j| rows[i][j])).ok()?.camera_pose()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (low, high) = (values.get(values.len().checked_sub(1)? / 2)?, values.get(values.len() / 2)?);
    Some(0.5 * (low + high))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use quadlift::geometry::{BoundingBox, Intrinsics};
    use quadlift::scene::{NewDetection, SceneBuilder};
    use serde_json::json;

    use super::*;
    use crate::{Content, Report, recording, report};

    /// Looks along +y of the world, from `center`, turned about its own x axis.
    fn camera(center: [f64; 3], degrees: f64) -> CamFromWorld {
        let rotation = Rotation3::new(Vector3::x() * (degrees + 90.0).to_radians());
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(rotation.matrix());
        matrix.set_column(3, &-(rotation * Vector3::from(center)));
        CamFromWorld::new(matrix).unwrap()
    }

    fn rows(matrix: &Matrix3x4<f64>) -> Value {
        json!([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)])))
    }

    fn intrinsics() -> Intrinsics {
        Intrinsics::new(500.0, 520.0, 320.0, 240.0).unwrap()
    }

    fn scene(poses: &[CamFromWorld]) -> Scene {
        let mut builder = SceneBuilder::new("test");
        for (index, pose) in poses.iter().enumerate() {
            let id = index.to_string();
            builder.add_frame(&id, Projection::from_camera(&intrinsics(), pose), None).unwrap();
            let bounding_box = BoundingBox::new([10.0, 20.0, 110.0, 60.0]).ok();
            let input = NewDetection { frame: &id, object: Some("a"), bounding_box, ..Default::default() };
            builder.add_detection(&input).unwrap();
        }
        builder.build()
    }

    fn made(scene: &Scene, frames: &Value) -> Result<Report, EntryError> {
        let object = json!({ "id": "a", "status": "degenerate" });
        let file = json!({ "format": "quadlift.scene", "version": 1, "length_unit": "m", "frames": frames,
            "objects": [object], "localization": {} });
        let file: SceneFile = serde_json::from_value(file).unwrap();
        let content = Content {
            title: "t",
            scene,
            images: None,
            estimate: Some(&file),
            truth: None,
            source: None,
            points: &[],
            scores: None,
        };
        let report = report(&content)?;
        // A recording has the same cameras.
        for (frame, shown) in recording(&content, &[])?.frames.iter().zip(&report.frames) {
            let camera = frame.camera.as_ref().unwrap();
            let k = nalgebra::Matrix3::from_fn(|i, j| camera.intrinsics[i][j]);
            let pose = Matrix3x4::from_fn(|i, j| camera.cam_from_world[i][j]);
            assert!((k * pose - Matrix3x4::from_row_slice(&shown.projection)).amax() < 1e-9);
        }
        Ok(report)
    }

    #[test]
    fn frames_are_shown_from_refined_poses_beside_the_given_ones() {
        let given = [camera([0.0, 0.0, 0.0], 0.0), camera([1.0, 0.0, 0.0], 0.0), camera([2.0, 0.0, 0.0], 0.0)];
        let refined = [camera([0.0, 0.3, 0.4], 1.2), camera([1.0, 0.0, 0.2], -0.5), given[2]];
        let projection = |pose: &CamFromWorld| *Projection::from_camera(&intrinsics(), pose).matrix();
        let frames = json!([
            { "id": "0", "cam_from_world": rows(refined[0].matrix()), "given_cam_from_world": rows(given[0].matrix()) },
            { "id": "1", "projection": rows(&projection(&refined[1])), "given_projection": rows(&projection(&given[1])) },
            { "id": "2", "cam_from_world": rows(given[2].matrix()) },
        ]);
        // The scene has the poses as given, or as refined.
        for poses in [&given, &refined] {
            let report = made(&scene(poses), &frames).unwrap();
            let matrix = |numbers: &[f64]| Matrix3x4::from_row_slice(numbers);
            for (frame, pose) in report.frames.iter().zip(&refined) {
                assert!((matrix(&frame.projection) - projection(pose)).amax() < 1e-9, "{}", frame.id);
            }
            let old: Vec<Option<&GivenPose>> = report.frames.iter().map(|frame| frame.given.as_ref()).collect();
            let [Some(first), Some(second), None] = old[..] else { panic!("{old:?}") };
            for (found, pose, shift, degrees) in [(first, &given[0], 0.5, 1.2), (second, &given[1], 0.2, 0.5)] {
                assert!((matrix(&found.projection) - projection(pose)).amax() < 1e-9);
                assert!((found.shift - shift).abs() < 1e-9 && (found.angle.to_degrees() - degrees).abs() < 1e-9);
            }
            let line = ("poses refined".to_owned(), "2 of 3 frames, median 0.350 m, 0.850 deg".to_owned());
            assert_eq!(report.overview, [line]);
        }
    }

    #[test]
    fn reports_without_refined_poses_say_nothing_of_them() {
        let poses = [camera([0.0, 0.0, 0.0], 0.0)];
        let scene = scene(&poses);
        let report = made(&scene, &json!([{ "id": "0", "cam_from_world": rows(poses[0].matrix()) }])).unwrap();
        let expected: Vec<f64> = scene.frames[0].projection.matrix().transpose().iter().copied().collect();
        assert_eq!(report.frames[0].projection, expected, "to the last bit");
        assert!(!serde_json::to_string(&report).unwrap().contains("given"));
        assert_eq!(report.overview, []);
    }

    #[test]
    fn a_given_pose_that_is_none_is_refused() {
        let pose = camera([0.0, 0.0, 0.0], 0.0);
        let frame =
            json!({ "id": "0", "cam_from_world": rows(pose.matrix()), "given_cam_from_world": [[1, 0], [0, 1]] });
        let error = made(&scene(&[pose]), &json!([frame])).unwrap_err();
        assert_eq!(error.entry, "frames[0].given_cam_from_world");
    }
}

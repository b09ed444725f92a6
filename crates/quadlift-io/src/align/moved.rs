//! The records of a scene file in another frame: cameras, objects, and what is known of both.

use nalgebra::{DMatrix, Matrix3, Matrix3x4};
use quadlift::geometry::{
    CamFromWorld, Projection, Similarity, quaternion_from_rotation, rotation_from_quaternion, vech3,
};
use serde_json::{Value, json};

use crate::correct::move_world;
use crate::error::EntryError;
use crate::relocalize::LOCATION;
use crate::scene_file::object_records::KindRecord;
use crate::scene_file::{CovarianceRecord, ObjectRecord, REFERENCE, SceneFile};

/// The order of the entries of `vech` in a covariance.
const VECH: [(usize, usize); 6] = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)];

impl SceneFile {
    /// Moves everything to another frame: cameras, objects with their covariances, points, depths and 3D boxes, `up`. Where on Earth the
    /// world is, and how frames were located in another map, is left out.
    ///
    /// # Errors
    /// [`EntryError`] names the first projection that cannot be moved.
    pub(crate) fn move_by(&mut self, to: &Similarity) -> Result<(), EntryError> {
        for frame in &mut self.frames {
            frame.extra.remove(LOCATION);
            let given = |frame: &serde_json::Map<String, Value>, key: &str| -> Option<Matrix3x4<f64>> {
                let rows: [[f64; 4]; 3] = serde_json::from_value(frame.get(key)?.clone()).ok()?;
                Some(Matrix3x4::from_fn(|i, j| rows[i][j]))
            };
            let pose = given(&frame.extra, "given_cam_from_world").and_then(|matrix| CamFromWorld::new(matrix).ok());
            if let Some(moved) = pose.and_then(|pose| to.camera(&pose).ok()) {
                frame.extra.insert("given_cam_from_world".to_owned(), rows(moved.matrix()));
            }
            let projection = given(&frame.extra, "given_projection");
            if let Some(matrix) = projection {
                let moved = matrix * to.inverse().matrix();
                // Projections are written with `det M > 0`, at the scale that they had.
                if let Ok(moved) = Projection::from_matrix(moved * to.scale) {
                    frame.extra.insert("given_projection".to_owned(), rows(moved.matrix()));
                }
            }
            let covariance = frame.extra.get("pose_covariance").cloned();
            let covariance = covariance.and_then(|value| serde_json::from_value::<[[f64; 6]; 6]>(value).ok());
            if let Some(covariance) = covariance {
                // Rotation vector and shift of the camera, world axes.
                let mut by = DMatrix::zeros(6, 6);
                by.view_mut((0, 0), (3, 3)).copy_from(to.rotation.matrix());
                by.view_mut((3, 3), (3, 3)).copy_from(&(to.rotation.matrix() * to.scale));
                let moved = &by * DMatrix::from_fn(6, 6, |i, j| covariance[i][j]) * by.transpose();
                let rows: Vec<Vec<f64>> = moved.row_iter().map(|row| row.iter().copied().collect()).collect();
                frame.extra.insert("pose_covariance".to_owned(), json!(rows));
            }
        }
        move_world(self, to)?;
        self.objects.iter_mut().for_each(|object| move_object(object, to));
        self.up = self.up.map(|up| (to.rotation * nalgebra::Vector3::from(up)).into());
        self.extra.remove(REFERENCE);
        Ok(())
    }
}

fn rows(matrix: &Matrix3x4<f64>) -> Value {
    json!([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)])))
}

fn move_object(object: &mut ObjectRecord, to: &Similarity) {
    let center = |center: &mut [f64; 3]| *center = to.point(&(*center).into()).into();
    let turn = |wxyz: &mut [f64; 4]| {
        // `to_objects` reports what is no unit quaternion.
        if let Some(rotation) = rotation_from_quaternion(*wxyz) {
            *wxyz = quaternion_from_rotation(&(to.rotation * rotation));
        }
    };
    object.center.iter_mut().for_each(center);
    object.center_sd = object.center_sd.map(|sd| sd * to.scale);
    let move_body = |body: &mut dyn KindRecord| {
        let (at, rotation, lengths) = body.parts_mut();
        center(at);
        turn(rotation);
        lengths.into_iter().for_each(|length| *length *= to.scale);
    };
    object.bodies_mut().into_iter().for_each(move_body);
    object.half_extents_sd = object.half_extents_sd.map(|sd| sd.map(|sd| sd * to.scale));
    if let Some(covariance) = &mut object.covariance {
        move_covariance(covariance, to);
    }
}

/// The center is in the world, and so is the shape matrix; rotation vectors and log axes are in the object's frame.
fn move_covariance(covariance: &mut CovarianceRecord, to: &Similarity) {
    let rotation = to.rotation.matrix();
    let mut by = DMatrix::identity(9, 9);
    by.view_mut((0, 0), (3, 3)).copy_from(&(rotation * to.scale));
    if covariance.coordinates == "center_vech_shape" {
        for (k, (i, j)) in VECH.into_iter().enumerate() {
            let mut basis = Matrix3::zeros();
            basis[(i, j)] = to.scale * to.scale;
            basis[(j, i)] = to.scale * to.scale;
            by.view_mut((3, 3 + k), (6, 1)).copy_from(&vech3(&(rotation * basis * rotation.transpose())));
        }
    }
    let moved = &by * DMatrix::from_fn(9, 9, |i, j| covariance.matrix[i][j]) * by.transpose();
    covariance.matrix = std::array::from_fn(|i| std::array::from_fn(|j| moved[(i, j)]));
}

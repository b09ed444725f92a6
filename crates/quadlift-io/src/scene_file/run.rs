//! What a run leaves in a file: noise levels, refined poses.

use quadlift::Localization;
use quadlift::geometry::{BodyKind, CamFromWorld, Projection};
use quadlift::nalgebra::Matrix3x4;
use quadlift::solve::{Estimate, NoiseModel, Status};
use serde_json::{Value, json};

use super::frame_pose::matrix;
use super::records::SceneFile;
use crate::error::EntryError;

/// The name of the kind of body that was fitted: `mixed` where objects differ.
pub fn fitted_body_name(body: Option<BodyKind>) -> String {
    body.map_or_else(|| "mixed".to_owned(), |body| body.to_string())
}

/// Number of localized objects: those with the status `ok`.
pub fn count_localized(estimates: &[Estimate]) -> usize {
    estimates.iter().filter(|estimate| estimate.status == Status::Ok).count()
}

impl SceneFile {
    /// The noise levels that a result reports.
    ///
    /// # Errors
    /// [`EntryError`] when it reports none, or what is none.
    pub fn noise_levels(&self) -> Result<NoiseModel, EntryError> {
        let entry = "localization.noise";
        let levels = self.localization.as_ref().and_then(|about| about.get("noise")?.as_object());
        let levels = levels.filter(|levels| !levels.is_empty()).ok_or_else(|| {
            EntryError::new(entry, "there are no noise levels; expected a result of the method posterior")
        })?;
        let number = |(name, value): (&String, &Value)| {
            let problem = || format!("\"{name}\" is {value}; expected a number");
            value.as_f64().map(|x| (name.clone(), x)).ok_or_else(|| EntryError::new(entry, problem()))
        };
        let levels = levels.iter().map(number).collect::<Result<Vec<_>, _>>()?;
        let levels = levels.iter().map(|(name, x)| (name.as_str(), *x));
        NoiseModel::new(levels).map_err(|error| EntryError::new(entry, error))
    }

    /// The same with the corrected poses of its frames, in the order of the scene; the given ones are kept beside them.
    pub(crate) fn with_refined_poses(mut self, localization: &Localization) -> Self {
        for refined in &localization.refined_poses {
            let Some(frame) = self.frames.get_mut(refined.frame_index) else { continue };
            let rows = |matrix: &Matrix3x4<f64>| std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]));
            if let Some(given) = frame.cam_from_world {
                let corrected = CamFromWorld::new(matrix(&given)).and_then(|given| refined.cam_from_world(&given));
                let Ok(corrected) = corrected else { continue };
                frame.cam_from_world = Some(rows(corrected.matrix()));
                frame.extra.insert("given_cam_from_world".to_owned(), json!(given));
            } else if let Some(given) = frame.projection {
                let corrected = Projection::from_matrix(matrix(&given))
                    .ok()
                    .and_then(|given| given.with_moved_camera(&refined.turn, &refined.shift));
                let Some(corrected) = corrected else { continue };
                frame.projection = Some(rows(corrected.matrix()));
                frame.extra.insert("given_projection".to_owned(), json!(given));
            }
            if let Some(covariance) = &refined.covariance {
                let rows: Vec<Vec<f64>> = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
                frame.extra.insert("pose_covariance".to_owned(), json!(rows));
            }
        }
        self
    }
}

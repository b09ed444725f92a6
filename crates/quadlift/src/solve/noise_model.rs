//! Noise levels by name.

use std::collections::BTreeMap;

/// Names of the noise levels that can be given, as results report them; see [`NoiseModel`]. First the kinds of errors, in the
/// order of the noise groups of `posterior`.
pub(super) const NOISE_NAMES: [&str; 46] = [
    "edge_noise",
    "occluded_edge_noise",
    "ellipse_center",
    "ellipse_size",
    "ellipse_aspect",
    "ellipse_angle",
    "shape",
    "partial_ellipse",
    "depth",
    "box3d_distance",
    "box3d_direction",
    "box3d_size",
    "box3d_rotation",
    "edge_noise_px",
    CORRELATION_NAMES[0],
    CORRELATION_NAMES[1],
    CORRELATION_NAMES[2],
    OPPOSITE_CORRELATION_NAME,
    COMMON_NAMES[0],
    COMMON_NAMES[1],
    COMMON_NAMES[2],
    COMMON_NAMES[3],
    COMMON_NAMES[4],
    COMMON_NAMES[5],
    COMMON_NAMES[6],
    COMMON_NAMES[7],
    COMMON_NAMES[8],
    COMMON_NAMES[9],
    COMMON_NAMES[10],
    COMMON_NAMES[11],
    SPREAD_NAMES[0],
    SPREAD_NAMES[1],
    SHARE_NAMES[0],
    SHARE_NAMES[1],
    SHARE_NAMES[2],
    SHARE_NAMES[3],
    SHARE_NAMES[4],
    SHARE_NAMES[5],
    SHARE_NAMES[6],
    SYSTEMATIC_NAMES[0],
    SYSTEMATIC_NAMES[1],
    SYSTEMATIC_NAMES[2],
    SYSTEMATIC_NAMES[3],
    SYSTEMATIC_NAMES[4],
    SYSTEMATIC_NAMES[5],
    SYSTEMATIC_NAMES[6],
];

/// Errors common to the views of an object, for each kind of measurement.
pub(super) const COMMON_NAMES: [&str; 12] = [
    "edge_common",
    "ellipse_center_common",
    "ellipse_size_common",
    "ellipse_aspect_common",
    "ellipse_angle_common",
    "shape_common",
    "partial_ellipse_common",
    "depth_common",
    "box3d_distance_common",
    "box3d_direction_common",
    "box3d_size_common",
    "box3d_rotation_common",
];

/// Correlations of errors between neighboring views: of edges, of ellipses, of depths and 3D boxes.
pub(super) const CORRELATION_NAMES: [&str; 3] = ["edge_correlation", "ellipse_correlation", "cue_correlation"];

/// Correlation of the errors of opposite edges of a box, in the image: 1 where boxes are shifted, -1 where they are scaled.
pub(super) const OPPOSITE_CORRELATION_NAME: &str = "opposite_edge_correlation";

/// Mean squared residual of a scene in units of the noise, and the relative variance of that of its objects.
pub(super) const SPREAD_NAMES: [&str; 2] = ["residual_level", "residual_spread"];

/// Shares in scenes of boxes: of wrong boxes; of ellipsoids, rounded bodies, cuboids and cylinders; of upright objects; the mean of the
/// cuboid's part in rounded bodies.
pub(super) const SHARE_NAMES: [&str; 7] = [
    "wrong_box_share",
    "ellipsoid_share",
    "rounded_share",
    "cuboid_share",
    "cylinder_share",
    "upright_share",
    "cuboid_part",
];

/// Of scenes of boxes: precision of the cuboid's part; systematic errors by direction (relative to the support), of the sides of boxes (in
/// half sizes) and of drifting poses; factors on the variance of the noise, for heavy tails and for correlated views.
pub(super) const SYSTEMATIC_NAMES: [&str; 7] = [
    "cuboid_part_precision",
    "direction_error",
    "side_error",
    "drift_error",
    "independent_factor",
    "robust_factor",
    "correlation_factor",
];

/// Pose noise in results, which is not noise of detections: root mean square corrections, and frames over which errors last.
pub(crate) const POSE_NOISE_NAMES: [&str; 3] = ["pose_rotation", "pose_translation", "pose_correlation_length"];

/// Noise levels by the names under which [`crate::solve::SceneSolution::noise`] reports them: standard deviations relative to
/// the half size of a detection (`edge_noise_px`: in pixels; `ellipse_angle`: radians times half the logarithm of the axis
/// ratio), correlations between neighboring views, the errors common to the views of an object (`edge_common` and
/// others: in units of the noise), and differences between objects (`residual_level`, `residual_spread`). The last two
/// kinds affect only covariances.
///
/// With them the estimate of an object depends on its own views and the options only, not on the other objects of the
/// scene, so objects can be localized independently: on several machines, or one by one as they are seen. Ground planes
/// and pose corrections are still shared by the objects of a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NoiseModel(BTreeMap<&'static str, f64>);

/// Why noise levels are rejected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoiseModelError {
    /// There is no noise level of this name.
    #[error("\"{0}\" is not a noise level; expected one of {names}", names = NOISE_NAMES.join(", "))]
    Unknown(String),
    /// A duplicate name.
    #[error("{0} is given twice")]
    Twice(&'static str),
    /// A number out of its range.
    #[error("{name} is {value}; expected {expected}")]
    Range {
        /// Name of the level.
        name: &'static str,
        /// What was found.
        value: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// `edge_noise_px` without the level that it belongs to.
    #[error("edge_noise_px is given without edge_noise; expected both")]
    PixelsAlone,
}

impl NoiseModel {
    /// Accepts the levels of results and ignores their pose noise. Levels that are not given have their defaults: 0.1,
    /// of partial ellipses 0.2, of occluded edges twice that of others, `edge_noise_px` 67 times `edge_noise`, correlations
    /// and common errors 0.
    ///
    /// # Errors
    /// [`NoiseModelError`] names the level that is unknown or out of range.
    pub fn new<'a>(levels: impl IntoIterator<Item = (&'a str, f64)>) -> Result<Self, NoiseModelError> {
        let mut by_name = BTreeMap::new();
        for (given, value) in levels {
            if POSE_NOISE_NAMES.contains(&given) {
                continue;
            }
            let name = (NOISE_NAMES.into_iter().find(|name| *name == given))
                .ok_or_else(|| NoiseModelError::Unknown(given.to_owned()))?;
            let (fits, expected) = match name {
                _ if CORRELATION_NAMES.contains(&name) => {
                    ((0.0..1.0).contains(&value), "a number of at least 0 and below 1")
                }
                _ if name == OPPOSITE_CORRELATION_NAME => (value.abs() < 1.0, "a number above -1 and below 1"),
                _ if SHARE_NAMES.contains(&name) => ((0.0..=1.0).contains(&value), "a number from 0 to 1"),
                _ if name == "edge_noise_px" || COMMON_NAMES.contains(&name) || SPREAD_NAMES.contains(&name) => {
                    (value >= 0.0 && value.is_finite(), "a finite number that is not negative")
                }
                _ => (value > 0.0 && value.is_finite(), "a finite number above 0"),
            };
            if !fits {
                return Err(NoiseModelError::Range { name, value, expected });
            }
            if by_name.insert(name, value).is_some() {
                return Err(NoiseModelError::Twice(name));
            }
        }
        if by_name.contains_key("edge_noise_px") && !by_name.contains_key("edge_noise") {
            return Err(NoiseModelError::PixelsAlone);
        }
        Ok(Self(by_name))
    }

    /// What the residuals of a scene show.
    pub(crate) fn of_report(levels: impl IntoIterator<Item = (&'static str, f64)>) -> Self {
        Self(levels.into_iter().collect())
    }

    /// The level with this name, if given.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// The given levels, in the order of `NOISE_NAMES`.
    pub fn levels(&self) -> impl Iterator<Item = (&'static str, f64)> {
        NOISE_NAMES.into_iter().filter_map(|name| Some((name, self.get(name)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_results_report_is_taken_and_mistakes_are_named() {
        let noise_model =
            NoiseModel::new([("edge_noise_px", 2.0), ("edge_noise", 0.03), ("pose_rotation", 0.1)]).unwrap();
        assert_eq!(noise_model.levels().collect::<Vec<_>>(), [("edge_noise", 0.03), ("edge_noise_px", 2.0)]);
        let error = |name, value| NoiseModel::new([(name, value)]).unwrap_err().to_string();
        assert!(
            error("edge", 0.1)
                .starts_with("\"edge\" is not a noise level; expected one of edge_noise, occluded_edge_noise")
        );
        assert_eq!(error("shape", 0.0), "shape is 0; expected a finite number above 0");
        assert_eq!(error("edge_noise", f64::NAN), "edge_noise is NaN; expected a finite number above 0");
        assert_eq!(
            error("edge_correlation", 1.0),
            "edge_correlation is 1; expected a number of at least 0 and below 1"
        );
        let twice = NoiseModel::new([("shape", 0.1), ("shape", 0.2)]);
        assert_eq!(twice.unwrap_err().to_string(), "shape is given twice");
        assert_eq!(error("edge_noise_px", 1.0), "edge_noise_px is given without edge_noise; expected both");
    }
}

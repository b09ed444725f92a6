//! The names of COLMAP's camera models, their numbers in its files and the order of their parameters.

/// A camera model of COLMAP: how a ray becomes a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[allow(missing_docs)] // The names are COLMAP's; `parameter_names` lists what each one has.
pub enum CameraModel {
    SimplePinhole,
    Pinhole,
    SimpleRadial,
    Radial,
    OpenCv,
    OpenCvFisheye,
    FullOpenCv,
    Fov,
    SimpleRadialFisheye,
    RadialFisheye,
    ThinPrismFisheye,
    RadTanThinPrismFisheye,
    SimpleDivision,
    Division,
    SimpleFisheye,
    Fisheye,
    Eucm,
    Equirectangular,
}

use CameraModel as M;

/// Every model with its name and parameters; the index is its number in COLMAP's files.
const TABLE: [(CameraModel, &str, &[&str]); 18] = [
    (M::SimplePinhole, "SIMPLE_PINHOLE", &["f", "cx", "cy"]),
    (M::Pinhole, "PINHOLE", &["fx", "fy", "cx", "cy"]),
    (M::SimpleRadial, "SIMPLE_RADIAL", &["f", "cx", "cy", "k"]),
    (M::Radial, "RADIAL", &["f", "cx", "cy", "k1", "k2"]),
    (M::OpenCv, "OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]),
    (M::OpenCvFisheye, "OPENCV_FISHEYE", &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"]),
    (M::FullOpenCv, "FULL_OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
    (M::Fov, "FOV", &["fx", "fy", "cx", "cy", "omega"]),
    (M::SimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", &["f", "cx", "cy", "k"]),
    (M::RadialFisheye, "RADIAL_FISHEYE", &["f", "cx", "cy", "k1", "k2"]),
    (
        M::ThinPrismFisheye,
        "THIN_PRISM_FISHEYE",
        &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
    ),
    (
        M::RadTanThinPrismFisheye,
        "RAD_TAN_THIN_PRISM_FISHEYE",
        &["fx", "fy", "cx", "cy", "k0", "k1", "k2", "k3", "k4", "k5", "p0", "p1", "s0", "s1", "s2", "s3"],
    ),
    (M::SimpleDivision, "SIMPLE_DIVISION", &["f", "cx", "cy", "k"]),
    (M::Division, "DIVISION", &["fx", "fy", "cx", "cy", "k"]),
    (M::SimpleFisheye, "SIMPLE_FISHEYE", &["f", "cx", "cy"]),
    (M::Fisheye, "FISHEYE", &["fx", "fy", "cx", "cy"]),
    (M::Eucm, "EUCM", &["fx", "fy", "cx", "cy", "alpha", "beta"]),
    (M::Equirectangular, "EQUIRECTANGULAR", &["w", "h"]),
];

/// Most parameters of a model.
pub(super) const MAX_PARAMETERS: usize = 16;

impl CameraModel {
    /// All models, in the order of their numbers in COLMAP's binary files, from 0.
    pub fn all() -> impl ExactSizeIterator<Item = Self> + Clone {
        TABLE.iter().map(|row| row.0)
    }

    /// The model with a name, such as `OPENCV`; `None` when there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        TABLE.iter().find(|row| row.1 == name).map(|row| row.0)
    }

    /// The name in COLMAP's files.
    pub fn name(self) -> &'static str {
        TABLE[self as usize].1
    }

    /// The names of the parameters, in their order: focal lengths and principal point in pixels, then coefficients
    /// without unit. (`EQUIRECTANGULAR` has the size of the image instead.)
    pub fn parameter_names(self) -> &'static [&'static str] {
        TABLE[self as usize].2
    }

    /// Whether `f` stands for both focal lengths.
    pub(super) fn has_one_focal_length(self) -> bool {
        self.parameter_names()[0] == "f"
    }

    /// Whether the angle from the axis, rather than its tangent, is what the polynomial of the model bends.
    pub(super) fn is_fisheye(self) -> bool {
        matches!(
            self,
            M::OpenCvFisheye
                | M::SimpleRadialFisheye
                | M::RadialFisheye
                | M::ThinPrismFisheye
                | M::RadTanThinPrismFisheye
                | M::SimpleFisheye
                | M::Fisheye
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_the_order_of_the_numbers() {
        for (index, model) in CameraModel::all().enumerate() {
            assert_eq!(model as usize, index);
            assert_eq!(CameraModel::from_name(model.name()), Some(model));
            assert!(model.parameter_names().len() <= MAX_PARAMETERS);
        }
        assert_eq!(CameraModel::all().len(), 18);
        assert!(CameraModel::from_name("pinhole").is_none());
    }
}

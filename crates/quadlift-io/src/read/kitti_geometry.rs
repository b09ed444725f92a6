//! Common parts of KITTI tracking and raw data: calibration, GPS/IMU poses, the chain of transforms.
//!
//! Formulas: the devkit of the raw data (`convertOxtsToPose.m`), the same as in pykitti.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3};
use quadlift::geometry::Intrinsics;

use super::import::PixelCenters;
use super::poses::{check_rigid, inverse, matrix4, rows};
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::scene_file::CameraRecord;
use crate::text::{Line, lines};

/// Radius of the earth in the Mercator projection, in meters.
const EARTH_RADIUS: f64 = 6_378_137.0;

/// Numbers in a line of GPS/IMU data.
const OXTS_NUMBERS: usize = 30;

/// Image sizes of KITTI's days by the focal length of their rectified color cameras.
const IMAGE_SIZES: [(f64, [f64; 2]); 5] = [
    (721.5377, [1242.0, 375.0]),
    (707.0493, [1224.0, 370.0]),
    (718.3351, [1238.0, 374.0]),
    (707.0912, [1226.0, 370.0]),
    (718.856, [1241.0, 376.0]),
];

/// The image size of the day whose cameras have this focal length.
pub(super) fn image_size_of(focal_length: f64) -> Option<[f64; 2]> {
    IMAGE_SIZES.iter().find(|(f, _)| (f - focal_length).abs() < 1e-3).map(|(_, size)| *size)
}

/// The numbers of a calibration file by their names. Names end with a colon or a blank; lines with text (dates) are
/// passed over.
pub(super) fn calibration<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<Calibration<'a>, ReadError> {
    let mut entries = BTreeMap::new();
    for line in lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment()) {
        let (name, rest) = line.text.split_once([':', ' ']).unwrap_or((line.text, ""));
        let numbers = rest.split_whitespace().map(|word| word.parse::<f64>().ok().filter(|x| x.is_finite()));
        entries.insert(name, (line, numbers.collect::<Option<Vec<f64>>>()));
    }
    Ok(Calibration { path, entries })
}

/// The entries of a calibration file.
pub(super) struct Calibration<'a> {
    path: &'a Path,
    entries: BTreeMap<&'a str, (Line<'a>, Option<Vec<f64>>)>,
}

impl Calibration<'_> {
    /// `N` numbers with one of several names.
    pub(super) fn numbers<const N: usize>(&self, names: &[&str]) -> Result<[f64; N], ReadError> {
        let Some((name, (line, numbers))) = names.iter().find_map(|name| self.entries.get_key_value(name)) else {
            return Err(ReadError::new(self.path, format!("there is no \"{}\"", names.join("\" or \""))));
        };
        let found = numbers.as_deref().unwrap_or_default();
        found.try_into().map_err(|_| line.error(format!("\"{name}\" has {} numbers; expected {N}", found.len())))
    }

    /// A 3x3 rotation.
    pub(super) fn rotation(&self, names: &[&str]) -> Result<Matrix4<f64>, ReadError> {
        let matrix = matrix4(&Matrix3::from_row_slice(&self.numbers::<9>(names)?), &Vector3::zeros());
        self.rigid(names, matrix)
    }

    /// A 3x4 rotation and translation.
    pub(super) fn transform(&self, names: &[&str]) -> Result<Matrix4<f64>, ReadError> {
        let numbers = self.numbers::<12>(names)?;
        let mut matrix = Matrix4::identity();
        matrix.fixed_view_mut::<3, 4>(0, 0).copy_from(&nalgebra::Matrix3x4::from_row_slice(&numbers));
        self.rigid(names, matrix)
    }

    /// A rotation `R` and a translation `T` in lines of their own.
    pub(super) fn rotation_and_translation(&self) -> Result<Matrix4<f64>, ReadError> {
        let translation = Vector3::from(self.numbers::<3>(&["T"])?);
        let rotation = Matrix3::from_row_slice(&self.numbers::<9>(&["R"])?);
        self.rigid(&["R"], matrix4(&rotation, &translation))
    }

    fn rigid(&self, names: &[&str], matrix: Matrix4<f64>) -> Result<Matrix4<f64>, ReadError> {
        let name = format!("\"{}\"", names.join("\" or \""));
        check_rigid(&matrix, &name).map(|()| matrix).map_err(|problem| ReadError::new(self.path, problem))
    }

    /// A rectified camera from its 3x4 projection `K [I | b]`: intrinsics, and the shift of the camera against
    /// camera 0.
    pub(super) fn rectified_camera(&self, name: &str) -> Result<RectifiedCamera, ReadError> {
        let p: [f64; 12] = self.numbers(&[name])?;
        let error = |problem: String| ReadError::new(self.path, format!("\"{name}\": {problem}"));
        if [p[1], p[4], p[8], p[9]] != [0.0; 4] || p[10] != 1.0 {
            return Err(error("expected K [I | b] with K = [fx 0 cx; 0 fy cy; 0 0 1]".to_owned()));
        }
        let intrinsics = Intrinsics::new(p[0], p[5], p[2], p[6]).map_err(|e| error(e.to_string()))?;
        let shift = Vector3::new((p[3] - p[2] * p[11]) / p[0], (p[7] - p[6] * p[11]) / p[5], p[11]);
        Ok(RectifiedCamera { intrinsics, cam_from_rect: matrix4(&Matrix3::identity(), &shift) })
    }
}

/// A rectified camera of KITTI.
#[derive(Debug, Clone, Copy)]
pub(super) struct RectifiedCamera {
    pub intrinsics: Intrinsics,
    /// From the rectified axes of camera 0.
    pub cam_from_rect: Matrix4<f64>,
}

impl RectifiedCamera {
    /// The camera of a scene file.
    pub(super) fn record(&self, image_size: Option<[f64; 2]>, pixel_centers: PixelCenters) -> CameraRecord {
        let (k, shift) = (self.intrinsics, pixel_centers.shift());
        CameraRecord {
            id: "camera".to_owned(),
            model: "PINHOLE".to_owned(),
            width: image_size.map(|size| size[0]),
            height: image_size.map(|size| size[1]),
            params: vec![k.fx, k.fy, k.cx + shift, k.cy + shift],
            ..CameraRecord::default()
        }
    }
}

/// One line of GPS/IMU data: latitude, longitude (degrees), altitude, roll, pitch, yaw (radians).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Oxts([f64; 6]);

impl Oxts {
    /// Reads a line of 30 numbers.
    pub(super) fn read(line: &Line) -> Result<Self, ReadError> {
        let numbers = line.numbers()?;
        let n = numbers.len();
        let first = numbers.get(..6).and_then(|first| first.try_into().ok()).filter(|_| n == OXTS_NUMBERS);
        let first: [f64; 6] = first.ok_or_else(|| line.error(format!("found {n} numbers; expected {OXTS_NUMBERS}")))?;
        if first[0].abs() >= 90.0 {
            return Err(line.error(format!("the latitude is {}; expected degrees below 90", first[0])));
        }
        Ok(Self(first))
    }

    /// The scale of the Mercator projection: that of the first position of a drive is used for all of it.
    pub(super) fn mercator_scale(&self) -> f64 {
        self.0[0].to_radians().cos()
    }

    /// The pose of the IMU in Mercator coordinates: meters east, north and up.
    pub(super) fn earth_from_imu(&self, scale: f64) -> Matrix4<f64> {
        let [latitude, longitude, altitude, roll, pitch, yaw] = self.0;
        let east = scale * EARTH_RADIUS * longitude.to_radians();
        let north = scale * EARTH_RADIUS * (0.5 * (90.0 + latitude).to_radians()).tan().ln();
        // Rz(yaw) Ry(pitch) Rx(roll).
        let rotation = Rotation3::from_euler_angles(roll, pitch, yaw);
        matrix4(rotation.matrix(), &Vector3::new(east, north, altitude))
    }
}

/// From the rectified axes of camera 0 in the first frame, which are the world, to those in each frame. `None` for a
/// pose that cannot be inverted.
pub(super) fn rect_from_world(oxts: &[Oxts], scale: f64, rect_from_imu: &Matrix4<f64>) -> Option<Vec<Matrix4<f64>>> {
    let first = oxts.first()?;
    let imu_from_rect = inverse(rect_from_imu)?;
    // About the first position, so that no digits are lost on coordinates of millions of meters.
    let origin = first.earth_from_imu(scale).column(3).into_owned();
    let pose = |oxts: &Oxts| {
        let mut pose = oxts.earth_from_imu(scale);
        for i in 0..3 {
            pose[(i, 3)] -= origin[i];
        }
        pose
    };
    let earth_from_world = pose(first) * imu_from_rect;
    oxts.iter().map(|oxts| Some(rect_from_imu * inverse(&pose(oxts))? * earth_from_world)).collect()
}

/// The rows of `cam_from_world` for a frame.
pub(super) fn camera_rows(camera: &RectifiedCamera, rect_from_world: &Matrix4<f64>) -> [[f64; 4]; 3] {
    rows(&(camera.cam_from_rect * rect_from_world))
}

//! From NumPy arrays to the cameras of a scene. Shapes and types are checked in Python, values are checked here.

use nalgebra::Matrix3x4;
use numpy::{PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use quadlift::geometry::{CamFromWorld, Intrinsics, Projection};
use quadlift_io::SceneFile;
use quadlift_io::scene_file::{CameraRecord, FrameRecord};

use crate::error::refuse;

/// Cameras and poses: the dictionary `FrameArrays` of `python/quadlift/_arrays.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct FrameArrays<'py> {
    /// (F, 3, 4), instead of intrinsics and poses.
    #[pyo3(default)]
    projections: Option<PyReadonlyArray3<'py, f64>>,
    /// (1, 3, 3) or (F, 3, 3).
    #[pyo3(default)]
    intrinsics: Option<PyReadonlyArray3<'py, f64>>,
    /// (1, 8) or (F, 8): OpenCV's coefficients of the lenses.
    #[pyo3(default)]
    distortion: Option<PyReadonlyArray2<'py, f64>>,
    /// (F, 3, 4).
    #[pyo3(default)]
    cam_from_world: Option<PyReadonlyArray3<'py, f64>>,
    /// (F, 2): width and height.
    #[pyo3(default)]
    image_sizes: Option<PyReadonlyArray2<'py, f64>>,
    frame_ids: Vec<String>,
    #[pyo3(default)]
    images: Option<Vec<String>>,
    #[pyo3(default)]
    name: Option<String>,
    #[pyo3(default)]
    length_unit: Option<String>,
    #[pyo3(default)]
    up: Option<[f64; 3]>,
}

/// A camera's rows as they stand in a file.
type Rows = [[f64; 4]; 3];

impl FrameArrays<'_> {
    /// A scene file with these frames.
    pub(crate) fn to_file(&self) -> PyResult<SceneFile> {
        if let Some((_, problem)) = self.problems().next() {
            return Err(refuse(problem));
        }
        let mut file = SceneFile {
            name: self.name.clone(),
            length_unit: self.length_unit.clone(),
            up: self.up,
            ..Default::default()
        };
        let sizes = self.image_sizes.as_ref().map(|sizes| sizes.as_array());
        let cameras = self.cameras();
        for index in 0..cameras {
            let lens = self.lens(index);
            let last = lens.iter().rposition(|coefficient| *coefficient != 0.0);
            let (model, terms) = match last {
                None => ("PINHOLE", 0),
                Some(0..4) => ("OPENCV", 4),
                Some(_) => ("FULL_OPENCV", 8),
            };
            let params = [&self.pinhole(index), &lens[..terms]].concat();
            file.cameras.push(CameraRecord {
                id: index.to_string(),
                model: model.into(),
                params,
                ..Default::default()
            });
        }
        for (index, id) in self.frame_ids.iter().enumerate() {
            let size = sizes.map(|sizes| [sizes[[index, 0]], sizes[[index, 1]]]);
            file.frames.push(FrameRecord {
                id: id.clone(),
                camera: (cameras > 0).then(|| (if cameras == 1 { 0 } else { index }).to_string()),
                cam_from_world: rows(&self.cam_from_world, index),
                projection: rows(&self.projections, index),
                width: size.map(|size| size[0]),
                height: size.map(|size| size[1]),
                image: self.images.as_ref().map(|images| images[index].clone()).filter(|image| !image.is_empty()),
                ..Default::default()
            });
        }
        Ok(file)
    }

    /// Frames with invalid cameras, with reasons. A shared invalid camera is reported for the first frame only.
    pub(crate) fn problems(&self) -> impl Iterator<Item = (usize, String)> {
        let count = self.frame_ids.len();
        let cameras = (0..self.cameras()).filter_map(|index| Some((index, self.problem_of_camera(index)?)));
        cameras.chain((0..count).filter_map(|index| Some((index, self.problem_of_pose(index)?))))
    }

    /// Number of cameras: none, one, or one for each frame.
    fn cameras(&self) -> usize {
        let Some(matrices) = &self.intrinsics else { return 0 };
        let lenses = self.distortion.as_ref().map_or(1, |lenses| lenses.as_array().nrows());
        matrices.as_array().shape()[0].max(lenses)
    }

    fn problem_of_camera(&self, index: usize) -> Option<String> {
        let k = self.intrinsics.as_ref()?.as_array();
        let entry = |i, j| k[[index.min(k.shape()[0] - 1), i, j]];
        let wrong = |problem: String| format!("intrinsics[{index}]: {problem}");
        let others = [entry(0, 1), entry(1, 0), entry(2, 0), entry(2, 1), entry(2, 2) - 1.0];
        if others.iter().any(|x| *x != 0.0) {
            return Some(wrong("expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]".to_owned()));
        }
        let [fx, fy, cx, cy] = self.pinhole(index);
        Intrinsics::new(fx, fy, cx, cy).err().map(|error| wrong(error.to_string()))
    }

    fn problem_of_pose(&self, index: usize) -> Option<String> {
        let matrix = |rows: Rows| Matrix3x4::from_fn(|i, j| rows[i][j]);
        if let Some(rows) = rows(&self.projections, index) {
            return (Projection::from_matrix(matrix(rows)).err()).map(|error| format!("projections[{index}]: {error}"));
        }
        let rows = rows(&self.cam_from_world, index)?;
        CamFromWorld::new(matrix(rows)).err().map(|error| format!("cam_from_world[{index}]: {error}"))
    }

    /// Focal lengths and principal point of a camera.
    fn pinhole(&self, index: usize) -> [f64; 4] {
        let Some(k) = self.intrinsics.as_ref().map(|k| k.as_array()) else { return [f64::NAN; 4] };
        let entry = |i, j| k[[index.min(k.shape()[0] - 1), i, j]];
        [entry(0, 0), entry(1, 1), entry(0, 2), entry(1, 2)]
    }

    /// Coefficients of the lens of a camera.
    fn lens(&self, index: usize) -> [f64; 8] {
        let Some(lenses) = self.distortion.as_ref().map(|lenses| lenses.as_array()) else { return [0.0; 8] };
        std::array::from_fn(|k| lenses[[index.min(lenses.nrows() - 1), k]])
    }
}

/// One matrix of several.
fn rows(matrices: &Option<PyReadonlyArray3<f64>>, index: usize) -> Option<Rows> {
    let matrices = matrices.as_ref()?.as_array();
    Some(std::array::from_fn(|i| std::array::from_fn(|j| matrices[[index, i, j]])))
}

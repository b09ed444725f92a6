//! Fixed cameras from the boxes of what stands or walks by, as arrays.

use nalgebra::Vector2;
use numpy::{PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quadlift::calibrate_rig::{
    CalibrateOptions, CalibratedCamera, Contradiction, KnownBaseline, Rig, RigBox, RigCamera, RigCategory,
    calibrate_rig as solve,
};
use quadlift::geometry::{BoundingBox, CamFromWorld, Intrinsics};
use quadlift::nalgebra::Matrix3x4;
use quadlift::solve::CategoryPriors;
use quadlift_io::builtin_priors;
use quadlift_io::calibrate_rig::{RigOptions, contradictions_in_words};

use crate::error::refuse;
use crate::rows::Names;

/// The boxes of a rig and what is known of its cameras: the dictionary `RigArrays` of `python/quadlift/_calibrate.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct RigArrays<'py> {
    /// (M, 4)
    boxes: PyReadonlyArray2<'py, f64>,
    /// (M,), numbers of cameras and of time steps.
    cameras: PyReadonlyArray1<'py, i64>,
    time_steps: PyReadonlyArray1<'py, i64>,
    objects: Names<'py>,
    categories: Names<'py>,
    /// (C, 3, 3)
    intrinsics: PyReadonlyArray3<'py, f64>,
    /// (C, 2)
    image_sizes: Option<PyReadonlyArray2<'py, f64>>,
    /// (C, 3, 4), NaN for cameras that are sought.
    cam_from_world: Option<PyReadonlyArray3<'py, f64>>,
    baselines: Vec<(usize, usize, f64)>,
    builtin_sizes: bool,
    upright: Vec<String>,
    still: Vec<String>,
    seed: u64,
}

impl RigArrays<'_> {
    fn rig_cameras(&self) -> PyResult<Vec<RigCamera>> {
        let (all, sizes) = (self.intrinsics.as_array(), self.image_sizes.as_ref().map(|sizes| sizes.as_array()));
        let poses = self.cam_from_world.as_ref().map(|poses| poses.as_array());
        let camera = |index: usize| {
            let k = |i: usize, j: usize| all[[index, i, j]];
            let intrinsics = Intrinsics::new(k(0, 0), k(1, 1), k(0, 2), k(1, 2));
            let pose = poses.map(|poses| Matrix3x4::from_fn(|i, j| poses[[index, i, j]]));
            let pose = pose.filter(|pose| !pose.iter().all(|x| x.is_nan())).map(CamFromWorld::new).transpose();
            Ok(RigCamera {
                intrinsics: intrinsics.map_err(|error| refuse(format!("intrinsics[{index}]: {error}")))?,
                image_size: sizes.map(|sizes| Vector2::new(sizes[[index, 0]], sizes[[index, 1]])),
                cam_from_world: pose.map_err(|error| refuse(format!("cam_from_world[{index}]: {error}")))?,
            })
        };
        (0..all.shape()[0]).map(camera).collect()
    }

    fn rig(&self) -> PyResult<Rig> {
        let cameras = self.rig_cameras()?;
        let sizes = if self.builtin_sizes { builtin_priors() } else { CategoryPriors::default() };
        let options = RigOptions { sizes, upright: self.upright.clone(), still: self.still.clone() };
        let mut names = Vec::new();
        let categories_of = self.categories.indices(&mut names);
        let mut categories = options.categories(&names);
        // Boxes without a category are those of people, unless it is said who is upright.
        let without = categories.len();
        categories.push(RigCategory { upright: self.upright.is_empty(), ..RigCategory::default() });
        let objects_of = self.objects.indices(&mut Vec::new());
        let of_row = |all: &[Option<u32>], row: usize| all.get(row).copied().flatten().map(|k| k as usize);
        let (boxes, camera_of, time_step_of) =
            (self.boxes.as_array(), self.cameras.as_array(), self.time_steps.as_array());
        // Time steps are numbered in their order.
        let mut known: Vec<i64> = time_step_of.iter().copied().collect();
        known.sort_unstable();
        known.dedup();
        let rig_box = |row: usize| {
            let bounding_box = BoundingBox::new(std::array::from_fn(|k| boxes[[row, k]]));
            let camera = usize::try_from(camera_of[row]).ok().filter(|&camera| camera < cameras.len());
            Ok(RigBox {
                camera: camera.ok_or_else(|| {
                    refuse(format!("cameras[{row}] is {}; there are {} cameras", camera_of[row], cameras.len()))
                })?,
                time_step: known.partition_point(|&other| other < time_step_of[row]),
                object: of_row(&objects_of, row),
                category: Some(of_row(&categories_of, row).unwrap_or(without)),
                bounding_box: bounding_box.map_err(|error| refuse(format!("boxes[{row}]: {error}")))?,
                box_in_image: None,
            })
        };
        let boxes = (0..boxes.nrows()).map(rig_box).collect::<PyResult<_>>()?;
        Ok(Rig { cameras, categories, boxes, up: None })
    }
}

/// The poses of the cameras of a rig.
#[pyfunction]
pub(crate) fn calibrate_rig<'py>(py: Python<'py>, arrays: RigArrays) -> PyResult<Bound<'py, PyDict>> {
    let rig = arrays.rig()?;
    let distance = |&(a, b, length): &(usize, usize, f64)| KnownBaseline { cameras: [a, b], length };
    let options = CalibrateOptions { baselines: arrays.baselines.iter().map(distance).collect(), seed: arrays.seed };
    let found = py.detach(|| solve(&rig, &options));
    let dict = PyDict::new(py);
    let cameras: Vec<_> = found.cameras.iter().map(|camera| camera_dict(py, camera)).collect::<PyResult<_>>()?;
    dict.set_item("cameras", cameras)?;
    dict.set_item("reference", found.reference)?;
    dict.set_item("scale", found.scale.name())?;
    dict.set_item("scale_sd", found.scale_sd)?;
    dict.set_item("up", found.vertical.map(|vertical| PyArray1::from_vec(py, vertical.up.iter().copied().collect())))?;
    dict.set_item("up_sd", found.vertical.map(|vertical| vertical.sd))?;
    dict.set_item("edge_noise", found.edge_noise)?;
    dict.set_item("consistent", found.is_consistent())?;
    let numbers: Vec<String> = (0..found.cameras.len()).map(|camera| camera.to_string()).collect();
    dict.set_item("contradictions", contradictions_in_words(&numbers, &found))?;
    Ok(dict)
}

fn camera_dict<'py>(py: Python<'py>, camera: &CalibratedCamera) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let rows = |rows: Vec<Vec<f64>>| PyArray2::from_vec2(py, &rows);
    let pose =
        camera.cam_from_world.map(|pose| pose.matrix().row_iter().map(|r| r.iter().copied().collect()).collect());
    let covariance = camera.covariance.map(|c| c.row_iter().map(|r| r.iter().copied().collect()).collect());
    let [rotation_sd, position_sd] = camera.sds().map_or([None; 2], |sds| sds.map(Some));
    dict.set_item("status", camera.status.name())?;
    dict.set_item("cam_from_world", pose.map(rows).transpose()?)?;
    dict.set_item("covariance", covariance.map(rows).transpose()?)?;
    dict.set_item("rotation_sd", rotation_sd)?;
    dict.set_item("position_sd", position_sd)?;
    dict.set_item("time_steps", camera.time_steps)?;
    dict.set_item("residual_px", camera.residual_px)?;
    dict.set_item("edge_noise", camera.edge_noise)?;
    dict.set_item("contradiction", camera.contradiction.map(Contradiction::name))?;
    Ok(dict)
}

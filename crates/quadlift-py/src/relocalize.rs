//! The camera of an image, from its boxes and a map of objects, as arrays.

use nalgebra::{Unit, Vector3};
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quadlift::geometry::{BoundingBox, CamFromWorld, Intrinsics};
use quadlift::relocalize::{CameraHeight, Gravity, LocateOptions, LocatedPose, Query, QueryBox, Relocalization};

use crate::error::refuse;
use crate::rows::Names;

/// The boxes of an image and what is known of its camera: the dictionary `LocateQuery` of `python/quadlift/_arrays.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LocateQuery<'py> {
    /// (N, 4)
    boxes: PyReadonlyArray2<'py, f64>,
    categories: Names<'py>,
    /// fx, fy, cx, cy.
    intrinsics: [f64; 4],
    image_size: Option<[f64; 2]>,
    edge_noise: Option<f64>,
    up: Option<[f64; 3]>,
    up_in_camera: Option<[f64; 3]>,
    /// Radians.
    up_sd: f64,
    height: Option<[f64; 2]>,
}

/// A direction of any length.
fn direction(name: &str, numbers: [f64; 3]) -> PyResult<Unit<Vector3<f64>>> {
    let direction = Unit::try_new(Vector3::from(numbers), 1e-9).filter(|d| d.iter().all(|x| x.is_finite()));
    direction
        .ok_or_else(|| refuse(format!("{name} is {numbers:?}; expected a direction, three numbers that are not all 0")))
}

impl LocateQuery<'_> {
    /// The boxes.
    pub(crate) fn query(&self) -> PyResult<Query> {
        let [fx, fy, cx, cy] = self.intrinsics;
        let boxes = self.boxes.as_array();
        let query_box = |(row, edges): (usize, ArrayView1<f64>)| {
            let bounding_box = BoundingBox::new(std::array::from_fn(|k| edges[k]));
            Ok(QueryBox {
                bounding_box: bounding_box.map_err(|error| refuse(format!("boxes[{row}]: {error}")))?,
                box_in_image: None,
                category: self.categories.of_row(row).map(str::to_owned),
            })
        };
        Ok(Query {
            intrinsics: Intrinsics::new(fx, fy, cx, cy).map_err(|error| refuse(format!("intrinsics: {error}")))?,
            image_size: self.image_size.map(Into::into),
            boxes: boxes.rows().into_iter().enumerate().map(query_box).collect::<PyResult<_>>()?,
        })
    }

    /// The options, with those of a map where none are given.
    pub(crate) fn options(&self, of_map: LocateOptions) -> PyResult<LocateOptions> {
        let up = self.up.map(|up| direction("up", up)).transpose()?;
        let needs_up = |name: &str| refuse(format!("{name} needs up, the direction against gravity in the world"));
        let gravity = match (self.up_in_camera, up) {
            (None, _) => None,
            (Some(_), None) => return Err(needs_up("up_in_camera")),
            (Some(numbers), Some(up_in_world)) => {
                Some(Gravity { up_in_world, up_in_camera: direction("up_in_camera", numbers)?, sd: self.up_sd })
            }
        };
        let height = match (self.height, up) {
            (None, _) => None,
            (Some(_), None) => return Err(needs_up("height")),
            (Some([height, sd]), Some(up_in_world)) => Some(CameraHeight { up_in_world, height, sd }),
        };
        let given = self.edge_noise.map(|edge_noise| LocateOptions { edge_noise, ..Default::default() });
        Ok(LocateOptions { gravity, height, ..given.unwrap_or(of_map) })
    }
}

/// What was found; `rows` has what stands for each landmark.
pub(crate) fn location<'py>(
    py: Python<'py>,
    located: &Relocalization,
    boxes: usize,
    rows: &[usize],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("status", located.status.name())?;
    let poses: Vec<_> = located.poses.iter().map(|pose| pose_dict(py, pose, boxes, rows)).collect::<PyResult<_>>()?;
    dict.set_item("poses", poses)?;
    Ok(dict)
}

fn pose_dict<'py>(py: Python<'py>, pose: &LocatedPose, boxes: usize, rows: &[usize]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let covariance: Vec<Vec<f64>> = pose.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
    let mut objects: Vec<Option<usize>> = vec![None; boxes];
    for &(query_box, landmark) in &pose.matches {
        objects[query_box] = Some(rows[landmark]);
    }
    dict.set_item("cam_from_world", matrix(py, &pose.cam_from_world)?)?;
    dict.set_item("covariance", PyArray2::from_vec2(py, &covariance)?)?;
    dict.set_item("sds", PyArray1::from_vec(py, pose.sds().to_vec()))?;
    dict.set_item("evidence", pose.evidence)?;
    dict.set_item("objects", objects)?;
    Ok(dict)
}

fn matrix<'py>(py: Python<'py>, pose: &CamFromWorld) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = pose.matrix().row_iter().map(|row| row.iter().copied().collect()).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}

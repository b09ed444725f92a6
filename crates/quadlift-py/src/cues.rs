//! From NumPy arrays to the depths and 3D boxes of detections.

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use quadlift::geometry::CamFromWorld;
use quadlift::scene::{Cues, SceneError};
use quadlift_io::scene_file::{Box3dRecord, Box3dSdRecord, DepthRecord, DetectionRecord};

use crate::rows::{Names, value, values};

/// Cues of M detections, the dictionary `CueArrays` of `python/quadlift/_arrays.py`. NaN means none.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct CueArrays<'py> {
    /// (M,): depth of the visible surface.
    depth: Option<PyReadonlyArray1<'py, f64>>,
    /// (M,): its standard deviation.
    depth_sd: Option<PyReadonlyArray1<'py, f64>>,
    depth_source: Names<'py>,
    /// (M, 3).
    center: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 3).
    half_extents: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 4): unit quaternions, w first.
    rotation: Option<PyReadonlyArray2<'py, f64>>,
    /// `camera`, which is the default, or `world`.
    frame: Names<'py>,
    /// (M, 4): of distance, direction, size, rotation.
    sd: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 81): by rows.
    covariance: Option<PyReadonlyArray2<'py, f64>>,
    source: Names<'py>,
}

impl CueArrays<'_> {
    /// A record with the depth and the 3D box of a row, unchecked.
    pub(crate) fn record(&self, row: usize) -> DetectionRecord {
        let depth = value(&self.depth, row).map(|median| {
            let source = self.depth_source.of_row(row).map(Into::into);
            Box::new(DepthRecord { median, sd: value(&self.depth_sd, row), source, ..Default::default() })
        });
        let (center, half_extents) = (values(&self.center, row), values(&self.half_extents, row));
        let rotation: Option<[f64; 4]> = values(&self.rotation, row);
        if center.is_none() && half_extents.is_none() && rotation.is_none() {
            return DetectionRecord { depth, ..Default::default() };
        }
        let sd = values::<4>(&self.sd, row).map(|sd| {
            let [distance, direction, size, rotation] = sd.map(|x| Some(x).filter(|x| !x.is_nan()));
            Box3dSdRecord { distance, direction, size, rotation }
        });
        let rows = |numbers: [f64; 81]| numbers.chunks(9).map(<[f64]>::to_vec).collect();
        let box3d = Box3dRecord {
            center,
            half_extents,
            rotation,
            frame: self.frame.of_row(row).map(Into::into),
            sd,
            covariance: values(&self.covariance, row).map(rows),
            source: self.source.of_row(row).map(Into::into),
            ..Default::default()
        };
        DetectionRecord { depth, box3d: Some(Box::new(box3d)), ..Default::default() }
    }

    /// The same as cues, checked; `pose` is that of the frame, `source_of` gives the index of a source.
    pub(crate) fn of_row(
        &self,
        row: usize,
        pose: impl Fn() -> Option<CamFromWorld>,
        source_of: impl FnMut(&str) -> Result<u32, SceneError>,
    ) -> Result<Cues, String> {
        self.record(row).cues(source_of, pose, str::to_owned).map_err(|error| {
            // ".box3d.rotation" is boxes3d["rotation"] here.
            let mut fields = error.entry.split('.').filter(|field| !field.is_empty());
            let array = if fields.next() == Some("depth") { "depths" } else { "boxes3d" };
            let place: String = fields.map(|field| format!("[\"{field}\"]")).collect();
            format!("{array}{place}[{row}]: {}", error.problem)
        })
    }
}

//! From NumPy arrays to the records of a scene file. Shapes and types are checked in Python; here, what is in them.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;
use quadlift::geometry::{BoundingBox, Ellipse, Intrinsics, Projection};
use quadlift_io::SceneFile;
use quadlift_io::scene_file::{
    CameraRecord, DetectionRecord, EllipseRecord, FrameRecord, MaskRecord, RleCounts, RleRecord,
};

use crate::error::refuse;

/// Cameras and poses.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct FrameArrays<'py> {
    /// (F, 3, 4), instead of intrinsics and poses.
    projections: Option<PyReadonlyArray3<'py, f64>>,
    /// (1, 3, 3) or (F, 3, 3).
    intrinsics: Option<PyReadonlyArray3<'py, f64>>,
    /// (F, 3, 4).
    cam_from_world: Option<PyReadonlyArray3<'py, f64>>,
    /// (F, 2): width and height.
    image_sizes: Option<PyReadonlyArray2<'py, f64>>,
    frame_ids: Vec<String>,
    images: Option<Vec<String>>,
    name: Option<String>,
    length_unit: Option<String>,
    up: Option<[f64; 3]>,
}

impl FrameArrays<'_> {
    /// A scene file with these frames.
    pub fn to_file(&self) -> PyResult<SceneFile> {
        let mut file = SceneFile {
            name: self.name.clone(),
            length_unit: self.length_unit.clone(),
            up: self.up,
            ..Default::default()
        };
        let sizes = self.image_sizes.as_ref().map(|sizes| sizes.as_array());
        let projections = self.projections.as_ref().map(|matrices| matrices.as_array());
        let poses = self.cam_from_world.as_ref().map(|matrices| matrices.as_array());
        let cameras = self.add_cameras(&mut file)?;
        for (index, id) in self.frame_ids.iter().enumerate() {
            let rows = |matrices: &numpy::ndarray::ArrayView3<f64>| {
                std::array::from_fn(|i| std::array::from_fn(|j| matrices[[index, i, j]]))
            };
            let size = sizes.map(|sizes| [sizes[[index, 0]], sizes[[index, 1]]]);
            let projection: Option<[[f64; 4]; 3]> = projections.as_ref().map(rows);
            if let Some(rows) = &projection {
                let matrix = nalgebra::Matrix3x4::from_fn(|i, j| rows[i][j]);
                Projection::from_matrix(matrix).map_err(|error| refuse(format!("projections[{index}]: {error}")))?;
            }
            file.frames.push(FrameRecord {
                id: id.clone(),
                camera: (cameras > 0).then(|| (if cameras == 1 { 0 } else { index }).to_string()),
                cam_from_world: poses.as_ref().map(rows),
                projection,
                width: size.map(|size| size[0]),
                height: size.map(|size| size[1]),
                image: self.images.as_ref().map(|images| images[index].clone()).filter(|image| !image.is_empty()),
                ..Default::default()
            });
        }
        Ok(file)
    }

    /// Adds a pinhole camera for each matrix of intrinsics; returns their number.
    fn add_cameras(&self, file: &mut SceneFile) -> PyResult<usize> {
        let Some(intrinsics) = &self.intrinsics else { return Ok(0) };
        let matrices = intrinsics.as_array();
        for (index, k) in matrices.outer_iter().enumerate() {
            let wrong = |problem: String| refuse(format!("intrinsics[{index}]: {problem}"));
            let others = [k[[0, 1]], k[[1, 0]], k[[2, 0]], k[[2, 1]], k[[2, 2]] - 1.0];
            if others.iter().any(|x| *x != 0.0) {
                return Err(wrong("expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]".to_owned()));
            }
            let params = [k[[0, 0]], k[[1, 1]], k[[0, 2]], k[[1, 2]]];
            Intrinsics::new(params[0], params[1], params[2], params[3]).map_err(|error| wrong(error.to_string()))?;
            let (id, model) = (index.to_string(), "PINHOLE".to_owned());
            file.cameras.push(CameraRecord { id, model, params: params.to_vec(), ..Default::default() });
        }
        Ok(matrices.shape()[0])
    }
}

/// Height and width, and runs of a mask, as in COCO.
type Runs = ([u32; 2], Vec<u32>);

/// Detections: M rows.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DetectionArrays<'py> {
    /// (M,): index of the frame.
    frame: PyReadonlyArray1<'py, i64>,
    /// (M, 4); a row of NaN is no box.
    boxes: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 5): centre, semi-axes, angle; a row of NaN is no ellipse.
    ellipses: Option<PyReadonlyArray2<'py, f64>>,
    /// The masks, of detections that have one.
    masks: Option<Vec<Option<Runs>>>,
    object: Names<'py>,
    category: Names<'py>,
    /// (M,); NaN where there is none.
    scores: Option<PyReadonlyArray1<'py, f64>>,
    source: Option<String>,
}

/// Texts by their index; none where it is negative.
#[derive(FromPyObject)]
struct Names<'py>(Option<PyReadonlyArray1<'py, i64>>, Vec<String>);

impl Names<'_> {
    fn of(&self, row: usize) -> Option<Box<str>> {
        let code = self.0.as_ref()?.as_array()[row];
        usize::try_from(code).ok().and_then(|index| self.1.get(index)).map(|name| name.as_str().into())
    }
}

impl DetectionArrays<'_> {
    /// Adds the detections to a file.
    pub fn add_to(&self, file: &mut SceneFile) -> PyResult<()> {
        let frames = self.frame.as_array();
        let boxes = self.boxes.as_ref().map(|boxes| boxes.as_array());
        let ellipses = self.ellipses.as_ref().map(|ellipses| ellipses.as_array());
        let scores = self.scores.as_ref().map(|scores| scores.as_array());
        file.detections.reserve(frames.len());
        for (row, &frame) in frames.iter().enumerate() {
            let Some(frame) = usize::try_from(frame).ok().and_then(|index| file.frames.get(index)) else {
                return Err(refuse(match file.frames.len() {
                    0 => format!("frame[{row}] is {frame}; there are no frames"),
                    count => format!("frame[{row}] is {frame}; expected 0 to {}: there are {count} frames", count - 1),
                }));
            };
            let bounding_box: Option<[f64; 4]> = (boxes.as_ref().map(|b| std::array::from_fn(|k| b[[row, k]])))
                .filter(|edges: &[f64; 4]| !edges.iter().all(|x| x.is_nan()));
            if let Some(edges) = bounding_box {
                BoundingBox::new(edges).map_err(|error| refuse(format!("boxes[{row}]: {error}")))?;
            }
            let ellipse: Option<[f64; 5]> = (ellipses.as_ref().map(|e| std::array::from_fn(|k| e[[row, k]])))
                .filter(|numbers: &[f64; 5]| !numbers.iter().all(|x| x.is_nan()));
            if let Some([x, y, a, b, angle]) = ellipse {
                Ellipse::new([x, y].into(), [a, b].into(), angle)
                    .map_err(|error| refuse(format!("ellipses[{row}]: {error}")))?;
            }
            if bounding_box.is_none() && ellipse.is_none() {
                return Err(refuse(format!("row {row} has neither a box nor an ellipse (all of its numbers are NaN)")));
            }
            let mask = self.masks.as_ref().and_then(|masks| masks[row].as_ref()).map(|(size, runs)| {
                let rle = RleRecord { size: *size, counts: RleCounts::Runs(runs.clone()), ..Default::default() };
                Box::new(MaskRecord { rle: Some(rle), ..Default::default() })
            });
            file.detections.push(DetectionRecord {
                frame: frame.id.as_str().into(),
                object: self.object.of(row),
                category: self.category.of(row),
                source: self.source.as_deref().map(Into::into),
                score: scores.map(|scores| scores[row]).filter(|score| !score.is_nan()),
                bounding_box,
                ellipse: ellipse.map(|[x, y, a, b, angle]| {
                    Box::new(EllipseRecord { center: [x, y], semi_axes: [a, b], angle, ..Default::default() })
                }),
                mask,
                ..Default::default()
            });
        }
        Ok(())
    }
}

//! From NumPy arrays to the detections of a scene. Shapes and types are checked in Python, values are checked here.

use numpy::ndarray::Array2;
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use quadlift::geometry::{BoundingBox, Ellipse};
use quadlift::scene::{self, Cues, Detection, Frame, Outlines, Scene, SceneError, SceneParts, Undistorted};
use quadlift_io::SceneFile;
use quadlift_io::scene_file::{DetectionRecord, MaskRecord, RleCounts, RleRecord};

use crate::cues::CueArrays;
use crate::error::refuse;
use crate::outlines::{OutlineArrays, RowShape};
use crate::rows::{Names, value, values};

/// Height and width, and runs of a mask, as in COCO.
type Runs = ([u32; 2], Vec<u32>);

/// Detections of a scene, or of a frame of an object map: M rows, the dictionary `DetectionArrays` of `python/quadlift/_arrays.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct DetectionArrays<'py> {
    /// (M,): index of the frame; any in an object map.
    frames: PyReadonlyArray1<'py, i64>,
    /// (M, 4); a row of NaN is no box.
    #[pyo3(default)]
    boxes: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 5): center, semi-axes, angle; a row of NaN is no ellipse.
    #[pyo3(default)]
    ellipses: Option<PyReadonlyArray2<'py, f64>>,
    /// The masks, of detections that have one.
    #[pyo3(default)]
    masks: Option<Vec<Option<Runs>>>,
    #[pyo3(default)]
    objects: Names<'py>,
    #[pyo3(default)]
    categories: Names<'py>,
    /// (M,); NaN for none.
    #[pyo3(default)]
    scores: Option<PyReadonlyArray1<'py, f64>>,
    #[pyo3(default)]
    source: Option<String>,
    /// (M, 4): edges that are known to be hidden, see [`Detection::occluded_edges`]. A scene file does not hold them.
    #[pyo3(default)]
    occluded_edges: Option<PyReadonlyArray2<'py, bool>>,
    /// Outlines and oriented boxes.
    #[pyo3(default)]
    outlines: Option<OutlineArrays<'py>>,
    /// Depths and 3D boxes.
    #[pyo3(default)]
    cues: Option<CueArrays<'py>>,
}

/// What was measured in a row, in the image as it is, checked.
struct Row {
    bounding_box: Option<BoundingBox>,
    ellipse: Option<Ellipse>,
    shape: RowShape,
}

impl Row {
    /// A record with what was measured.
    fn in_record(&self, record: DetectionRecord) -> DetectionRecord {
        DetectionRecord {
            bounding_box: self.bounding_box.map(|b| b.edges()),
            ellipse: self.ellipse.map(|ellipse| Box::new(ellipse.into())),
            outline: self.shape.outline.clone(),
            oriented_box: self.shape.oriented_box.map(|turned| Box::new(turned.into())),
            ..record
        }
    }
}

/// Data of detections in a scene file that is not in a scene.
pub struct Originals {
    /// What was measured, where a lens has been taken out of it since, or where a scene has the boxes around outlines; empty where no
    /// frame has a lens and no detection an outline or an oriented box.
    rows: Vec<Row>,
    /// Empty where there are none.
    masks: Vec<Option<Runs>>,
}

impl Originals {
    /// Adds the records of a scene's detections, from the index `first` on, to a scene file.
    pub fn add_records(&self, file: &mut SceneFile, scene: &Scene, first: usize) {
        let detections = scene.detections[first..].iter().enumerate();
        file.detections.extend(detections.map(|(row, detection)| self.record(row, scene, detection)));
    }

    fn record(&self, row: usize, scene: &Scene, detection: &Detection) -> DetectionRecord {
        let mask = self.masks.get(row).and_then(Option::as_ref).map(|(size, runs)| {
            let rle = RleRecord { size: *size, counts: RleCounts::Runs(runs.clone()), ..Default::default() };
            Box::new(MaskRecord { rle: Some(rle), ..Default::default() })
        });
        let record = DetectionRecord { mask, ..DetectionRecord::of_scene(scene, detection) };
        match self.rows.get(row) {
            Some(row) => row.in_record(record),
            None => record,
        }
    }
}

impl DetectionArrays<'_> {
    /// The detections of a frame as records, checked; or which row is wrong.
    pub(crate) fn records(&self, frame: &str) -> Result<Vec<DetectionRecord>, String> {
        let record = |row: usize| {
            let shape = self.shape(row)?;
            // A row without a shape must have a box.
            let edges = values(&self.boxes, row).or(shape.is_empty().then_some([f64::NAN; 4]));
            let found = Row { bounding_box: bounding_box(row, edges)?, ellipse: None, shape };
            Ok(found.in_record(DetectionRecord {
                frame: frame.into(),
                object: self.objects.of_row(row).map(Into::into),
                category: self.categories.of_row(row).map(Into::into),
                score: value(&self.scores, row),
                ..self.cues.as_ref().map(|cues| cues.record(row)).unwrap_or_default()
            }))
        };
        (0..self.frames.as_array().len()).map(record).collect()
    }

    /// Adds the detections to the parts of a scene, which are checked where a scene is made of them.
    pub fn add_to(self, scene: &mut SceneParts) -> PyResult<Originals> {
        let (first, count) = (scene.detections.len(), self.frames.as_array().len());
        if u32::try_from(first + count).is_err() {
            return Err(refuse("the scene is too large: more than 4294967295 detections"));
        }
        let source_index = self.source.as_ref().map(|source| {
            let known = scene.sources.iter().position(|name| name == source);
            known.unwrap_or_else(|| {
                scene.sources.push(source.clone());
                scene.sources.len() - 1
            }) as u32
        });
        let objects = self.objects.indices(&mut scene.object_ids);
        let categories = self.categories.indices(&mut scene.categories);
        let hidden = self.occluded_edges.as_ref().map(|edges| edges.as_array());
        let has_lens = scene.frames.iter().any(|frame| frame.lens.is_some());
        let has_shapes = self.outlines.is_some();
        let mut rows = Vec::with_capacity(if has_lens || has_shapes { count } else { 0 });
        let mut outlines = Outlines::default();
        scene.detections.reserve(count);
        for row in 0..count {
            let sources = &mut scene.cue_sources;
            let source_of = |name: &str| cue_source(sources, name);
            let (frame_index, found, cues) = self.row(row, &scene.frames, source_of).map_err(refuse)?;
            let (has_box, frame) = (found.bounding_box.is_some(), &scene.frames[frame_index as usize]);
            let Undistorted { bounding_box, ellipse, box_in_image } =
                frame.undistorted(found.bounding_box, found.ellipse);
            let mut detection = Detection {
                frame_index,
                object_index: objects.get(row).copied().flatten(),
                category_index: categories.get(row).copied().flatten(),
                source_index,
                score: value(&self.scores, row),
                bounding_box,
                ellipse,
                box_in_image,
                occluded_edges: hidden.map(|edges| std::array::from_fn(|k| edges[[row, k]])),
                cues: (!cues.is_empty()).then(|| Box::new(cues)),
                ..Default::default()
            };
            outlines.add(first + row, &mut detection, has_box, frame, &found.shape.shape()).map_err(refuse)?;
            scene.detections.push(detection);
            if has_lens || has_shapes {
                rows.push(found);
            }
        }
        outlines.hide(&mut scene.detections);
        Ok(Originals { rows, masks: self.masks.unwrap_or_default() })
    }

    /// All rows whose frame or measurements are wrong, and why.
    pub fn problems(&self, frames: &[Frame]) -> Vec<(usize, String)> {
        let rows = 0..self.frames.as_array().len();
        rows.filter_map(|row| Some((row, self.row(row, frames, |_| Ok(0)).err()?))).collect()
    }

    /// Frame, measurements and cues of a row, checked.
    fn row(
        &self,
        row: usize,
        frames: &[Frame],
        source_of: impl FnMut(&str) -> Result<u32, SceneError>,
    ) -> Result<(u32, Row, Cues), String> {
        let frame = self.frames.as_array()[row];
        let frame_index = u32::try_from(frame).ok().filter(|index| (*index as usize) < frames.len());
        let frame_index = frame_index.ok_or_else(|| match frames.len() {
            0 => format!("frames[{row}] is {frame}; there are no frames"),
            count => format!("frames[{row}] is {frame}; expected 0 to {}: there are {count} frames", count - 1),
        })?;
        let bounding_box = bounding_box(row, values(&self.boxes, row))?;
        let numbers: Option<[f64; 5]> = values(&self.ellipses, row);
        let ellipse = numbers.map(|[x, y, a, b, angle]| Ellipse::new([x, y].into(), [a, b].into(), angle));
        let ellipse = ellipse.transpose().map_err(|e| format!("ellipses[{row}]: {e}"))?;
        let pose = || frames[frame_index as usize].projection.camera_pose();
        let cues = self.cues.as_ref().map(|cues| cues.of_row(row, pose, source_of)).transpose()?.unwrap_or_default();
        let has_center = cues.box3d.is_some_and(|box3d| box3d.center.is_some());
        let shape = self.shape(row)?;
        if bounding_box.is_none() && ellipse.is_none() && shape.is_empty() && !has_center {
            let or_outline = if self.outlines.is_some() { " nor an outline nor an oriented box" } else { "" };
            let or_center = if self.cues.is_some() { " nor a 3D box with a center" } else { "" };
            let measured = format!("neither a box nor an ellipse{or_outline}{or_center}");
            return Err(format!("row {row} has {measured} (all of its numbers are NaN)"));
        }
        Ok((frame_index, Row { bounding_box, ellipse, shape }, cues))
    }

    /// Outline and oriented box of a row, checked.
    fn shape(&self, row: usize) -> Result<RowShape, String> {
        Ok(self.outlines.as_ref().map(|outlines| outlines.of_row(row)).transpose()?.unwrap_or_default())
    }
}

/// The box of a row, checked.
fn bounding_box(row: usize, edges: Option<[f64; 4]>) -> Result<Option<BoundingBox>, String> {
    edges.map(BoundingBox::new).transpose().map_err(|error| format!("boxes[{row}]: {error}"))
}

/// The index of a source of cues, which is added where it is new; there are few of them.
fn cue_source(sources: &mut Vec<String>, name: &str) -> Result<u32, SceneError> {
    let known = sources.iter().position(|known| known == name);
    let index = known.unwrap_or_else(|| {
        sources.push(name.to_owned());
        sources.len() - 1
    });
    u32::try_from(index).map_err(|_| SceneError::TooLarge)
}

/// The error of a scene with detections added from the index `first` on: with rows instead of indices.
pub(crate) fn refused(error: SceneError, first: usize) -> PyErr {
    let SceneError::DuplicateDetection { object, frame, first: earlier, second } = error else { return refuse(error) };
    let row = second - first;
    let place = match earlier.checked_sub(first) {
        Some(row) => format!("in row {row}"),
        None => "by a detection that the scene has".to_owned(),
    };
    refuse(format!("row {row}: the object \"{object}\" is detected twice in frame \"{frame}\" (first {place})"))
}

/// Which edges (left, top, right, bottom) of M boxes are probably hidden by another box of the same frame: (M, 4).
/// Invalid boxes neither hide nor are hidden.
#[pyfunction]
pub(crate) fn occluded_edges<'py>(
    py: Python<'py>,
    frames: PyReadonlyArray1<'py, i64>,
    boxes: PyReadonlyArray2<'py, f64>,
) -> Bound<'py, PyArray2<bool>> {
    let (frames, boxes) = (frames.as_array(), boxes.as_array());
    let place = |(row, frame): (usize, &i64)| {
        let found = BoundingBox::new(std::array::from_fn(|k| boxes[[row, k]])).ok()?;
        Some((*frame, found))
    };
    let places: Vec<_> = frames.iter().enumerate().map(place).collect();
    let edges = scene::occluded_edges(&places);
    let hidden = Array2::from_shape_fn((edges.len(), 4), |(row, k)| edges[row][k]);
    PyArray2::from_owned_array(py, hidden)
}

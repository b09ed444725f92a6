//! From NumPy arrays to the outlines and oriented boxes of detections.

use numpy::ndarray::Array2;
use numpy::{PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use quadlift::geometry::{OrientedBox, SUPPORT_DIRECTIONS};
use quadlift::scene::{self, Shape, check_outline};

use crate::rows::values;

/// Outlines and oriented boxes of M detections, the dictionary `OutlineArrays` of `python/quadlift/_outlines.py`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct OutlineArrays<'py> {
    /// (K, 2): the corners of all outlines, one after the other.
    corners: Option<PyReadonlyArray2<'py, f64>>,
    /// (M + 1,): where the corners of each detection begin, 0 to K; a detection without an outline has none.
    offsets: Option<PyReadonlyArray1<'py, i64>>,
    /// (M, 5): center, width and height, angle; a row of NaN is no oriented box.
    oriented_boxes: Option<PyReadonlyArray2<'py, f64>>,
    /// (M, 8): lines that are known to be hidden, see [`Shape::occluded_lines`].
    occluded_lines: Option<PyReadonlyArray2<'py, bool>>,
}

/// Outline and oriented box of a row.
#[derive(Clone, Default)]
pub(crate) struct RowShape {
    /// Corners of the outline.
    pub outline: Option<Box<[[f64; 2]]>>,
    /// The oriented box.
    pub oriented_box: Option<OrientedBox>,
    /// Lines that are known to be hidden.
    occluded_lines: Option<[bool; SUPPORT_DIRECTIONS]>,
}

impl RowShape {
    /// Whether there is neither an outline nor an oriented box.
    pub(crate) fn is_empty(&self) -> bool {
        self.outline.is_none() && self.oriented_box.is_none()
    }

    /// The shape as a scene takes it.
    pub(crate) fn shape(&self) -> Shape<'_> {
        let Self { outline, oriented_box, occluded_lines } = self;
        Shape { outline: outline.as_deref(), oriented_box: *oriented_box, occluded_lines: *occluded_lines }
    }
}

impl OutlineArrays<'_> {
    /// Outline and oriented box of a row, checked; or which number is wrong.
    pub(crate) fn of_row(&self, row: usize) -> Result<RowShape, String> {
        let outline = self.corners_of(row).filter(|corners| !corners.is_empty());
        if let Some(corners) = &outline {
            check_outline(corners).map_err(|error| format!("outlines[{row}]: {error}"))?;
        }
        let numbers: Option<[f64; 5]> = values(&self.oriented_boxes, row);
        let turned = numbers.map(|[x, y, width, height, angle]| {
            OrientedBox::new([x, y].into(), [width, height].into(), angle)
                .map_err(|error| format!("oriented_boxes[{row}]: {error}"))
        });
        let hidden = self.occluded_lines.as_ref().map(|lines| lines.as_array());
        Ok(RowShape {
            outline: outline.map(Vec::into_boxed_slice),
            oriented_box: turned.transpose()?,
            occluded_lines: hidden.map(|lines| std::array::from_fn(|k| lines[[row, k]])),
        })
    }

    /// The corners of a row's outline, none where it has none.
    fn corners_of(&self, row: usize) -> Option<Vec<[f64; 2]>> {
        let (corners, offsets) = (self.corners.as_ref()?.as_array(), self.offsets.as_ref()?.as_array());
        let place = |k: usize| usize::try_from(*offsets.get(k)?).ok();
        let range = place(row)?..place(row + 1)?.min(corners.nrows());
        Some(range.map(|k| [corners[[k, 0]], corners[[k, 1]]]).collect())
    }
}

/// Which lines of M outlines end where another outline of the same frame begins: (M, 8). Rows without a valid outline neither hide nor
/// are hidden.
#[pyfunction]
pub(crate) fn occluded_lines<'py>(
    py: Python<'py>,
    frames: PyReadonlyArray1<'py, i64>,
    outlines: OutlineArrays<'py>,
) -> Bound<'py, PyArray2<bool>> {
    let frames = frames.as_array();
    let corners: Vec<_> = (0..frames.len()).map(|row| outlines.corners_of(row)).collect();
    let places: Vec<_> = frames.iter().zip(&corners).map(|(frame, found)| Some((*frame, found.as_deref()?))).collect();
    let hidden = scene::occluded_lines(&places);
    let found = Array2::from_shape_fn((hidden.len(), SUPPORT_DIRECTIONS), |(row, k)| hidden[row][k]);
    PyArray2::from_owned_array(py, found)
}

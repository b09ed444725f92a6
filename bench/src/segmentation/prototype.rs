//! Figures of our numpy prototype on the same images, boxes and true masks. It segments the scored views only.

use crate::table::Cell;

/// A row: name, and the figures of the columns except the last one.
pub(super) type PrototypeRow = (&'static str, [f64; 7]);

/// On the real images.
pub(super) const REAL: [PrototypeRow; 4] = [
    ("GrabCut (OpenCV), each frame alone", [0.427, 0.702, 0.738, 17.0, 0.242, 0.370, 0.132]),
    ("sca", [0.756, 0.811, 0.832, 7.7, 0.146, 0.088, 0.000]),
    ("graphcut", [0.777, 0.827, 0.851, 7.1, 0.130, 0.094, 0.015]),
    ("sca, then GrabCut", [0.745, 0.794, 0.845, 8.0, 0.142, 0.150, 0.037]),
];

/// On the rendered scenes with the seeds 0 to 5.
pub(super) const RENDERED: [PrototypeRow; 4] = [
    ("GrabCut (OpenCV), each frame alone", [0.802, 0.811, 0.865, 7.4, 0.131, 0.224, 0.065]),
    ("sca", [0.850, 0.886, 0.934, 3.9, 0.086, 0.069, 0.010]),
    ("graphcut", [0.878, 0.890, 0.928, 3.6, 0.065, 0.080, 0.006]),
    ("sca, then GrabCut", [0.904, 0.912, 0.950, 3.1, 0.064, 0.056, 0.004]),
];

/// The cells of a row: angles are in degrees, all other figures are shares.
pub(super) fn cells((name, figures): &PrototypeRow) -> Vec<Cell> {
    let figures = figures.iter().enumerate().map(|(k, x)| Cell::number(*x, if k == 3 { 1 } else { 3 }));
    [(*name).into(), "prototype".into()].into_iter().chain(figures).collect()
}

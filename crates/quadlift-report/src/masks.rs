//! The masks of detections for a report, as a few rows of runs: at display resolution.

use quadlift::scene::Scene;
use quadlift_io::scene_file::SceneImages;
use quadlift_segment::Mask;
use rayon::prelude::*;

use crate::data::{MaskRows, ReportFrame};

/// Approximate maximum number of rows of a mask.
const ROWS: u32 = 64;

/// Masks in a report; with more detections none are shown.
const MAX_MASKS: usize = 5000;

/// Adds the masks of the frames with these indices to the frames of a report; returns notes about skipped masks.
///
/// Frames of cameras with lens distortion have none: their images are shown as a pinhole camera would see them.
pub(crate) fn add_masks(
    scene: &Scene,
    images: &SceneImages,
    indices: &[usize],
    frames: &mut [ReportFrame],
) -> Option<String> {
    let detections: usize = frames.iter().map(|frame| frame.detections.object.len()).sum();
    if detections > MAX_MASKS {
        return None;
    }
    let problems: Vec<Option<String>> = frames
        .par_iter_mut()
        .zip(indices)
        .filter(|(_, index)| scene.frames[**index].lens.is_none())
        .map(|(frame, _)| {
            let known = frame.detections.detection_index.iter().enumerate();
            let (rows, numbers): (Vec<usize>, Vec<usize>) =
                known.filter_map(|(row, index)| Some((row, (*index)?))).unzip();
            let mut problem = None;
            for (row, mask) in rows.into_iter().zip(images.read_masks(scene, &numbers)) {
                match mask {
                    Ok(Some(mask)) => frame.detections.masks.push(runs_of(row, &mask)),
                    Ok(None) => {}
                    Err(error) => problem = problem.or(Some(error.to_string())),
                }
            }
            problem
        })
        .collect();
    let first = problems.into_iter().flatten().next()?;
    Some(format!("some masks could not be read: {first}"))
}

/// The runs of a mask in every so many rows of pixels.
fn runs_of(row: usize, mask: &Mask) -> MaskRows {
    let step = mask.height.div_ceil(ROWS).max(1);
    let mut runs = Vec::new();
    // The row in the middle of each strip.
    for (y, pixels) in mask.rows().enumerate().skip(step as usize / 2).step_by(step as usize) {
        let top = mask.origin[1] + y as u32 - step / 2;
        let mut start = None;
        for x in 0..=pixels.len() {
            let inside = pixels.get(x).copied().unwrap_or(false);
            match (start, inside) {
                (None, true) => start = Some(x),
                (Some(from), false) => {
                    runs.extend([top, mask.origin[0] + from as u32, mask.origin[0] + x as u32]);
                    start = None;
                }
                _ => {}
            }
        }
    }
    MaskRows(row, step, runs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_becomes_runs_with_its_holes() {
        // A frame of 5 x 3 pixels with a hole in the middle.
        let ring = Mask::from_fn(5, 3, |x, y| !(x == 2 && y == 1));
        let ring = Mask { origin: [10, 20], ..ring };
        assert_eq!(runs_of(7, &ring), MaskRows(7, 1, vec![20, 10, 15, 21, 10, 12, 21, 13, 15, 22, 10, 15]));
    }

    #[test]
    fn large_masks_have_few_rows_and_keep_their_area() {
        let disc = Mask::from_fn(400, 400, |x, y| (f64::from(x) - 199.5).hypot(f64::from(y) - 199.5) < 200.0);
        let MaskRows(_, step, runs) = runs_of(0, &disc);
        assert!(runs.len() <= 3 * ROWS as usize && step == 7, "{} {step}", runs.len());
        let area: u32 = runs.chunks_exact(3).map(|run| step * (run[2] - run[1])).sum();
        assert!((f64::from(area) / disc.count() as f64 - 1.0).abs() < 0.02, "{area}");
    }
}

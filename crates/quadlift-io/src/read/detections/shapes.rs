//! Shapes that several annotation tools have in their own forms: rotated boxes, and masks in rows.

use quadlift_segment::{Mask, Rle};

use super::files::{Detected, Outline, extent};
use crate::scene_file::{RleCounts, RleRecord};

/// The corners of a box `[x0, y0, x1, y1]` that is turned about a point by an angle in degrees, clockwise in the image.
pub(super) fn oriented_box([x0, y0, x1, y1]: [f64; 4], pivot: [f64; 2], degrees: f64) -> [[f64; 2]; 4] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(|[x, y]| {
        let (dx, dy) = (x - pivot[0], y - pivot[1]);
        [pivot[0] + cos * dx - sin * dy, pivot[1] + sin * dx + cos * dy]
    })
}

/// Smallest and largest coordinates of a detection's shape.
pub(super) fn box_of(detected: &Detected) -> Option<[f64; 4]> {
    match &detected.outline {
        Outline::Circle([x, y, radius]) => Some([x - radius, y - radius, x + radius, y + radius]),
        Outline::Polygons(polygons) => Some(extent(polygons.iter().flatten().copied())),
        _ => detected.bounding_box,
    }
}

/// Adds a part to an object: polygons are gathered, boxes joined; other shapes are reduced to their box, which is
/// kept.
pub(super) fn add_part(object: &mut Detected, part: Detected) {
    if let (Outline::Polygons(all), Outline::Polygons(more)) = (&mut object.outline, &part.outline) {
        all.extend(more.iter().cloned());
        return;
    }
    if let (Some(a), Some(b)) = (box_of(object), box_of(&part)) {
        object.bounding_box = Some([a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]);
        object.outline = Outline::Unknown;
    }
}

/// The bounding box of an RLE mask; `None` if it is empty. Does not decode the image.
pub(super) fn box_of_runs(record: &RleRecord) -> Option<[u64; 4]> {
    let rle = runs_of(record)?;
    window(&rle, rle.size()[0])
}

/// The window of pixels in the right order is smaller than that of the wrong order by this factor.
const SPREAD: f64 = 4.0;

/// Whether the runs of a mask go along the rows of its image instead of its columns: read so, its pixels are together, and in the
/// order of COCO they are spread over the image.
pub(super) fn are_by_rows(record: &RleRecord) -> bool {
    let area = |[a0, b0, a1, b1]: [u64; 4]| (a1 - a0) as f64 * (b1 - b0) as f64;
    let of = |rle: &Rle| Some([window(rle, rle.size()[0])?, window(rle, rle.size()[1])?].map(area));
    runs_of(record).and_then(|rle| of(&rle)).is_some_and(|[by_columns, by_rows]| by_columns > SPREAD * by_rows)
}

fn runs_of(record: &RleRecord) -> Option<Rle> {
    let [height, width] = record.size;
    match &record.counts {
        RleCounts::Runs(runs) => Rle::new(height, width, runs.clone()).ok(),
        RleCounts::Compressed(text) => Rle::from_compressed(height, width, text).ok(),
    }
}

/// The first and the last line, and the first and the last place in a line, of a mask whose runs go along lines of a length:
/// left, top, right, bottom for columns.
fn window(rle: &Rle, length: u32) -> Option<[u64; 4]> {
    let length = u64::from(length);
    let mut window: Option<[u64; 4]> = None;
    let mut start = 0;
    for (index, &run) in rle.counts().iter().enumerate() {
        let end = start + u64::from(run);
        if index % 2 == 1 && run > 0 {
            let (first, last) = (start / length, (end - 1) / length);
            // A run that goes on in the next line reaches from one end to the other.
            let (low, high) = if first == last { (start % length, (end - 1) % length + 1) } else { (0, length) };
            let [a0, b0, a1, b1] = window.unwrap_or([first, low, last + 1, high]);
            window = Some([a0.min(first), b0.min(low), a1.max(last + 1), b1.max(high)]);
        }
        start = end;
    }
    window
}

/// Pixels of masks that a file may hold, so that the time to decode grows with its size only: a run of a few characters
/// may stand for millions of pixels.
#[derive(Debug, Default)]
pub(super) struct PixelBudget(u64);

impl PixelBudget {
    /// Pixels of an image of the largest size that is read.
    const ANY: u64 = 1 << 28;
    /// Pixels for each byte of a file. A row of a mask takes a few bytes, and its box is at most thousands of pixels wide.
    const PER_BYTE: u64 = 1 << 12;

    /// The budget of a file of so many bytes.
    pub(super) fn of_file(bytes: usize) -> Self {
        Self(Self::ANY.saturating_add(Self::PER_BYTE.saturating_mul(bytes as u64)))
    }

    /// Takes the pixels of a mask from it.
    pub(super) fn take(&mut self, pixels: u64) -> Result<(), String> {
        self.0 =
            self.0.checked_sub(pixels).ok_or("the masks have far more pixels than a file of this size describes")?;
        Ok(())
    }
}

/// A mask in the window `[left, top, width, height]` of an image. Its runs go along the rows of the window, alternately
/// outside and inside of the object. An error, in words, when they do not fill it.
pub(super) fn mask_of_rows(
    runs: &[u32],
    [left, top, width, height]: [u32; 4],
    image_size: [u32; 2],
    budget: &mut PixelBudget,
) -> Result<RleRecord, String> {
    let pixels = u64::from(width) * u64::from(height);
    let covered = runs.iter().fold(0, |sum: u64, &run| sum.saturating_add(u64::from(run)));
    if covered != pixels {
        return Err(format!("the runs cover {covered} pixels; the mask has {width} x {height}"));
    }
    let [image_width, image_height] = image_size;
    let fits = |start: u32, size: u32, all: u32| start.checked_add(size).is_some_and(|end| end <= all);
    if !fits(left, width, image_width) || !fits(top, height, image_height) {
        return Err(format!(
            "the mask has {width} x {height} pixels from column {left} and row {top} on; the image has \
             {image_width} x {image_height}"
        ));
    }
    budget.take(pixels)?;
    let mut inside = Vec::with_capacity(usize::try_from(pixels).map_err(|error| error.to_string())?);
    for (index, &run) in runs.iter().enumerate() {
        inside.resize(inside.len() + run as usize, index % 2 == 1);
    }
    let mask = Mask::new([left, top], width, height, inside).map_err(|error| error.to_string())?;
    let rle = Rle::of_mask(&mask, image_height, image_width).map_err(|error| error.to_string())?;
    Ok(RleRecord {
        size: [image_height, image_width],
        counts: RleCounts::Compressed(rle.to_compressed()),
        ..RleRecord::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_in_rows_become_masks_in_columns() {
        // Two rows: .##. and #...
        let mut budget = PixelBudget::of_file(0);
        let record = mask_of_rows(&[1, 2, 1, 1, 3], [2, 1, 4, 2], [8, 4], &mut budget).unwrap();
        let RleCounts::Compressed(text) = &record.counts else { panic!("{record:?}") };
        let mask = Rle::from_compressed(4, 8, text).unwrap().to_mask();
        assert_eq!(mask.pixels().collect::<Vec<_>>(), [[3, 1], [4, 1], [2, 2]]);
        let mut problem = |runs: &[u32], window| mask_of_rows(runs, window, [8, 4], &mut budget).unwrap_err();
        assert_eq!(problem(&[1, 2], [2, 1, 4, 2]), "the runs cover 3 pixels; the mask has 4 x 2");
        assert_eq!(
            problem(&[0, 8], [6, 1, 4, 2]),
            "the mask has 4 x 2 pixels from column 6 and row 1 on; the image has 8 x 4"
        );
        assert!(problem(&[1, 2], [u32::MAX, 1, 3, 1]).contains("from column 4294967295"));
        let mut small = PixelBudget(7);
        assert!(mask_of_rows(&[0, 8], [2, 1, 4, 2], [8, 4], &mut small).unwrap_err().contains("far more pixels"));
    }

    #[test]
    fn boxes_turn_clockwise() {
        let corners = oriented_box([0.0, 0.0, 4.0, 2.0], [0.0, 0.0], 90.0);
        let expected = [[0.0, 0.0], [0.0, 4.0], [-2.0, 4.0], [-2.0, 0.0]];
        for (found, expected) in corners.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-12, "{corners:?}");
        }
    }
}

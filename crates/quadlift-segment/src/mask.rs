//! A mask: which pixels of a window of the image belong to the object.

use quadlift::geometry::BoundingBox;

/// Why a mask is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MaskError {
    /// The list of pixels is longer or shorter than the window.
    #[error("the mask has {found} pixels; expected {width} x {height}")]
    Length {
        /// Number of pixels in the list.
        found: usize,
        /// Width of the window in pixels.
        width: u32,
        /// Height of the window in pixels.
        height: u32,
    },
    /// The window ends beyond what a 32-bit pixel position can name.
    #[error("the mask's window ends at pixel {0}; the largest position is 4294967295")]
    TooFar(u64),
}

/// The pixels of an object inside a window of the image: pixel `(origin.x + column, origin.y + row)` covers
/// `[x, x + 1) x [y, y + 1)`, its center is `(x + 0.5, y + 0.5)`. Pixels outside of the window are not the object's.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Mask {
    /// First column and first row of the window, in pixels of the image.
    pub origin: [u32; 2],
    /// Width of the window in pixels.
    pub width: u32,
    /// Height of the window in pixels.
    pub height: u32,
    /// `width * height` entries, row by row: whether the pixel is the object's.
    pub inside: Vec<bool>,
}

impl Mask {
    /// A checked mask.
    ///
    /// # Errors
    /// [`MaskError`] if the number of pixels differs from the window, or if the window is too far out.
    pub fn new(origin: [u32; 2], width: u32, height: u32, inside: Vec<bool>) -> Result<Self, MaskError> {
        if inside.len() as u64 != u64::from(width) * u64::from(height) {
            return Err(MaskError::Length { found: inside.len(), width, height });
        }
        for (start, size) in [(origin[0], width), (origin[1], height)] {
            let end = u64::from(start) + u64::from(size);
            if end > u64::from(u32::MAX) {
                return Err(MaskError::TooFar(end));
            }
        }
        Ok(Self { origin, width, height, inside })
    }

    /// The mask of a window at the image's origin whose pixel (column, row) is the object's where `inside` says so.
    pub fn from_fn(width: u32, height: u32, mut inside: impl FnMut(u32, u32) -> bool) -> Self {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for row in 0..height {
            pixels.extend((0..width).map(|column| inside(column, row)));
        }
        Self { origin: [0, 0], width, height, inside: pixels }
    }

    /// The rows of the window from the top.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = &[bool]> + ExactSizeIterator {
        self.inside.chunks_exact(self.width.max(1) as usize)
    }

    /// Whether the pixel (x, y) of the image is the object's.
    pub fn contains(&self, x: u32, y: u32) -> bool {
        let (Some(column), Some(row)) = (x.checked_sub(self.origin[0]), y.checked_sub(self.origin[1])) else {
            return false;
        };
        column < self.width
            && self.inside.get(row as usize * self.width as usize + column as usize).copied().unwrap_or(false)
    }

    /// The positions (x, y) of the object's pixels in the image, row by row.
    pub fn pixels(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.rows().zip(self.origin[1]..).flat_map(|(row, y)| {
            row.iter().zip(self.origin[0]..).filter(|(inside, _)| **inside).map(move |(_, x)| [x, y])
        })
    }

    /// Number of the object's pixels.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }

    /// The window `[x0, y0, x1, y1]` (end not included) of the object's pixels in the image; `None` if there are none.
    pub fn extent(&self) -> Option<[u32; 4]> {
        let has_pixels = |row: &[bool]| row.contains(&true);
        let top = self.rows().position(has_pixels)? as u32;
        let bottom = self.rows().rposition(has_pixels)? as u32;
        let (mut left, mut right) = (self.width, 0);
        for row in self.rows() {
            left = left.min(row.iter().position(|&inside| inside).map_or(left, |column| column as u32));
            right = right.max(row.iter().rposition(|&inside| inside).map_or(right, |column| column as u32));
        }
        let [x, y] = self.origin;
        Some([x + left, y + top, x + right + 1, y + bottom + 1])
    }

    /// The tight box of the object's pixel squares; `None` if there are none.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        let [x0, y0, x1, y1] = self.extent()?.map(f64::from);
        BoundingBox::new([x0, y0, x1, y1]).ok()
    }

    /// The same pixels in another window `[x0, y0, x1, y1]` (end not included) of the image; pixels outside of it are
    /// lost.
    pub fn in_window(&self, [x0, y0, x1, y1]: [u32; 4]) -> Self {
        let (width, height) = (x1.saturating_sub(x0), y1.saturating_sub(y0));
        Self { origin: [x0, y0], ..Self::from_fn(width, height, |column, row| self.contains(x0 + column, y0 + row)) }
    }

    /// The same pixels in the smallest window that holds them; an empty mask becomes a window without pixels.
    pub fn trimmed(&self) -> Self {
        let [x, y] = self.origin;
        self.in_window(self.extent().unwrap_or([x, y, x, y]))
    }

    /// Intersection over union of the pixels of two masks, in [0, 1]; 0 where both are empty.
    pub fn iou(&self, other: &Self) -> f64 {
        let both = self.pixels().filter(|&[x, y]| other.contains(x, y)).count();
        let either = self.count() + other.count() - both;
        if either == 0 { 0.0 } else { both as f64 / either as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The mask of a picture: `#` is the object's.
    fn drawn(origin: [u32; 2], rows: &[&str]) -> Mask {
        let inside = rows.iter().flat_map(|row| row.bytes().map(|byte| byte == b'#')).collect();
        Mask::new(origin, rows[0].len() as u32, rows.len() as u32, inside).unwrap()
    }

    #[test]
    fn pixels_are_counted_from_the_image_corner() {
        let mask = drawn([10, 20], &["....", ".##.", "..#."]);
        assert_eq!(mask.pixels().collect::<Vec<_>>(), [[11, 21], [12, 21], [12, 22]]);
        assert_eq!(mask.count(), 3);
        assert_eq!(mask.extent(), Some([11, 21, 13, 23]));
        assert_eq!(mask.bounding_box().unwrap().edges(), [11.0, 21.0, 13.0, 23.0]);
        assert!(mask.contains(12, 22) && !mask.contains(11, 22) && !mask.contains(0, 0) && !mask.contains(14, 21));
        assert_eq!(mask.trimmed(), drawn([11, 21], &["##", ".#"]));
        assert_eq!(mask.in_window([12, 20, 14, 22]), drawn([12, 20], &["..", "#."]));
    }

    #[test]
    fn empty_masks_have_no_box() {
        for mask in [Mask::default(), drawn([3, 4], &["..", ".."])] {
            assert_eq!((mask.extent(), mask.count(), mask.iou(&mask)), (None, 0, 0.0));
            assert_eq!(mask.trimmed().inside, []);
        }
    }

    #[test]
    fn masks_of_the_wrong_size_are_refused() {
        let error = Mask::new([0, 0], 3, 2, vec![true; 5]).unwrap_err();
        assert_eq!(error.to_string(), "the mask has 5 pixels; expected 3 x 2");
        assert!(matches!(Mask::new([u32::MAX, 0], 1, 1, vec![true]), Err(MaskError::TooFar(_))));
    }

    #[test]
    fn overlap_does_not_depend_on_windows() {
        let (a, b) = (drawn([0, 0], &["##", "##"]), drawn([1, 1], &["##", "##"]));
        assert!((a.iou(&b) - 1.0 / 7.0).abs() < 1e-15);
        assert_eq!(a.iou(&a.in_window([0, 0, 50, 40])), 1.0);
        assert_eq!(a.iou(&drawn([5, 5], &["#"])), 0.0);
    }

    proptest! {
        #[test]
        fn trimming_keeps_the_pixels(width in 1..9u32, height in 1..9u32, bits: u64, x in 0..100u32, y in 0..100u32) {
            let mut mask = Mask::from_fn(width, height, |column, row| bits >> (row * 8 + column).min(63) & 1 == 1);
            mask.origin = [x, y];
            let trimmed = mask.trimmed();
            prop_assert_eq!(mask.pixels().collect::<Vec<_>>(), trimmed.pixels().collect::<Vec<_>>());
            let window = trimmed.extent().map(|e| [e[2] - e[0], e[3] - e[1]]).unwrap_or([0, 0]);
            prop_assert_eq!(window, [trimmed.width, trimmed.height]);
        }
    }
}

//! COCO's run-length encoding of masks, compressed and not.
//!
//! Runs go down the columns of the whole image, from left to right; they are alternately outside and inside of the
//! object, the first one is outside (and may be empty). The compressed form writes each run, from the fourth one on
//! less the run before the last, as a little-endian number of five bits per character.

use crate::mask::Mask;
use crate::moments::{Moments, PixelSums, PixelTerm};

/// Maximum number of pixels of an image: an absurd size in a file must not exhaust the memory.
const MAX_PIXELS: u64 = 1 << 28;

/// The longest number in the compressed form, in characters: seven hold any run and any difference of two.
const MAX_NUMBER: u32 = 7;

/// Why runs are not a valid mask.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RleError {
    /// A character that the compressed form does not have.
    #[error("the character {found:?} at position {position} is not valid in COCO's compressed runs")]
    Character {
        /// The character.
        found: char,
        /// Its position in the text, in bytes from 0.
        position: usize,
    },
    /// The text ends inside a number.
    #[error("the compressed runs end in the middle of a number")]
    CutOff,
    /// A run is negative or longer than any image.
    #[error("run {index} has the length {length}; expected a number from 0 to {MAX_PIXELS}")]
    Run {
        /// Index of the run, from 0.
        index: usize,
        /// Its length.
        length: i64,
    },
    /// The runs do not fill the image.
    #[error("the runs cover {found} pixels; the size [{height}, {width}] has {}", u64::from(*.height) * u64::from(*.width))]
    Length {
        /// Sum of the runs.
        found: u64,
        /// Height of the image in pixels.
        height: u32,
        /// Width of the image in pixels.
        width: u32,
    },
    /// The image is too large.
    #[error("the size [{height}, {width}] is too large; at most {MAX_PIXELS} pixels are read")]
    TooLarge {
        /// Height of the image in pixels.
        height: u32,
        /// Width of the image in pixels.
        width: u32,
    },
}

/// A mask of a whole image as runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rle {
    height: u32,
    width: u32,
    counts: Vec<u32>,
}

impl Rle {
    /// Checked runs: COCO's uncompressed form. `height` and `width` of the image are in the order of COCO's "size".
    ///
    /// # Errors
    /// [`RleError`] if the runs do not fill the image exactly, or if it is too large.
    pub fn new(height: u32, width: u32, counts: Vec<u32>) -> Result<Self, RleError> {
        let pixels = u64::from(height) * u64::from(width);
        if pixels > MAX_PIXELS {
            return Err(RleError::TooLarge { height, width });
        }
        let found = counts.iter().fold(0, |sum: u64, &count| sum.saturating_add(u64::from(count)));
        if found != pixels {
            return Err(RleError::Length { found, height, width });
        }
        Ok(Self { height, width, counts })
    }

    /// The runs of COCO's compressed form.
    ///
    /// # Errors
    /// [`RleError`] if the text is not in this form, or as [`Rle::new`].
    pub fn from_compressed(height: u32, width: u32, text: &str) -> Result<Self, RleError> {
        let mut counts: Vec<u32> = Vec::new();
        let mut characters = text.char_indices();
        while !characters.as_str().is_empty() {
            let mut number = compressed_number(&mut characters)?;
            let index = counts.len();
            if index > 2 {
                number += i64::from(counts[index - 2]);
            }
            if !(0..=MAX_PIXELS as i64).contains(&number) {
                return Err(RleError::Run { index, length: number });
            }
            counts.push(number as u32);
        }
        Self::new(height, width, counts)
    }

    /// The runs of a mask in an image of this size; pixels of the mask outside the image are dropped.
    ///
    /// # Errors
    /// [`RleError::TooLarge`].
    pub fn of_mask(mask: &Mask, height: u32, width: u32) -> Result<Self, RleError> {
        if u64::from(height) * u64::from(width) > MAX_PIXELS {
            return Err(RleError::TooLarge { height, width });
        }
        let (mut counts, mut run, mut inside) = (Vec::new(), 0, false);
        let mut add = |now: bool, length: u32| {
            if now != inside && length > 0 {
                counts.push(std::mem::replace(&mut run, 0));
                inside = now;
            }
            run += length;
        };
        let [left, top] = mask.origin;
        let (x0, x1) = (left.min(width), left.saturating_add(mask.width).min(width));
        let (y0, y1) = (top.min(height), top.saturating_add(mask.height).min(height));
        add(false, x0 * height);
        for x in x0..x1 {
            add(false, y0);
            (y0..y1).for_each(|y| add(mask.contains(x, y), 1));
            add(false, height - y1);
        }
        add(false, (width - x1) * height);
        counts.push(run);
        Ok(Self { height, width, counts })
    }

    /// Height and width of the image in pixels: COCO's "size".
    pub fn size(&self) -> [u32; 2] {
        [self.height, self.width]
    }

    /// The lengths of the runs: COCO's uncompressed form.
    pub fn counts(&self) -> &[u32] {
        &self.counts
    }

    /// COCO's compressed form.
    pub fn to_compressed(&self) -> String {
        let mut text = String::new();
        for (index, &count) in self.counts.iter().enumerate() {
            let mut rest = i64::from(count) - if index > 2 { i64::from(self.counts[index - 2]) } else { 0 };
            loop {
                let five = (rest & 0x1f) as u8;
                rest >>= 5;
                // The last character's highest bit is the sign.
                let done = rest == if five & 0x10 != 0 { -1 } else { 0 };
                text.push(char::from(48 + if done { five } else { five | 0x20 }));
                if done {
                    break;
                }
            }
        }
        text
    }

    /// The pixels, in the smallest window that holds them.
    pub fn to_mask(&self) -> Mask {
        let (mut low, mut high) = ([u32::MAX; 2], [0; 2]);
        self.segments(|x, y, length| {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x + 1), high[1].max(y + length)];
        });
        if high[0] == 0 {
            return Mask::default();
        }
        let [width, height] = [high[0] - low[0], high[1] - low[1]];
        let mut inside = vec![false; width as usize * height as usize];
        self.segments(|x, y, length| {
            let start = (y - low[1]) as usize * width as usize + (x - low[0]) as usize;
            inside.iter_mut().skip(start).step_by(width as usize).take(length as usize).for_each(|pixel| *pixel = true);
        });
        Mask { origin: low, width, height, inside }
    }

    /// The moments of the pixels straight from the runs; `None` if there are none.
    pub fn moments(&self, term: PixelTerm) -> Option<Moments> {
        // Runs of columns are runs of rows of the transposed image.
        let mut sums = PixelSums::default();
        self.segments(|x, y, length| sums.add_run(x.into(), y.into(), length.into()));
        sums.transposed().moments([0, 0], term)
    }

    /// Calls `segment(column, first row, length)` for the parts of the inside runs in each column.
    fn segments(&self, mut segment: impl FnMut(u32, u32, u32)) {
        let mut position = 0;
        for (index, &count) in self.counts.iter().enumerate() {
            let end = position + count;
            while index % 2 == 1 && position < end {
                let (x, y) = (position / self.height, position % self.height);
                let length = (end - position).min(self.height - y);
                segment(x, y, length);
                position += length;
            }
            position = end;
        }
    }
}

/// The next number of the compressed form.
fn compressed_number(characters: &mut std::str::CharIndices) -> Result<i64, RleError> {
    let mut number = 0;
    for digit in 0..MAX_NUMBER {
        let (position, found) = characters.next().ok_or(RleError::CutOff)?;
        let value = match u32::from(found) {
            code @ 48..=111 => i64::from(code - 48),
            _ => return Err(RleError::Character { found, position }),
        };
        number |= (value & 0x1f) << (5 * digit);
        if value & 0x20 == 0 {
            let sign = if value & 0x10 != 0 { -1 << (5 * (digit + 1)) } else { 0 };
            return Ok(number | sign);
        }
        if digit == MAX_NUMBER - 1 {
            return Err(RleError::Character { found, position });
        }
    }
    Err(RleError::CutOff)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Cases written by pycocotools (`tests/fixtures/make_rle_fixture.py`).
    const FIXTURE: &str = include_str!("../tests/fixtures/rle.txt");

    #[test]
    fn masks_are_encoded_and_decoded_like_pycocotools() {
        let mut cases = 0;
        for case in FIXTURE.split("case ").skip(1) {
            let mut lines = case.lines();
            let mut next = || lines.next().unwrap_or_default();
            let (name, size) = (next(), next());
            let [height, width] = [0, 1].map(|k| size.split(' ').nth(k).unwrap().parse().unwrap());
            let counts: Vec<u32> = next().split(' ').map(|c| c.parse().unwrap()).collect();
            let compressed = next();
            let picture: Vec<bool> =
                (0..height).flat_map(|_| next().bytes().map(|b| b == b'#').collect::<Vec<_>>()).collect();
            let mask = Mask::new([0, 0], width, height, picture).unwrap();

            let rle = Rle::from_compressed(height, width, compressed).unwrap();
            assert_eq!(rle, Rle::new(height, width, counts).unwrap(), "{name}");
            assert_eq!(rle.to_compressed(), compressed, "{name}");
            assert_eq!(rle.to_mask(), if mask.count() > 0 { mask.trimmed() } else { Mask::default() }, "{name}");
            assert_eq!(Rle::of_mask(&mask, height, width).unwrap(), rle, "{name}");
            cases += 1;
        }
        assert_eq!(cases, 8);
    }

    #[test]
    fn wrong_runs_are_named() {
        let text = |error: Result<Rle, RleError>| error.unwrap_err().to_string();
        assert_eq!(text(Rle::new(3, 4, vec![5, 2])), "the runs cover 7 pixels; the size [3, 4] has 12");
        assert_eq!(text(Rle::new(0, 4, vec![1])), "the runs cover 1 pixels; the size [0, 4] has 0");
        assert!(text(Rle::new(u32::MAX, u32::MAX, vec![])).contains("too large"));
        assert_eq!(
            text(Rle::from_compressed(2, 2, "1 2")),
            "the character ' ' at position 1 is not valid in COCO's compressed runs"
        );
        assert_eq!(Rle::from_compressed(2, 2, "P"), Err(RleError::CutOff));
        assert_eq!(Rle::from_compressed(2, 2, "é"), Err(RleError::Character { found: 'é', position: 0 }));
        assert!(matches!(Rle::from_compressed(2, 2, "oooooooooooo"), Err(RleError::Character { position: 6, .. })));
        assert_eq!(Rle::from_compressed(2, 2, "4O"), Err(RleError::Run { index: 1, length: -1 }));
        assert!(matches!(Rle::from_compressed(2, 2, "oooooo0"), Err(RleError::Run { index: 0, .. })));
        assert!(matches!(Rle::from_compressed(2, 2, ""), Err(RleError::Length { found: 0, .. })));
    }

    #[test]
    fn an_image_without_pixels_is_an_empty_mask() {
        for rle in [Rle::new(0, 0, vec![]).unwrap(), Rle::new(3, 2, vec![6]).unwrap()] {
            assert_eq!((rle.to_mask(), rle.moments(PixelTerm::Squares)), (Mask::default(), None));
        }
    }

    #[test]
    fn pixels_outside_of_the_image_are_left_out() {
        let mask = Mask { origin: [3, 1], width: 4, height: 4, inside: vec![true; 16] };
        let rle = Rle::of_mask(&mask, 3, 5).unwrap();
        assert_eq!(rle.to_mask(), Mask { origin: [3, 1], width: 2, height: 2, inside: vec![true; 4] });
        let outside = Mask { origin: [30, 1], ..mask };
        assert_eq!(Rle::of_mask(&outside, 3, 5).unwrap().counts(), [15]);
    }

    proptest! {
        #[test]
        fn runs_round_trip_and_have_the_moments_of_the_raster(
            bits in proptest::collection::vec(any::<bool>(), 77), left in 0..5u32, top in 0..5u32,
            right in 0..3u32, below in 0..3u32,
        ) {
            let mask = Mask::new([left, top], 11, 7, bits).unwrap();
            let (height, width) = (top + 7 + below, left + 11 + right);
            let rle = Rle::of_mask(&mask, height, width).unwrap();
            prop_assert_eq!(&Rle::new(height, width, rle.counts().to_vec()).unwrap(), &rle);
            prop_assert_eq!(&Rle::from_compressed(height, width, &rle.to_compressed()).unwrap(), &rle);
            prop_assert_eq!(rle.to_mask().pixels().collect::<Vec<_>>(), mask.pixels().collect::<Vec<_>>());
            for term in [PixelTerm::Centers, PixelTerm::Squares] {
                prop_assert_eq!(rle.moments(term), Moments::of_mask(&mask, term));
            }
        }

        #[test]
        fn compressed_runs_of_any_length_round_trip(counts in proptest::collection::vec(0..5_000_000u32, 0..20)) {
            let total: u32 = counts.iter().sum();
            let rle = Rle::new(total, 1, counts).unwrap();
            prop_assert_eq!(Rle::from_compressed(total, 1, &rle.to_compressed()).unwrap(), rle);
        }

        #[test]
        fn no_text_makes_the_decoder_panic(height in 0..40u32, width in 0..40u32, text in "[\\x2f-\\x70]{0,12}") {
            let _ = Rle::from_compressed(height, width, &text).map(|rle| rle.to_mask());
        }
    }
}

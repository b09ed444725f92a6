//! Label Studio's masks of brushes: packed runs of the RGBA values of all pixels of an image, row by row.
//!
//! A header has the number of values (32 bits), the bits of a value (5 bits, less one) and four widths of counts (4 bits
//! each, less one). Then come runs: a bit for "repeated", two bits that select a width, a count less one, and one value,
//! or as many as the count. A pixel belongs to the object where its alpha is not 0. Format: the package `rle-pack` of
//! thi.ng/umbrella.

use super::shapes::{PixelBudget, mask_of_rows};
use crate::scene_file::RleRecord;

/// Values of a pixel: red, green, blue, alpha.
const CHANNELS: u64 = 4;

/// The bits of a text, the highest bit of a byte first.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    /// The number in the next bits, at most 32.
    fn read(&mut self, count: u32) -> Result<u32, String> {
        let mut number = 0;
        for _ in 0..count {
            let byte = self.bytes.get(self.at / 8).ok_or("the packed mask ends in the middle")?;
            number = number << 1 | u32::from(byte >> (7 - self.at % 8) & 1);
            self.at += 1;
        }
        Ok(number)
    }
}

/// The edges of a mask in pixels and its runs; `None` if it is empty. An error, in words, when it is not one of an image
/// of this size.
pub(super) fn mask_of_brush(
    bytes: &[u8],
    size: [f64; 2],
    budget: &mut PixelBudget,
) -> Result<Option<([f64; 4], RleRecord)>, String> {
    let side = |x: f64| (x.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&x)).then_some(x as u32);
    let [Some(width), Some(height)] = size.map(side) else {
        return Err(format!("the image has {} x {} pixels; expected whole numbers", size[0], size[1]));
    };
    let mut bits = Bits { bytes, at: 0 };
    let values = u64::from(bits.read(32)?);
    let pixels = u64::from(width) * u64::from(height);
    if values != pixels.saturating_mul(CHANNELS) {
        return Err(format!("the packed mask has {values} values; {width} x {height} pixels have 4 each"));
    }
    let value_bits = bits.read(5)? + 1;
    let mut widths = [0; 4];
    for width in &mut widths {
        *width = bits.read(4)? + 1;
    }
    let mut alpha = AlphaRuns::default();
    let mut at = 0;
    while at < values {
        let repeated = bits.read(1)? == 1;
        let selected = bits.read(2)? as usize;
        let end = at + u64::from(bits.read(widths[selected])?) + 1;
        if end > values {
            return Err("a run of the packed mask ends after the last pixel".to_owned());
        }
        if repeated {
            let value = bits.read(value_bits)?;
            // The alpha values from `at` to `end`: those whose place is 3, 7, ...
            let count = end / CHANNELS - at / CHANNELS;
            alpha.add(value > 0, count);
        } else {
            for place in at..end {
                let value = bits.read(value_bits)?;
                if place % CHANNELS == CHANNELS - 1 {
                    alpha.add(value > 0, 1);
                }
            }
        }
        at = end;
    }
    let mut runs = alpha.finish();
    let Some(edges) = extent_of_rows(&runs, u64::from(width)) else { return Ok(None) };
    // Only the rows of the object are decoded. The first run is outside of it, and so is the last one of an odd number.
    let [left, top, right, bottom] = edges.map(|edge| edge as u32);
    let is_outside = runs.len() % 2 == 1;
    runs[0] -= top * width;
    if let Some(last) = runs.last_mut().filter(|_| is_outside) {
        *last -= (height - bottom) * width;
    }
    let rle = mask_of_rows(&runs, [0, top, width, bottom - top], [width, height], budget)?;
    Ok(Some(([left, top, right, bottom].map(f64::from), rle)))
}

/// Runs of pixels, alternately outside and inside of the object.
#[derive(Default)]
struct AlphaRuns {
    runs: Vec<u32>,
    inside: bool,
    run: u64,
}

impl AlphaRuns {
    fn add(&mut self, inside: bool, count: u64) {
        if count == 0 {
            return;
        }
        if inside != self.inside {
            self.inside = inside;
            let run = std::mem::replace(&mut self.run, 0);
            // All runs are at most the pixels of an image, a quarter of a number of 32 bits.
            self.runs.push(u32::try_from(run).unwrap_or(u32::MAX));
        }
        self.run += count;
    }

    fn finish(mut self) -> Vec<u32> {
        self.runs.push(u32::try_from(self.run).unwrap_or(u32::MAX));
        self.runs
    }
}

/// The edges of a mask whose runs go along the rows; `None` if it is empty.
fn extent_of_rows(runs: &[u32], width: u64) -> Option<[u64; 4]> {
    let (mut start, mut edges): (u64, Option<[u64; 4]>) = (0, None);
    for (index, &run) in runs.iter().enumerate() {
        let end = start + u64::from(run);
        if index % 2 == 1 && run > 0 {
            let (first, last) = (start / width, (end - 1) / width);
            // A run that goes on in the next row reaches from the left to the right.
            let (left, right) = if first == last { (start % width, (end - 1) % width + 1) } else { (0, width) };
            let [x0, y0, x1, y1] = edges.unwrap_or([left, first, right, last + 1]);
            edges = Some([x0.min(left), y0.min(first), x1.max(right), y1.max(last + 1)]);
        }
        start = end;
    }
    edges
}

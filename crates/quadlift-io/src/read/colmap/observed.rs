//! The points of a COLMAP model that are kept, and the pixels of their tracks in the lists of the images.

use std::collections::BTreeMap;

use super::points::{Point, chosen};
use crate::error::ReadError;
use crate::read::bytes::Bytes;
use crate::text::Line;

/// A point that was observed in an image.
pub(super) struct Observed {
    /// Its number among the points that are kept.
    pub point: u32,
    id: u64,
    /// The place of its pixel in the list of the image.
    place: u32,
}

/// Pixels in the order of the observed points; `None` where the list of the image has other points there.
type Pixels = Option<Box<[[f64; 2]]>>;

/// The points that are kept.
pub(super) struct Chosen {
    pub points: Vec<Point>,
    /// The number of points before some were chosen.
    pub all: usize,
    /// Those that were observed in an image, by its id, each once.
    pub observed: BTreeMap<u32, Vec<Observed>>,
}

impl Chosen {
    pub(super) fn new(points: Vec<Point>, most: usize) -> Self {
        let all = points.len();
        let points = chosen(points, most);
        let mut observed: BTreeMap<u32, Vec<Observed>> = BTreeMap::new();
        for (index, point) in (0u32..).zip(&points) {
            for &(image, place) in &point.track {
                let of_image = observed.entry(image).or_default();
                // A track may have two pixels of one image.
                if of_image.last().is_none_or(|last| last.point != index) {
                    of_image.push(Observed { point: index, id: point.id, place });
                }
            }
        }
        Self { points, all, observed }
    }

    /// The pixels in the line with the points of an image; `None` where no point was observed in it, or the line is empty, as programs
    /// write it that keep no pixels.
    pub(super) fn pixels_of_text(&self, image: u32, line: &Line) -> Result<Option<Pixels>, ReadError> {
        let words: Vec<&str> = line.text.split_whitespace().collect();
        let Some(observed) = self.observed.get(&image).filter(|_| !words.is_empty()) else { return Ok(None) };
        let mut pixels = Vec::with_capacity(observed.len());
        for Observed { id, place, .. } in observed {
            let Some([x, y, found]) = words.chunks_exact(3).nth(*place as usize) else { return Ok(Some(None)) };
            let number = |word: &str| {
                let problem = || line.error(format!("found \"{word}\"; expected a pixel X Y of point {place}"));
                word.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(problem)
            };
            if found.parse::<u64>() != Ok(*id) {
                return Ok(Some(None));
            }
            pixels.push([rounded(number(x)?), rounded(number(y)?)]);
        }
        Ok(Some(Some(pixels.into())))
    }

    /// The same from bytes, which are read up to the end of the image.
    pub(super) fn pixels_of_bytes(&self, image: u32, bytes: &mut Bytes) -> Result<Option<Pixels>, ReadError> {
        let count = bytes.u64("the number of points")?;
        let Some(observed) = self.observed.get(&image).filter(|_| count > 0) else {
            return bytes.skip(count, 24, "points").map(|()| None);
        };
        let mut order: Vec<usize> = (0..observed.len()).collect();
        order.sort_by_key(|k| observed[*k].place);
        let (mut pixels, mut read, mut agrees) = (vec![[0.0; 2]; observed.len()], 0, true);
        for k in order {
            let Observed { id, place, .. } = &observed[k];
            let place = u64::from(*place);
            // Two points may share a place in a damaged model.
            if place < read || place >= count {
                agrees = false;
                continue;
            }
            bytes.skip(place - read, 24, "points")?;
            pixels[k] = bytes.f64s("a pixel x, y")?.map(rounded);
            agrees &= bytes.u64("a point id")? == *id;
            read = place + 1;
        }
        bytes.skip(count - read, 24, "points")?;
        Ok(Some(agrees.then(|| pixels.into())))
    }
}

/// A pixel to two decimals: features are not known better.
fn rounded(x: f64) -> f64 {
    (x * 100.0).round() / 100.0
}

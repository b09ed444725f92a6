//! The unassigned boxes of a frame, and search for the box that a sphere explains best.

use nalgebra::{Matrix2, Vector2};

use super::range_tree::{Part, RangeTree};

use crate::sorting::StableSort;

/// Squared Mahalanobis distance of a box's middle from the predicted one, at most.
pub(crate) const SQUARED_GATE: f64 = 25.0;

/// Fewer boxes than this are searched linearly: a tree does not pay off.
const MIN_INDEXED: usize = 48;

/// The category of removed boxes.
const TAKEN: u32 = u32::MAX;

/// A free box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Free {
    pub center: Vector2<f64>,
    pub log_half: [f64; 2],
    /// Log density of the alternatives for the box.
    pub density: f64,
    pub category: u32,
    pub index: u32,
}

impl Free {
    /// Half the sum and half the difference of the logarithms of its half width and half height.
    fn size_and_aspect(&self) -> [f64; 2] {
        let [w, h] = self.log_half;
        [0.5 * (w + h), 0.5 * (w - h)]
    }
}

/// The free boxes of a frame.
#[derive(Debug, Clone)]
pub(crate) struct FreeBoxes {
    /// By the horizontal places of their middles.
    boxes: Vec<Free>,
    /// Over centers, sizes and aspects, if there are many boxes; with the minimum density of each part.
    tree: RangeTree,
    densities: Vec<f64>,
}

/// The prediction of a box by a sphere, with its uncertainty.
#[derive(Debug)]
pub(crate) struct Expected {
    pub category: u32,
    /// The middle, pixels, and its covariance with its determinant.
    pub place: Vector2<f64>,
    pub spread: Matrix2<f64>,
    pub determinant: f64,
    pub log_half_size: f64,
    /// Variances of the logarithms of size and aspect.
    pub size_variance: f64,
    pub aspect_variance: f64,
    /// Logarithm of the constant of the density.
    pub constant: f64,
}

impl Expected {
    /// Log likelihood ratio of a box; `None` if it is too far away or of another category.
    #[inline]
    fn value(&self, candidate: &Free) -> Option<f64> {
        if candidate.category != self.category {
            return None;
        }
        let (d, spread) = (candidate.center - self.place, &self.spread);
        let distance =
            (spread.m22 * d.x * d.x - 2.0 * spread.m12 * d.x * d.y + spread.m11 * d.y * d.y) / self.determinant;
        if distance > SQUARED_GATE {
            return None;
        }
        let [size, aspect] = candidate.size_and_aspect();
        let size = size - self.log_half_size;
        let square = distance + size * size / self.size_variance + aspect * aspect / self.aspect_variance;
        Some(self.constant - 0.5 * square - candidate.density)
    }

    /// Upper bound of [`Self::value`] for all boxes of a part.
    fn bound(&self, part: &Part, density: f64) -> f64 {
        let expected = [self.place.x, self.place.y, self.log_half_size, 0.0];
        let apart = |k: usize| (part.low[k] - expected[k]).max(expected[k] - part.high[k]).max(0.0);
        let (x, y) = (apart(0), apart(1));
        // The Mahalanobis distance is not less than that of one coordinate alone.
        let distance = (x * x / self.spread.m11).max(y * y / self.spread.m22);
        if distance > SQUARED_GATE * (1.0 + 1e-9) {
            return f64::NEG_INFINITY;
        }
        let square = distance + apart(2).powi(2) / self.size_variance + apart(3).powi(2) / self.aspect_variance;
        self.constant - 0.5 * square - density + 1e-9 * (1.0 + self.constant.abs() + density.abs())
    }
}

impl FreeBoxes {
    /// Of some boxes.
    pub(crate) fn new(mut boxes: Vec<Free>) -> Self {
        boxes.stable_sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
        let tree = if boxes.len() < MIN_INDEXED {
            RangeTree::default()
        } else {
            let point = |b: &Free| {
                let [size, aspect] = b.size_and_aspect();
                [b.center.x, b.center.y, size, aspect]
            };
            RangeTree::new(&boxes.iter().map(point).collect::<Vec<_>>())
        };
        let least_density =
            |part: &Part| tree.points_of(part).iter().map(|&i| boxes[i as usize].density).fold(f64::INFINITY, f64::min);
        let densities = tree.parts.iter().map(least_density).collect();
        Self { boxes, tree, densities }
    }

    /// Takes a box away.
    pub(crate) fn take(&mut self, index: u32) {
        if let Some(item) = self.boxes.iter_mut().find(|item| item.index == index) {
            item.category = TAKEN;
        }
    }

    /// The remaining boxes.
    pub(crate) fn left(&self) -> impl Iterator<Item = &Free> {
        self.boxes.iter().filter(|item| item.category != TAKEN)
    }

    /// The place of the leftmost box of a category whose middle is within a horizontal distance of a place.
    #[inline]
    pub(crate) fn first_near(&self, x: f64, reach: f64, category: u32) -> Option<usize> {
        let first = self.boxes.partition_point(|b| b.center.x < x - reach);
        let near = self.boxes[first..].iter().take_while(|b| b.center.x <= x + reach);
        near.enumerate().find(|(_, b)| b.category == category).map(|(k, _)| first + k)
    }

    /// The box with the maximum log likelihood ratio, the leftmost one of ties, with the ratio; `reach` is its maximum
    /// horizontal distance, `first` the result of [`Self::first_near`].
    #[inline]
    pub(crate) fn best(&self, expected: &Expected, first: usize, reach: f64) -> Option<(u32, f64)> {
        let mut best: Option<(usize, f64)> = None;
        if self.densities.is_empty() {
            let near = self.boxes[first..].iter().take_while(|b| b.center.x <= expected.place.x + reach);
            for (k, candidate) in near.enumerate() {
                if let Some(value) = expected.value(candidate)
                    && best.is_none_or(|(_, b)| value > b)
                {
                    best = Some((first + k, value));
                }
            }
            return best.map(|(place, value)| (self.boxes[place].index, value));
        }
        let bound = |k: usize| expected.bound(&self.tree.parts[k], self.densities[k]);
        let mut least = f64::NEG_INFINITY;
        let mut open = Vec::with_capacity(32);
        open.push((bound(0), 0));
        while let Some((above, k)) = open.pop() {
            if above < least || above == f64::NEG_INFINITY {
                continue;
            }
            if let Some([a, b]) = self.tree.parts[k].halves {
                let (a, b) = ((bound(a), a), (bound(b), b));
                // The more promising half is visited first.
                open.extend(if a.0 > b.0 { [b, a] } else { [a, b] });
                continue;
            }
            for &place in self.tree.points_of(&self.tree.parts[k]) {
                let place = place as usize;
                if let Some(value) = expected.value(&self.boxes[place])
                    && best.is_none_or(|(other, b)| value > b || value == b && place < other)
                {
                    (best, least) = (Some((place, value)), value);
                }
            }
        }
        best.map(|(place, value)| (self.boxes[place].index, value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_tree_finds_what_a_look_at_all_finds(
            raw in prop::collection::vec((0..30i32, 0..30i32, 0..4i32, 0..4i32, 0..3i32), 0..300),
            x in 0.0..30.0f64, y in 0.0..30.0f64, skew in -0.9..0.9f64, taken in 0..300u32,
        ) {
            // Whole numbers: many equal boxes.
            let boxes: Vec<Free> = raw.iter().enumerate().map(|(k, &(a, b, w, h, density))| Free {
                center: Vector2::new(f64::from(a), f64::from(b)),
                log_half: [0.2 * f64::from(w), 0.2 * f64::from(h)],
                density: f64::from(density),
                category: u32::from(k % 5 == 0),
                index: k as u32,
            }).collect();
            let spread = Matrix2::new(4.0, 4.0 * skew, 4.0 * skew, 4.0);
            let expected = Expected {
                category: 0,
                place: Vector2::new(x, y),
                spread,
                determinant: spread.determinant(),
                log_half_size: 0.3,
                size_variance: 0.1,
                aspect_variance: 0.1,
                constant: -3.0,
            };
            let mut free = FreeBoxes::new(boxes.clone());
            free.take(taken);
            let mut all: Vec<&Free> = boxes.iter().filter(|b| b.index != taken).collect();
            all.sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
            let mut best: Option<(u32, f64)> = None;
            for candidate in all {
                if let Some(value) = expected.value(candidate) && best.is_none_or(|(_, b)| value > b) {
                    best = Some((candidate.index, value));
                }
            }
            let reach = (SQUARED_GATE * spread.m11).sqrt();
            let found = free.first_near(x, reach, 0).and_then(|first| free.best(&expected, first, reach));
            prop_assert_eq!(found, best);
        }
    }
}

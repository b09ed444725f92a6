//! A tree of 3D points for range queries.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

use nalgebra::Vector3;

/// Points in a leaf, at most.
const LEAF: usize = 8;

/// A point and its squared distance; ordered by distance, equals by index.
#[derive(PartialEq)]
struct Found {
    squared: f64,
    index: u32,
}

impl Eq for Found {}

impl Ord for Found {
    fn cmp(&self, other: &Self) -> Ordering {
        self.squared.total_cmp(&other.squared).then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for Found {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// A static k-d tree.
#[derive(Debug, Clone)]
pub(crate) struct PointTree {
    points: Vec<Vector3<f64>>,
    /// Indices of the points: the median of a range splits it along the axis in `split_axes` at its place.
    order: Vec<u32>,
    split_axes: Vec<u8>,
}

impl PointTree {
    /// A tree over the points.
    pub(crate) fn new(points: Vec<Vector3<f64>>) -> Self {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut split_axes = vec![0; points.len()];
        let mut ranges = vec![(0, points.len())];
        while let Some((start, end)) = ranges.pop() {
            let range: Range<usize> = start..end;
            if range.len() <= LEAF {
                continue;
            }
            let part = &mut order[range.clone()];
            let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
            for &index in part.iter() {
                low = low.inf(&points[index as usize]);
                high = high.sup(&points[index as usize]);
            }
            let axis = (high - low).imax();
            let middle = part.len() / 2;
            part.select_nth_unstable_by(middle, |&a, &b| {
                points[a as usize][axis].total_cmp(&points[b as usize][axis]).then(a.cmp(&b))
            });
            let middle = range.start + middle;
            split_axes[middle] = axis as u8;
            ranges.push((start, middle));
            ranges.push((middle + 1, end));
        }
        Self { points, order, split_axes }
    }

    /// Indices of the points within `radius` of a place, ascending.
    pub(crate) fn within(&self, place: &Vector3<f64>, radius: f64) -> Vec<u32> {
        let mut found = Vec::new();
        let mut ranges = vec![(0, self.order.len())];
        while let Some((start, end)) = ranges.pop() {
            let range: Range<usize> = start..end;
            if range.len() <= LEAF {
                found.extend(self.order[range].iter().copied().filter(|&i| self.is_within(i, place, radius)));
                continue;
            }
            let middle = range.start + range.len() / 2;
            let index = self.order[middle];
            if self.is_within(index, place, radius) {
                found.push(index);
            }
            let axis = usize::from(self.split_axes[middle]);
            let beyond = place[axis] - self.points[index as usize][axis];
            if beyond <= radius {
                ranges.push((start, middle));
            }
            if beyond >= -radius {
                ranges.push((middle + 1, end));
            }
        }
        found.sort_unstable();
        found
    }

    /// Indices of the `count` nearest points (or all points if there are fewer), nearest first, ties by index.
    pub(crate) fn nearest(&self, place: &Vector3<f64>, count: usize) -> Vec<u32> {
        // The farthest of the best so far is on top.
        let mut best: BinaryHeap<Found> = BinaryHeap::with_capacity(count + 1);
        let offer = |index: u32, best: &mut BinaryHeap<Found>| {
            best.push(Found { squared: (self.points[index as usize] - place).norm_squared(), index });
            if best.len() > count {
                best.pop();
            }
        };
        // Ranges to visit, with the squared distance of their splitting plane.
        let mut ranges = vec![(0.0, 0..self.order.len())];
        while let Some((hidden_by, range)) = ranges.pop() {
            if best.len() == count && best.peek().is_none_or(|worst| hidden_by > worst.squared) {
                continue;
            }
            if range.len() <= LEAF {
                self.order[range].iter().for_each(|&index| offer(index, &mut best));
                continue;
            }
            let middle = range.start + range.len() / 2;
            let index = self.order[middle];
            offer(index, &mut best);
            let axis = usize::from(self.split_axes[middle]);
            let beyond = place[axis] - self.points[index as usize][axis];
            let (low, high) = (range.start..middle, middle + 1..range.end);
            let (near, far) = if beyond <= 0.0 { (low, high) } else { (high, low) };
            ranges.push((beyond * beyond, far));
            ranges.push((0.0, near));
        }
        best.into_sorted_vec().into_iter().map(|found| found.index).collect()
    }

    fn is_within(&self, index: u32, place: &Vector3<f64>, radius: f64) -> bool {
        (self.points[index as usize] - place).norm_squared() <= radius * radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn finds_what_a_look_at_all_finds(
            raw in prop::collection::vec((0..9i32, -9..9i32, 0..3i32), 0..80), x in -10.0..10.0f64, radius in 0.0..12.0f64,
            count in 1..20usize,
        ) {
            // Whole numbers: many equal coordinates and equal points.
            let points: Vec<_> = raw.iter().map(|&(a, b, c)| Vector3::new(f64::from(a), f64::from(b), f64::from(c))).collect();
            let place = Vector3::new(x, 1.0, 0.5);
            let tree = PointTree::new(points.clone());
            let all = 0..points.len() as u32;
            let distance = |i: u32| (points[i as usize] - place).norm_squared();
            let expected: Vec<u32> = all.clone().filter(|&i| distance(i) <= radius * radius).collect();
            prop_assert_eq!(tree.within(&place, radius), expected);
            let mut nearest: Vec<u32> = all.collect();
            nearest.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)).then(a.cmp(&b)));
            nearest.truncate(count);
            prop_assert_eq!(tree.nearest(&place, count), nearest);
        }
    }
}

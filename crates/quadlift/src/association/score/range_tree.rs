//! A tree of 4D points with the range of each node, for branch-and-bound searches.

/// Points in a leaf, at most.
const LEAF: usize = 8;

/// A part of the points.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    /// Its points are those at these places of the order.
    pub start: usize,
    pub end: usize,
    /// Smallest and largest coordinates.
    pub low: [f64; 4],
    pub high: [f64; 4],
    /// Its children, unless it is a leaf.
    pub halves: Option<[usize; 2]>,
}

/// A static k-d tree. Part 0, if there are points, contains all of them.
#[derive(Debug, Clone, Default)]
pub(crate) struct RangeTree {
    /// Indices of the points, part by part.
    pub order: Vec<u32>,
    pub parts: Vec<Part>,
}

impl RangeTree {
    /// A tree over the points.
    pub(crate) fn new(points: &[[f64; 4]]) -> Self {
        let mut tree = Self { order: (0..points.len() as u32).collect(), parts: Vec::new() };
        if !points.is_empty() {
            tree.divide(points, 0, points.len());
        }
        tree
    }

    /// Adds the part of a range of the order and its children; returns its index.
    fn divide(&mut self, points: &[[f64; 4]], start: usize, end: usize) -> usize {
        let indices = &mut self.order[start..end];
        let (mut low, mut high) = ([f64::INFINITY; 4], [f64::NEG_INFINITY; 4]);
        for &index in indices.iter() {
            for (axis, &x) in points[index as usize].iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        let place = self.parts.len();
        self.parts.push(Part { start, end, low, high, halves: None });
        if end - start > LEAF {
            let extent = |axis: &usize| high[*axis] - low[*axis];
            let widest = (0..4).max_by(|a, b| extent(a).total_cmp(&extent(b))).unwrap_or(0);
            let at = |index: &u32| points[*index as usize][widest];
            let middle = (end - start) / 2;
            indices.select_nth_unstable_by(middle, |a, b| at(a).total_cmp(&at(b)).then(a.cmp(b)));
            let halves = [self.divide(points, start, start + middle), self.divide(points, start + middle, end)];
            self.parts[place].halves = Some(halves);
        }
        place
    }

    /// Indices of the points of a part.
    pub(crate) fn points_of(&self, part: &Part) -> &[u32] {
        &self.order[part.start..part.end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_their_points_and_leaves_all_of_them() {
        let points: Vec<[f64; 4]> =
            (0..100).map(|i| std::array::from_fn(|axis| f64::from((i * (axis as i32 * 7 + 3)) % 41))).collect();
        let tree = RangeTree::new(&points);
        let mut in_leaves: Vec<u32> = Vec::new();
        for part in &tree.parts {
            let own = tree.points_of(part);
            for axis in 0..4 {
                let values = own.iter().map(|&i| points[i as usize][axis]);
                assert_eq!(part.low[axis], values.clone().fold(f64::INFINITY, f64::min));
                assert_eq!(part.high[axis], values.fold(f64::NEG_INFINITY, f64::max));
            }
            match part.halves {
                None => in_leaves.extend(own),
                Some([a, b]) => {
                    assert_eq!((tree.parts[a].start, tree.parts[b].end), (part.start, part.end));
                    assert_eq!(tree.parts[a].end, tree.parts[b].start);
                }
            }
        }
        in_leaves.sort_unstable();
        assert!(in_leaves.into_iter().eq(0..100));
        assert!(RangeTree::new(&[]).parts.is_empty());
        // Equal points without number end as well.
        assert_eq!(RangeTree::new(&[[1.0; 4]; 50]).order.len(), 50);
    }
}

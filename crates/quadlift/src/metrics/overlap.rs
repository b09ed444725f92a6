//! Pairing of found and true bodies by overlap.

use super::iou_ellipsoids::iou3d_ellipsoids;
use crate::geometry::Ellipsoid;
use crate::optimize::matching::{Pair, best_pairs};
use crate::sorting::StableSort;

/// A pair of a found and a true body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverlapPair {
    /// Index of the found body.
    pub found: usize,
    /// Index of the true body.
    pub truth: usize,
    /// Their volume IoU (O3D).
    pub iou3d: f64,
}

/// Pairs found with true bodies one to one, with the maximum total volume IoU over pairs that reach `least_iou`; in the
/// order of the found ones. Objects without a body are never paired.
pub fn pair_by_overlap(found: &[Option<Ellipsoid>], truth: &[Option<Ellipsoid>], least_iou: f64) -> Vec<OverlapPair> {
    // Along x, so that only neighbors are compared.
    let mut bodies: Vec<(usize, &Ellipsoid)> =
        truth.iter().enumerate().filter_map(|(column, body)| Some((column, body.as_ref()?))).collect();
    bodies.stable_sort_by(|a, b| a.1.center.x.total_cmp(&b.1.center.x));
    let longest = bodies.iter().map(|(_, body)| body.semi_axes.max()).fold(0.0, f64::max);
    let mut pairs = Vec::new();
    for (row, estimate) in found.iter().enumerate() {
        let Some(estimate) = estimate else { continue };
        let reach = estimate.semi_axes.max() + longest;
        let first = bodies.partition_point(|(_, body)| body.center.x < estimate.center.x - reach);
        for &(column, body) in bodies[first..].iter().take_while(|(_, b)| b.center.x <= estimate.center.x + reach) {
            // Bodies that are farther apart than both their longest semi-axes do not meet.
            if (estimate.center - body.center).norm() < estimate.semi_axes.max() + body.semi_axes.max() {
                let iou = iou3d_ellipsoids(estimate, body);
                if iou >= least_iou {
                    pairs.push(Pair { row: row as u32, column: column as u32, gain: iou });
                }
            }
        }
    }
    let pair = |place: usize| {
        let Pair { row, column, gain } = pairs[place];
        OverlapPair { found: row as usize, truth: column as usize, iou3d: gain }
    };
    best_pairs(&pairs).into_iter().map(pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Rotation3, Vector3};
    use proptest::prelude::*;

    fn ball(x: f64, y: f64, radius: f64) -> Option<Ellipsoid> {
        Some(Ellipsoid {
            center: Point3::new(x, y, 0.0),
            semi_axes: Vector3::repeat(radius),
            rotation: Rotation3::identity(),
        })
    }

    #[test]
    fn the_total_counts_not_the_single_best() {
        // The first overlaps both, the second only the one that the first fits better.
        let truth = [ball(0.0, 0.0, 1.0), ball(1.0, 0.0, 1.0), None];
        let found = [ball(0.4, 0.0, 1.0), ball(-0.6, 0.0, 1.0), None, ball(9.0, 0.0, 1.0)];
        let pairs = pair_by_overlap(&found, &truth, 0.0);
        assert_eq!(pairs.iter().map(|p| (p.found, p.truth)).collect::<Vec<_>>(), [(0, 1), (1, 0)]);
        assert!((pairs[0].iou3d - pairs[1].iou3d).abs() < 1e-9 && pairs[0].iou3d > 0.25);
        // Nothing but the better pair is left when little overlap does not count.
        let strict = pair_by_overlap(&found, &truth, 0.5);
        assert_eq!(strict.iter().map(|p| (p.found, p.truth)).collect::<Vec<_>>(), [(0, 0)]);
    }

    proptest! {
        #[test]
        fn the_order_of_the_truth_does_not_matter(places in prop::collection::vec((0.0..20.0, 0.0..4.0, 0.3..2.0), 1..12)) {
            let truth: Vec<_> = places.iter().map(|&(x, y, r)| ball(x, y, r)).collect();
            let found: Vec<_> = places.iter().map(|&(x, y, r)| ball(x + 0.1, y, 1.1 * r)).collect();
            let reversed: Vec<_> = truth.iter().rev().copied().collect();
            let total = |pairs: &[OverlapPair]| pairs.iter().map(|p| p.iou3d).sum::<f64>();
            let (a, b) = (pair_by_overlap(&found, &truth, 0.0), pair_by_overlap(&found, &reversed, 0.0));
            prop_assert!((total(&a) - total(&b)).abs() < 1e-9);
            // As good as the pairs that were made.
            let made: f64 = (0..truth.len()).map(|k| iou3d_ellipsoids(&found[k].unwrap(), &truth[k].unwrap())).sum();
            prop_assert!(total(&a) >= made - 1e-9);
        }
    }
}

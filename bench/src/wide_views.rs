//! Two or three views of an object from directions that differ much: the paper's minimal configurations.
//!
//! The viewing direction of a view is the ray through the center of its box; no truth is needed.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The wanted angle between two views, degrees.
const TARGET: f64 = 45.0;

/// How far an angle may be from it, degrees.
const TOLERANCE: f64 = 5.0;

/// The selection of views.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Choice {
    /// Views whose directions differ by 45 +- 5 degrees; of three views the first and the second, and the second and
    /// the third, while the first and the third differ by 40 degrees at least. If there are none, the closest ones.
    Around45Degrees,
    /// The two views that differ most; the third is the one that differs most from the nearer one of them.
    Widest,
}

/// Draws up to `draws` different sets of `count` views (2 or 3) from the viewing directions of one object; indices
/// ascend within a set. Empty if there are fewer views.
pub(crate) fn draw_views(
    directions: &[Vector3<f64>],
    count: usize,
    choice: Choice,
    draws: usize,
    seed: u64,
    stream: u64,
) -> Vec<Vec<usize>> {
    let angle = |i: usize, j: usize| directions[i].angle(&directions[j]).to_degrees();
    let off = |i: usize, j: usize| (angle(i, j) - TARGET).abs();
    let n = directions.len();
    let pairs = || (0..n).flat_map(|j| (0..j).map(move |i| (i, j)));
    // Each candidate with its badness: 0 within the tolerance.
    let beyond = |x: f64| if x <= TOLERANCE { 0.0 } else { x };
    let mut candidates: Vec<(f64, Vec<usize>)> = match (choice, count) {
        (Choice::Around45Degrees, 2) => pairs().map(|(i, j)| (beyond(off(i, j)), vec![i, j])).collect(),
        (Choice::Around45Degrees, _) => {
            let chains = pairs().filter(|&(i, k)| angle(i, k) >= TARGET - TOLERANCE);
            let chain = |(i, k): (usize, usize)| {
                let middles = (0..n).filter(move |&j| j != i && j != k);
                middles.map(move |j| (beyond(off(i, j).max(off(j, k))), vec![i, j, k]))
            };
            chains.flat_map(chain).collect()
        }
        (Choice::Widest, 2) => pairs().map(|(i, j)| (-angle(i, j), vec![i, j])).collect(),
        (Choice::Widest, _) => {
            let widest = pairs().max_by(|a, b| angle(a.0, a.1).total_cmp(&angle(b.0, b.1)));
            let with_third = |(i, k): (usize, usize)| {
                let thirds = (0..n).filter(move |&j| j != i && j != k);
                thirds.map(move |j| (-angle(i, j).min(angle(j, k)), vec![i, j, k]))
            };
            widest.into_iter().flat_map(with_third).collect()
        }
    };
    for (_, views) in &mut candidates {
        views.sort_unstable();
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
    candidates.dedup();
    let Some(best) = candidates.first().map(|c| c.0) else { return Vec::new() };
    // All that are within the tolerance, or the best alone.
    let good = candidates.iter().take_while(|c| c.0 <= best).count();
    candidates.truncate(if best == 0.0 { good } else { 1 });
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    let mut drawn = Vec::new();
    while drawn.len() < draws && !candidates.is_empty() {
        drawn.push(candidates.swap_remove(rng.random_range(0..candidates.len())).1);
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions on a level circle, degrees.
    fn directions(degrees: &[f64]) -> Vec<Vector3<f64>> {
        degrees.iter().map(|x| Vector3::new(x.to_radians().cos(), x.to_radians().sin(), 0.0)).collect()
    }

    #[test]
    fn pairs_differ_by_about_45_degrees() {
        let all: Vec<f64> = (0..36).map(|k| 10.0 * f64::from(k)).collect();
        let pairs = draw_views(&directions(&all), 2, Choice::Around45Degrees, 12, 1, 0);
        assert_eq!(pairs.len(), 12);
        for pair in &pairs {
            let apart = (pair[1] - pair[0]).min(36 - (pair[1] - pair[0]));
            assert!(apart == 4 || apart == 5, "{pair:?}");
        }
        let distinct: std::collections::BTreeSet<_> = pairs.iter().collect();
        assert_eq!(distinct.len(), 12);
        assert_eq!(pairs, draw_views(&directions(&all), 2, Choice::Around45Degrees, 12, 1, 0));
        assert_ne!(pairs, draw_views(&directions(&all), 2, Choice::Around45Degrees, 12, 1, 1));
    }

    #[test]
    fn the_nearest_stand_in_where_no_angle_fits() {
        let few = directions(&[0.0, 5.0, 20.0]);
        assert_eq!(draw_views(&few, 2, Choice::Around45Degrees, 12, 1, 0), [vec![0, 2]]);
        assert_eq!(draw_views(&few, 2, Choice::Widest, 12, 1, 0), [vec![0, 2]]);
        assert_eq!(draw_views(&few, 3, Choice::Widest, 12, 1, 0), [vec![0, 1, 2]]);
        assert!(draw_views(&few[..1], 2, Choice::Widest, 12, 1, 0).is_empty());
        assert!(draw_views(&few[..2], 3, Choice::Widest, 12, 1, 0).is_empty());
    }

    #[test]
    fn three_views_are_far_apart() {
        let all: Vec<f64> = (0..10).map(|k| 10.0 * f64::from(k)).collect();
        for views in draw_views(&directions(&all), 3, Choice::Around45Degrees, 100, 1, 0) {
            let steps = [views[1] - views[0], views[2] - views[1]];
            assert!(steps.iter().all(|s| (4..=5).contains(s)), "{views:?}");
        }
    }
}

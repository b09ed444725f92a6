//! The plain method beside which the alignment of maps stands: centers alone, three of each map in RANSAC.

use std::collections::BTreeSet;

use quadlift::align::MapObject;
use quadlift::geometry::Similarity;
use quadlift::nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::point_pairs::similarity_of_points;

/// Draws of three objects of A with one of their categories of B each.
const DRAWS: usize = 2000;

/// Centers agree within this share of the extent of map A.
const NEAR: f64 = 0.02;

/// Objects that must agree with a transform that is given: one more than it is made of.
const FEWEST: usize = 4;

/// The transform with which most centers agree; `None` where fewer than four do. With a known scale it is kept.
pub(super) fn align_by_centers(a: &[MapObject], b: &[MapObject], scale: Option<f64>, seed: u64) -> Option<Similarity> {
    let centers = |map: &[MapObject]| -> Vec<Vector3<f64>> { map.iter().map(|o| o.ellipsoid.center.coords).collect() };
    let (of_a, of_b) = (centers(a), centers(b));
    let like: Vec<Vec<usize>> =
        a.iter().map(|object| (0..b.len()).filter(|&k| b[k].category == object.category).collect()).collect();
    let known: Vec<usize> = (0..a.len()).filter(|&k| !like[k].is_empty()).collect();
    if known.len() < FEWEST || b.len() < FEWEST {
        return None;
    }
    let low = of_a.iter().fold(of_a[0], |low, p| low.inf(p));
    let high = of_a.iter().fold(of_a[0], |high, p| high.sup(p));
    let near = NEAR * (high - low).norm();
    let agreeing = |to: &Similarity| {
        let mut taken = vec![false; b.len()];
        let mut pairs = Vec::new();
        for &i in &known {
            let apart = |j: usize| (to.point(&of_b[j].into()).coords - of_a[i]).norm();
            let nearest = like[i].iter().filter(|&&j| !taken[j]).map(|&j| (apart(j), j));
            if let Some((_, j)) = nearest.min_by(|x, y| x.0.total_cmp(&y.0)).filter(|(apart, _)| *apart < near) {
                taken[j] = true;
                pairs.push((i, j));
            }
        }
        pairs
    };
    let fitted = |pairs: &[(usize, usize)]| {
        let points: Vec<_> = pairs.iter().map(|&(i, j)| (of_a[i], of_b[j])).collect();
        similarity_of_points(&points, scale)
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut best: Vec<(usize, usize)> = Vec::new();
    for _ in 0..DRAWS {
        let drawn: [(usize, usize); 3] = std::array::from_fn(|_| {
            let i = known[rng.random_range(0..known.len())];
            (i, like[i][rng.random_range(0..like[i].len())])
        });
        let distinct = |of: fn(&(usize, usize)) -> usize| drawn.iter().map(of).collect::<BTreeSet<_>>().len() == 3;
        if !distinct(|pair| pair.0) || !distinct(|pair| pair.1) {
            continue;
        }
        let Some(transform) = fitted(&drawn) else { continue };
        let pairs = agreeing(&transform);
        if pairs.len() > best.len() {
            best = pairs;
        }
    }
    if best.len() < FEWEST { None } else { fitted(&best) }
}

//! A simulated detector: boxes of visible objects with typical errors, and false positives.

use quadlift::geometry::BoundingBox;
use quadlift::synthetic::random::normal;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Standard deviation of the edges, in half sizes of the box.
const EDGE_NOISE: f64 = 0.03;
/// Shares of things that are seen but not detected, detected twice, and whose box is quite wrong.
const MISSED: f64 = 0.06;
const TWICE: f64 = 0.03;
const WRONG: f64 = 0.03;
/// Mean number of false positives per frame.
const FALSE_BOXES: f64 = 0.5;

/// A detection.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// The object; `None` for false positives.
    pub(super) thing: Option<usize>,
    /// The thing whose category the detector names.
    pub(super) like: usize,
    pub(super) bounding_box: BoundingBox,
    pub(super) score: f64,
    /// Whether it is an outlier: a false positive, or far off.
    pub(super) is_wrong: bool,
}

/// The detections in a frame of this size. `exact` are the visible objects with their boxes.
pub(super) fn detect(
    exact: &[(usize, BoundingBox)],
    size: [f64; 2],
    things: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<Found> {
    let mut found = Vec::new();
    for &(thing, bounding_box) in exact {
        if rng.random_range(0.0..1.0f64) < MISSED {
            continue;
        }
        let is_wrong = rng.random_range(0.0..1.0f64) < WRONG;
        let noise = if is_wrong { 0.35 } else { EDGE_NOISE };
        let score = rng.random_range(0.55..0.98);
        found.extend(moved(&bounding_box, noise, size, rng).map(|bounding_box| Found {
            thing: Some(thing),
            like: thing,
            bounding_box,
            score,
            is_wrong,
        }));
        if rng.random_range(0.0..1.0f64) < TWICE {
            let score = rng.random_range(0.3..0.5);
            found.extend(moved(&bounding_box, 3.0 * EDGE_NOISE, size, rng).map(|bounding_box| Found {
                thing: Some(thing),
                like: thing,
                bounding_box,
                score,
                is_wrong: false,
            }));
        }
    }
    let false_boxes = (FALSE_BOXES + rng.random_range(0.0..1.0f64)).floor() as usize;
    for _ in 0..false_boxes {
        let [width, height] = size.map(|side| side * rng.random_range(0.05..0.25));
        let (x, y) = (rng.random_range(0.0..size[0] - width), rng.random_range(0.0..size[1] - height));
        let (like, score) = (rng.random_range(0..things), rng.random_range(0.3..0.7));
        let bounding_box = BoundingBox::new([x, y, x + width, y + height]).ok();
        found.extend(bounding_box.map(|bounding_box| Found { thing: None, like, bounding_box, score, is_wrong: true }));
    }
    found
}

/// A box with noise on its edges, within the image; none where the edges cross.
fn moved(exact: &BoundingBox, noise: f64, size: [f64; 2], rng: &mut ChaCha8Rng) -> Option<BoundingBox> {
    let sigma = noise * exact.mean_half_size();
    let edges = exact.edges();
    let mut moved = [0.0; 4];
    for (k, edge) in edges.into_iter().enumerate() {
        let side = size[k % 2];
        // An edge that the image cuts off stays there.
        let is_cut = edge <= 0.0 || edge >= side;
        moved[k] = if is_cut { edge } else { (edge + sigma * normal(rng)).clamp(0.0, side) };
    }
    BoundingBox::new(moved).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::synthetic::random::stream;

    #[test]
    fn errors_are_as_frequent_as_they_should_be() {
        let exact = [(0, BoundingBox::new([100.0, 100.0, 200.0, 180.0]).unwrap())];
        let mut rng = stream(1, 0);
        let all: Vec<Found> = (0..4000).flat_map(|_| detect(&exact, [640.0, 480.0], 3, &mut rng)).collect();
        let share = |is: &dyn Fn(&Found) -> bool| all.iter().filter(|found| is(found)).count() as f64 / 4000.0;
        assert!((share(&|f| f.thing.is_none()) - FALSE_BOXES).abs() < 0.03);
        assert!((share(&|f| f.thing.is_some()) - (1.0 - MISSED) * (1.0 + TWICE)).abs() < 0.02);
        let once: Vec<f64> = all
            .iter()
            .filter(|f| f.thing.is_some() && !f.is_wrong && f.score > 0.5)
            .map(|f| f.bounding_box.edges()[0] - 100.0)
            .collect();
        let sd = (once.iter().map(|x| x * x).sum::<f64>() / once.len() as f64).sqrt();
        assert!((sd / (EDGE_NOISE * exact[0].1.mean_half_size()) - 1.0).abs() < 0.05, "{sd}");
        assert!(all.iter().all(|f| f.bounding_box.edges().iter().all(|x| (0.0..=640.0).contains(x))));
    }
}

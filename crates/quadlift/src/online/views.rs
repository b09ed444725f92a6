//! Views that an object keeps, and which of them to forget.

use nalgebra::{Vector2, Vector3};

use super::keyframes::Keyframes;
use crate::association::input::observations::{BoxObservation, Camera};

/// A detection that an object keeps, or that may still find its object.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct KeptView {
    /// Key of its frame.
    pub keyframe: u64,
    /// Index of the detection in the frame.
    pub detection: u32,
    /// Left, top, right and bottom edge, pixels of the pinhole camera.
    pub edges: [f64; 4],
    /// Where a lens bends the image: the edges in the image itself.
    pub in_image: Option<Box<[f64; 4]>>,
    /// Which edges the border of the image cuts off.
    pub cut: [bool; 4],
    /// Which edges another object hides.
    pub hidden: [bool; 4],
    /// Category, as an index.
    pub category: u32,
    /// Score of the detector; not a number where there is none.
    pub score: f32,
    /// Id that the detection came with.
    pub input_id: Option<u32>,
    /// See [`BoxObservation::log_clutter`].
    pub log_clutter: f64,
    /// See [`BoxObservation::score_log_odds`].
    pub score_log_odds: f64,
}

impl KeptView {
    /// The box as association uses it, less the shift of its frame; `frame` is the place of its camera in a list.
    pub fn observation(&self, frame: usize, shift: &Vector2<f64>) -> BoxObservation {
        let edges = std::array::from_fn(|e| self.edges[e] - shift[e % 2]);
        BoxObservation {
            detection: self.detection as usize,
            id: self.input_id,
            log_clutter: self.log_clutter,
            score_log_odds: self.score_log_odds,
            ..BoxObservation::new(frame, edges, self.cut, self.category as usize)
        }
    }

    /// Number of edges that tell where the object ends.
    fn telling_edges(&self) -> usize {
        (0..4).filter(|&e| !self.cut[e] && !self.hidden[e]).count()
    }
}

/// The place of the view that adds least to the others: of the two whose directions of view and distances are most alike, the one
/// with fewer edges that tell something, else the one that is farther away.
pub(super) fn least_telling(views: &[KeptView], keyframes: &Keyframes, center: &Vector3<f64>) -> usize {
    // Points on rays from the object to the cameras, at the logarithms of the distances.
    let places: Vec<(Vector3<f64>, f64)> = views
        .iter()
        .map(|view| {
            let toward = keyframes.camera(view.keyframe).map_or(Vector3::zeros(), |c: &Camera| c.center - center);
            let distance = toward.norm().max(1e-9);
            (toward / distance, distance.ln())
        })
        .collect();
    let (mut nearest, mut closest) = ((0, 0), f64::INFINITY);
    for a in 0..places.len() {
        for b in a + 1..places.len() {
            let (d, l) = (places[a].0 - places[b].0, places[a].1 - places[b].1);
            // Views that tell little are forgotten for less.
            let worth = views[a].telling_edges().min(views[b].telling_edges()) as f64;
            let apart = (d.norm_squared() + 0.25 * l * l) * (1.0 + worth);
            if apart < closest {
                (nearest, closest) = ((a, b), apart);
            }
        }
    }
    let (a, b) = nearest;
    let rank = |k: usize| (views[k].telling_edges(), std::cmp::Reverse((places[k].1 * 1e6) as i64));
    if rank(a) < rank(b) { a } else { b }
}

//! Views that an object keeps, and which of them to forget.

use nalgebra::{Vector2, Vector3};

use super::kept_shape::MapShape;
use super::keyframes::Keyframes;
use crate::association::input::observations::{BoxObservation, Camera, log_odds_against};
use crate::geometry::BoundingBox;
#[cfg(any(feature = "serde", test))]
use crate::geometry::rotation_defect;
use crate::scene::Cues;

/// A kept detection. A map has dozens per object, so it is small: edges have single precision, 1e-4 px.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct KeptView {
    /// Key of its frame.
    pub keyframe: u32,
    /// Left, top, right and bottom edge, pixels of the pinhole camera.
    pub edges: [f32; 4],
    /// Where a lens bends the image: the edges in the image itself.
    pub in_image: Option<Box<[f32; 4]>>,
    /// The forgotten views that it stands for.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub absorbed: Option<Box<Absorbed>>,
    /// Depth and 3D box, with the sources of the map.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub cues: Option<Box<Cues>>,
    /// Outline or oriented box.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub shape: Option<Box<MapShape>>,
    /// Score of the detector.
    pub score: Option<f32>,
    /// See [`BoxObservation::log_clutter`].
    pub log_clutter: f32,
    /// Index of the detection in the frame.
    pub detection: u16,
    /// Category, as an index.
    pub category: u16,
    /// Which edges the border of the image cuts off, as bits.
    pub cut: u8,
    /// Which edges another object hides, as bits.
    pub hidden: u8,
}

/// Maximum number of visits that are told apart.
pub(super) const MAX_VISITS: usize = 4;

/// The views that a view stands for.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Absorbed {
    /// The mean of the boxes less its own edges, pixels of its camera.
    pub offset: [f32; 4],
    /// The others, by the times at which they were seen; at least one.
    pub visits: Vec<Visit>,
}

impl Absorbed {
    /// Whether all numbers are in their ranges.
    #[cfg(any(feature = "serde", test))]
    pub(super) fn is_valid(&self) -> bool {
        let is_visit = |visit: &Visit| (0.0..=f64::from(u32::MAX)).contains(&visit.mean_key) && visit.views >= 1;
        let are_visits = (1..=MAX_VISITS).contains(&self.visits.len()) && self.visits.iter().all(is_visit);
        are_visits && self.offset.iter().all(|x| x.is_finite())
    }

    /// Number of boxes in the mean, including its own.
    pub(super) fn views(&self) -> u32 {
        self.visits.iter().fold(1, |sum, visit| sum.saturating_add(visit.views))
    }
}

/// Views of frames that follow each other.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Visit {
    /// Mean key of the frames.
    pub mean_key: f64,
    pub views: u32,
}

impl Visit {
    pub(super) fn and(self, other: Self) -> Self {
        let views = self.views.saturating_add(other.views);
        let share = f64::from(other.views) / f64::from(views);
        Self { mean_key: self.mean_key + share * (other.mean_key - self.mean_key), views }
    }
}

/// Four flags as bits.
pub(super) fn to_bits(flags: [bool; 4]) -> u8 {
    (0..4).map(|e| u8::from(flags[e]) << e).sum()
}

/// Bits as four flags.
pub(super) fn from_bits(bits: u8) -> [bool; 4] {
    std::array::from_fn(|e| bits & (1 << e) != 0)
}

/// A kept box; `None` if it is empty.
pub(super) fn bounding_box(edges: &[f32; 4]) -> Option<BoundingBox> {
    BoundingBox::new(edges.map(f64::from)).ok()
}

impl KeptView {
    /// The box, without the lens of its camera.
    pub(super) fn bounding_box(&self) -> Option<BoundingBox> {
        bounding_box(&self.edges)
    }

    /// The box in the image itself.
    pub(super) fn box_in_image(&self) -> Option<BoundingBox> {
        bounding_box(self.in_image.as_deref().unwrap_or(&self.edges))
    }

    /// The box as association uses it, less the shift of its frame; `frame` is the place of its camera in a list.
    pub(super) fn observation(&self, frame: usize, shift: &Vector2<f64>) -> BoxObservation {
        let edges = std::array::from_fn(|e| f64::from(self.edges[e]) - shift[e % 2]);
        BoxObservation {
            detection: usize::from(self.detection),
            log_clutter: f64::from(self.log_clutter),
            score_log_odds: log_odds_against(self.score.map(f64::from)),
            ..BoxObservation::new(frame, edges, from_bits(self.cut), usize::from(self.category))
        }
    }

    /// Number of boxes that it stands for.
    pub(super) fn stands_for(&self) -> u32 {
        self.absorbed.as_ref().map_or(1, |absorbed| absorbed.views())
    }

    /// Edges of a box less the mean errors of the views it stands for.
    pub(super) fn averaged(&self, edges: [f64; 4]) -> [f64; 4] {
        match &self.absorbed {
            Some(absorbed) => std::array::from_fn(|e| edges[e] + f64::from(absorbed.offset[e])),
            None => edges,
        }
    }

    /// The times at which the views that it stands for were seen, but for its own.
    pub(super) fn visits(&self) -> &[Visit] {
        self.absorbed.as_ref().map_or(&[], |absorbed| &absorbed.visits)
    }

    /// Whether what was stored can be used in a map with so many categories and sources of cues.
    #[cfg(any(feature = "serde", test))]
    pub(super) fn is_valid(&self, categories: usize, cue_sources: usize) -> bool {
        let are_valid = |cues: &Cues| {
            let rotation = cues.box3d.and_then(|box3d| box3d.rotation);
            cues.sources().all(|source| (source as usize) < cue_sources)
                // As of poses.
                && rotation.is_none_or(|rotation| rotation_defect(rotation.matrix()) <= 1e-3)
                && cues.check().is_ok()
        };
        usize::from(self.category) < categories
            && self.bounding_box().is_some()
            && self.absorbed.as_ref().is_none_or(|absorbed| absorbed.is_valid())
            && self.shape.as_ref().is_none_or(|shape| shape.is_valid())
            && self.cues.as_deref().is_none_or(are_valid)
    }

    /// Whether this is the detection of another view.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        (self.keyframe, self.detection) == (other.keyframe, other.detection)
    }

    /// Number of edges that are neither cut off nor hidden.
    fn num_visible_edges(&self) -> u32 {
        4 - (self.cut | self.hidden).count_ones()
    }
}

/// Indices of the least informative view and of the one most like it: of the two with the most similar directions and distances,
/// the one with fewer useful edges goes, else the farther one.
pub(super) fn most_redundant_pair(views: &[KeptView], keyframes: &Keyframes, center: &Vector3<f64>) -> (usize, usize) {
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
            // Views with few useful edges are forgotten earlier.
            let worth = views[a].num_visible_edges().min(views[b].num_visible_edges());
            let apart = (d.norm_squared() + 0.25 * l * l) * f64::from(1 + worth);
            if apart < closest {
                (nearest, closest) = ((a, b), apart);
            }
        }
    }
    let (a, b) = nearest;
    let rank = |k: usize| (views[k].num_visible_edges(), std::cmp::Reverse((places[k].1 * 1e6) as i64));
    if rank(a) < rank(b) { (a, b) } else { (b, a) }
}

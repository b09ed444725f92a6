//! Which box edges another detection probably hides (E9, ours).

use super::{Detection, Scene};
use crate::geometry::BoundingBox;

/// An edge counts as inside another box up to this many pixels beyond it.
const REACH_PX: f64 = 5.0;

/// A box reaches lower by more than this many pixels.
const LOWER_PX: f64 = 1.0;

/// In frames with more boxes than this nothing is looked for: every pair is compared, and where so many boxes crowd, all
/// of them overlap.
const MOST_BOXES: usize = 1000;

/// Share of the hidden box's height over which the two must overlap.
const OVERLAP: f64 = 0.3;

impl Scene {
    /// For each detection, which edges of its box (left, top, right, bottom) another detection of its frame probably hides:
    /// what is known of it ([`Detection::hidden_edges`]), or what [`hidden_edges`] says. Detections that `keep`
    /// refuses neither hide nor are hidden.
    pub fn hidden_edges(&self, keep: impl Fn(&Detection) -> bool) -> Vec<[bool; 4]> {
        let place = |d: &Detection| Some((d.frame_index, d.bounding_box?));
        let boxes: Vec<_> = self.detections.iter().map(|d| if keep(d) { place(d) } else { None }).collect();
        let mut hidden = hidden_edges(&boxes);
        for ((hidden, detection), place) in hidden.iter_mut().zip(&self.detections).zip(&boxes) {
            if let (Some(known), Some(_)) = (detection.hidden_edges, place) {
                *hidden = known;
            }
        }
        hidden
    }
}

/// For each box with its frame, which of its edges (left, top, right, bottom) lie inside another box of the frame that
/// reaches lower in the image, and is therefore nearer where things stand on the ground. Only left and right edges are
/// found; what is no box neither hides nor is hidden.
pub fn hidden_edges<F: Ord>(boxes: &[Option<(F, BoundingBox)>]) -> Vec<[bool; 4]> {
    let mut hidden = vec![[false; 4]; boxes.len()];
    let mut places: Vec<(usize, &F, &BoundingBox)> = Vec::with_capacity(boxes.len());
    places.extend(boxes.iter().enumerate().filter_map(|(k, place)| place.as_ref().map(|(frame, b)| (k, frame, b))));
    places.sort_by_key(|(_, frame, _)| *frame);
    for of_frame in places.chunk_by_mut(|a, b| a.1 == b.1).filter(|of_frame| of_frame.len() <= MOST_BOXES) {
        // From the lowest to the highest bottom edge in space, so that a box is hidden by earlier ones only.
        of_frame.sort_by(|(.., a), (.., b)| b.y1.total_cmp(&a.y1));
        for (k, (index, _, far)) in of_frame.iter().enumerate() {
            for (.., near) in &of_frame[..k] {
                let overlap = far.y1.min(near.y1) - far.y0.max(near.y0);
                if near.y1 <= far.y1 + LOWER_PX || overlap < OVERLAP * (far.y1 - far.y0) {
                    continue;
                }
                for (edge, x) in [(0, far.x0), (2, far.x1)] {
                    hidden[*index][edge] |= near.x0 - REACH_PX < x && x < near.x1 + REACH_PX;
                }
            }
        }
    }
    hidden
}

#[cfg(test)]
mod tests {
    use super::super::{DetectionInput, SceneBuilder};
    use super::*;
    use crate::geometry::Projection;

    #[test]
    fn the_farther_box_loses_the_edge_behind_the_nearer_one() {
        let mut builder = SceneBuilder::new("test");
        let projection = Projection::from_matrix(nalgebra::Matrix3x4::identity()).unwrap();
        for frame in ["a", "b"] {
            builder.add_frame(frame, projection, None).unwrap();
        }
        let mut add = |frame, edges| {
            let bounding_box = BoundingBox::new(edges).ok();
            builder.add_detection(&DetectionInput { frame, bounding_box, ..Default::default() }).unwrap();
        };
        add("a", [100.0, 50.0, 200.0, 100.0]); // far
        add("a", [180.0, 40.0, 300.0, 150.0]); // near, over the right edge of the first
        add("a", [190.0, 10.0, 260.0, 52.0]); // high above: overlaps the near one, a third of its height
        add("b", [100.0, 50.0, 200.0, 100.0]); // alone in its frame
        let mut scene = builder.build();
        let hidden = scene.hidden_edges(|_| true);
        assert_eq!(hidden[0], [false, false, true, false]);
        assert_eq!(hidden[1], [false; 4]);
        assert_eq!(hidden[2], [false; 4], "less than 30 % of its height lies beside the near box");
        assert_eq!(hidden[3], [false; 4]);
        assert_eq!(scene.hidden_edges(|_| false), vec![[false; 4]; 4]);
        scene.detections[0].hidden_edges = Some([true, false, false, false]);
        assert_eq!(scene.hidden_edges(|_| true)[0], [true, false, false, false], "what is known counts");
    }
}

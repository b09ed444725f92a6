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
    /// what is known of it ([`Detection::hidden_edges`]), or what [`edges_hidden_in_frame`] says. Detections that `keep`
    /// refuses neither hide nor are hidden.
    pub fn hidden_edges(&self, keep: impl Fn(&Detection) -> bool) -> Vec<[bool; 4]> {
        let mut by_frame: Vec<Vec<usize>> = vec![Vec::new(); self.frames.len()];
        for (index, detection) in self.detections.iter().enumerate().filter(|(_, d)| keep(d)) {
            if detection.bounding_box.is_some() {
                by_frame[detection.frame_index as usize].push(index);
            }
        }
        let mut hidden = vec![[false; 4]; self.detections.len()];
        for indices in by_frame {
            let boxes: Vec<BoundingBox> = indices.iter().filter_map(|&i| self.detections[i].bounding_box).collect();
            for (index, found) in indices.into_iter().zip(edges_hidden_in_frame(&boxes)) {
                hidden[index] = self.detections[index].hidden_edges.unwrap_or(found);
            }
        }
        hidden
    }
}

/// For each box of a frame, which of its edges (left, top, right, bottom) lie inside another one that reaches lower in the
/// image, and is therefore nearer where things stand on the ground. Only left and right edges are found.
pub fn edges_hidden_in_frame(boxes: &[BoundingBox]) -> Vec<[bool; 4]> {
    let mut hidden = vec![[false; 4]; boxes.len()];
    if boxes.len() > MOST_BOXES {
        return hidden;
    }
    // From the lowest to the highest bottom edge in space, so that a box is hidden by earlier ones only.
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|&a, &b| boxes[b].y1.total_cmp(&boxes[a].y1));
    for (k, &index) in order.iter().enumerate() {
        let far = &boxes[index];
        for near in order[..k].iter().map(|&index| &boxes[index]) {
            let overlap = far.y1.min(near.y1) - far.y0.max(near.y0);
            if near.y1 <= far.y1 + LOWER_PX || overlap < OVERLAP * (far.y1 - far.y0) {
                continue;
            }
            for (edge, x) in [(0, far.x0), (2, far.x1)] {
                hidden[index][edge] |= near.x0 - REACH_PX < x && x < near.x1 + REACH_PX;
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

//! Which box edges another detection probably hides (E9, ours).

use super::{Detection, Scene};
use crate::geometry::BoundingBox;

/// An edge counts as inside another box up to this many pixels beyond it.
const REACH_PX: f64 = 5.0;

/// In frames with more boxes than this nothing is looked for: every pair is compared, and where so many boxes crowd, all
/// of them overlap.
const MOST_BOXES: usize = 1000;

/// Share of the length of an edge over which the two boxes must overlap for it to be hidden.
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

/// For each box with its frame, which of its edges (left, top, right, bottom) another box of the frame probably hides.
///
/// The larger of two boxes that overlap is taken for the nearer one: things of one kind look larger when they are near,
/// and which way up the image is does not matter. It hides those edges of the other box that lie in it, on the sides on
/// which the boxes overlap less; none of a box that lies in it as a whole, which would not have been detected behind it.
/// What is no box neither hides nor is hidden.
pub fn hidden_edges<F: Ord>(boxes: &[Option<(F, BoundingBox)>]) -> Vec<[bool; 4]> {
    let mut hidden = vec![[false; 4]; boxes.len()];
    let mut places: Vec<(usize, &F, &BoundingBox)> = Vec::with_capacity(boxes.len());
    places.extend(boxes.iter().enumerate().filter_map(|(k, place)| place.as_ref().map(|(frame, b)| (k, frame, b))));
    places.sort_by_key(|(_, frame, _)| *frame);
    for of_frame in places.chunk_by_mut(|a, b| a.1 == b.1).filter(|of_frame| of_frame.len() <= MOST_BOXES) {
        // From the largest to the smallest in space, so that a box is hidden by earlier ones only.
        of_frame.sort_by(|(.., a), (.., b)| area(b).total_cmp(&area(a)));
        for (k, (index, _, far)) in of_frame.iter().enumerate() {
            for (.., near) in &of_frame[..k] {
                let by_this = hidden_by(far, near);
                (0..4).for_each(|edge| hidden[*index][edge] |= by_this[edge]);
            }
        }
    }
    hidden
}

fn area(b: &BoundingBox) -> f64 {
    b.size().product()
}

/// Which edges of a box a larger one hides.
fn hidden_by(far: &BoundingBox, near: &BoundingBox) -> [bool; 4] {
    let (own, other) = (far.edges(), near.edges());
    let is_within = (0..2).all(|k| other[k] <= own[k] && other[k + 2] >= own[k + 2]);
    if is_within || area(near) <= area(far) {
        return [false; 4];
    }
    // Share of the box that the other one covers in x and in y.
    let overlap = [0, 1].map(|k| (own[k + 2].min(other[k + 2]) - own[k].max(other[k])) / (own[k + 2] - own[k]));
    std::array::from_fn(|edge| {
        let (across, along) = (edge % 2, 1 - edge % 2);
        let lies_in = other[across] - REACH_PX < own[edge] && own[edge] < other[across + 2] + REACH_PX;
        lies_in && overlap[along] >= OVERLAP && overlap[across] <= overlap[along]
    })
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
        add("a", [190.0, 10.0, 260.0, 52.0]); // above: its lower edge lies in the near one
        add("a", [285.0, 140.0, 400.0, 160.0]); // beside: a tenth of its width and half of its height
        add("a", [220.0, 80.0, 250.0, 120.0]); // within the near one, so before it
        add("b", [100.0, 50.0, 200.0, 100.0]); // alone in its frame
        let mut scene = builder.build();
        let hidden = scene.hidden_edges(|_| true);
        assert_eq!(hidden[0], [false, false, true, false]);
        assert_eq!(hidden[1], [false; 4]);
        assert_eq!(hidden[2], [false, false, false, true]);
        assert_eq!(hidden[3], [true, false, false, false]);
        assert_eq!(hidden[4..], [[false; 4]; 2]);
        assert_eq!(scene.hidden_edges(|_| false), vec![[false; 4]; 6]);
        scene.detections[0].hidden_edges = Some([true, false, false, false]);
        assert_eq!(scene.hidden_edges(|_| true)[0], [true, false, false, false], "what is known counts");
    }

    #[test]
    fn which_way_up_the_image_is_does_not_matter() {
        let mut state = 1u32;
        let mut draw = |to: u32| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from((state >> 8) % to)
        };
        let upright: Vec<BoundingBox> = (0..200)
            .map(|_| {
                let (x, y) = (draw(800), draw(600));
                BoundingBox::new([x, y, x + 20.0 + draw(200), y + 20.0 + draw(150)]).unwrap()
            })
            .collect();
        // A quarter turn: x' = 1000 - y, y' = x.
        let turned = upright.iter().map(|b| BoundingBox::new([1000.0 - b.y1, b.x0, 1000.0 - b.y0, b.x1]).unwrap());
        let of_upright = hidden_edges(&upright.iter().map(|b| Some((0, *b))).collect::<Vec<_>>());
        let of_turned = hidden_edges(&turned.map(|b| Some((0, b))).collect::<Vec<_>>());
        assert!(of_upright.iter().flatten().filter(|h| **h).count() > 50);
        for ([left, top, right, bottom], turned) in of_upright.iter().zip(of_turned) {
            assert_eq!(turned, [*bottom, *left, *top, *right]);
        }
    }
}

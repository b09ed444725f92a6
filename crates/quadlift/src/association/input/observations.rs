//! The boxes to associate, sorted by frame, with precomputed values.

pub(crate) use super::box_observation::{BoxObservation, Camera, log_odds_against};
use super::clutter::{BoxSizes, set_clutter};
use crate::tuning::WRONG_CATEGORY_SHARE;
use nalgebra::{Vector2, Vector3};

use crate::optimize::median::quantile;
use crate::scene::{BORDER_TOLERANCE_PX, Scene, edges_at_border};
use crate::sorting::StableSort;

/// The smallest predicted size that a detector is expected to find, relative to the 2 % quantile of the sizes.
pub(crate) const MIN_SIZE: f64 = 0.7;

/// All boxes and cameras.
#[derive(Debug, Clone)]
pub(crate) struct Observations {
    /// The frames of the scene.
    pub cameras: Vec<Camera>,
    /// The boxes by frame, in a frame by their left edges.
    pub boxes: Vec<BoxObservation>,
    /// Index into [`crate::scene::SceneParts::categories`] for each category.
    pub categories: Vec<Option<u32>>,
    /// Predicted boxes of a smaller half size are not expected to be detected.
    pub least_half_size: f64,
    /// The offset that was subtracted from world coordinates.
    pub origin: Vector3<f64>,
    /// How large the boxes are.
    pub sizes: BoxSizes,
    /// Share of the boxes in each category.
    pub category_share: Vec<f64>,
}

impl Observations {
    /// Prepares the given detections (indices into the scene); those with only an ellipse are represented by the box
    /// around it. Detections in frames whose camera has no finite center are skipped.
    pub(crate) fn new(scene: &Scene, detections: &[usize]) -> Self {
        let centers: Vec<_> = scene.frames.iter().map(|f| f.projection.center_in_world().map(|c| c.coords)).collect();
        let count = centers.iter().flatten().count().max(1) as f64;
        let origin = centers.iter().flatten().fold(Vector3::zeros(), |sum, c| sum + c / count);
        let mut categories: Vec<Option<u32>> = Vec::new();
        let mut boxes: Vec<BoxObservation> = Vec::with_capacity(detections.len());
        let mut extent = Vector2::new(1.0, 1.0);
        for &index in detections {
            let detection = &scene.detections[index];
            let frame = detection.frame_index as usize;
            let Some(measured) = detection.measured_box().filter(|_| centers[frame].is_some()) else { continue };
            let category = match categories.iter().position(|&c| c == detection.category_index) {
                Some(known) => known,
                None => {
                    categories.push(detection.category_index);
                    categories.len() - 1
                }
            };
            let size = scene.frames[frame].image_size;
            if size.is_none() {
                extent = extent.sup(&Vector2::new(measured.x1, measured.y1));
            }
            let cut = edges_at_border(&measured, size, BORDER_TOLERANCE_PX);
            boxes.push(BoxObservation {
                detection: index,
                id: detection.object_index,
                score_log_odds: log_odds_against(detection.score),
                ..BoxObservation::new(frame, measured.edges(), cut, category)
            });
        }
        boxes.stable_sort_by(|a, b| {
            a.frame.cmp(&b.frame).then(a.edges[0].total_cmp(&b.edges[0])).then(a.detection.cmp(&b.detection))
        });
        let mut cameras = Vec::with_capacity(scene.frames.len());
        let mut next = 0;
        for (index, frame) in scene.frames.iter().enumerate() {
            let first = next;
            while next < boxes.len() && boxes[next].frame == index {
                next += 1;
            }
            let size = frame.image_size.unwrap_or(extent);
            let camera = Camera::new(&frame.projection, &centers[index].unwrap_or(origin), &origin, size);
            cameras.push(Camera { boxes: first..next, ..camera });
        }
        let mut half_sizes: Vec<f64> = boxes.iter().map(|b| b.half_size).collect();
        let mut category_share = vec![1e-9; categories.len()];
        for observation in &boxes {
            category_share[observation.category] += 1.0 / boxes.len() as f64;
        }
        let least_half_size = MIN_SIZE * quantile(&mut half_sizes, 0.02).unwrap_or(0.0);
        let sizes = BoxSizes::of(&boxes);
        let mut observations = Self { cameras, boxes, categories, least_half_size, origin, sizes, category_share };
        for frame in 0..observations.cameras.len() {
            observations.move_boxes(frame, &Vector2::zeros());
            let camera = &observations.cameras[frame];
            set_clutter(&mut observations.boxes[camera.boxes.clone()], camera, &sizes);
        }
        observations
    }

    /// Moves the boxes of a frame by some pixels.
    pub(crate) fn move_boxes(&mut self, frame: usize, by: &Vector2<f64>) {
        let camera = &self.cameras[frame];
        let inverse = camera.matrix.fixed_columns::<3>(0).try_inverse().unwrap_or_default();
        for observation in &mut self.boxes[camera.boxes.clone()] {
            for (edge, value) in observation.edges.iter_mut().enumerate() {
                *value += by[edge % 2];
            }
            observation.relocalize(&inverse, camera.focal);
        }
    }

    /// Log odds of a box's category, between being of an object of the category and being clutter.
    pub(crate) fn category_log_odds(&self, object: usize, detected: usize) -> f64 {
        let others = self.categories.len().saturating_sub(1);
        if others == 0 {
            0.0
        } else if object == detected {
            ((1.0 - WRONG_CATEGORY_SHARE.get()) / self.category_share[detected]).ln()
        } else {
            (WRONG_CATEGORY_SHARE.get() / others as f64 / self.category_share[detected]).ln()
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3x4;

    use super::*;
    use crate::geometry::{BoundingBox, Projection};
    use crate::scene::{NewDetection, SceneBuilder};

    #[test]
    fn each_side_of_the_border_cuts_off_its_own_edge() {
        let inside = [50.0, 60.0, 600.0, 400.0];
        let at_the_border = [1.5, 1.5, 638.5, 478.5];
        let cut = |edges: [f64; 4], size: Option<[f64; 2]>| {
            let mut builder = SceneBuilder::new("one box");
            let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
            builder.add_frame("a", projection, size).unwrap();
            let bounding_box = BoundingBox::new(edges).ok();
            builder.add_detection(&NewDetection { frame: "a", bounding_box, ..Default::default() }).unwrap();
            Observations::new(&builder.build(), &[0]).boxes[0].cut
        };
        assert_eq!(cut(inside, Some([640.0, 480.0])), [false; 4]);
        for edge in 0..4 {
            let mut edges = inside;
            edges[edge] = at_the_border[edge];
            assert_eq!(cut(edges, Some([640.0, 480.0])), std::array::from_fn(|k| k == edge), "{edges:?}");
        }
        assert_eq!(cut(at_the_border, None), [false; 4]);
    }
}

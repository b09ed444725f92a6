//! Visibility of objects in the images of a scene.

use std::collections::HashSet;

use quadlift::geometry::{BoundingBox, project_bounding_box};
use quadlift::scene::Frame;

use super::{CheckedScene, Object};

/// An object in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenObject {
    pub frame_index: usize,
    /// Index into the objects with bodies.
    pub object_index: usize,
    /// The box around its outline in the image as it is, cut off at the border of the image where its size is known.
    pub bounding_box: BoundingBox,
}

impl CheckedScene<'_> {
    /// The objects that are entirely in front of a camera and at least partly in its image, by frame. With
    /// `only_detected`, only those with a detection or a residual of the estimate.
    pub(super) fn seen_objects(&self, only_detected: bool) -> Vec<SeenObject> {
        let detected = if only_detected { self.detected() } else { HashSet::new() };
        let mut seen = Vec::new();
        for (frame_index, frame) in self.scene.frames.iter().enumerate() {
            for (object_index, object) in self.objects.iter().enumerate() {
                if only_detected && !detected.contains(&(frame.id.as_str(), object.id.as_str())) {
                    continue;
                }
                let whole = project_bounding_box(&frame.projection, &object.body).ok();
                if let Some(bounding_box) = whole.and_then(|whole| in_image(frame, &whole)) {
                    seen.push(SeenObject { frame_index, object_index, bounding_box });
                }
            }
        }
        seen
    }

    /// Ids of the objects that are entirely in front of a camera and at least partly in its image.
    pub fn objects_in_view(&self, frame: &Frame) -> Vec<&str> {
        let is_in_view = |object: &&Object| {
            let whole = project_bounding_box(&frame.projection, &object.body).ok();
            whole.and_then(|whole| in_image(frame, &whole)).is_some()
        };
        self.objects.iter().filter(is_in_view).map(|object| object.id.as_str()).collect()
    }

    /// Ids of frames and objects that are detected in them.
    fn detected(&self) -> HashSet<(&str, &str)> {
        let measured = self.file.detections.iter().filter_map(|d| Some((&*d.frame, d.object.as_deref()?)));
        let used =
            self.file.objects.iter().flat_map(|object| {
                object.view_residuals_px.iter().map(|view| (view.frame.as_str(), object.id.as_str()))
            });
        measured.chain(used).collect()
    }
}

/// The part of a box, in pixels of the pinhole camera, that is in the image.
fn in_image(frame: &Frame, pinhole_box: &BoundingBox) -> Option<BoundingBox> {
    let bounding_box = match &frame.lens {
        Some(lens) => lens.distort_box(pinhole_box)?,
        None => *pinhole_box,
    };
    let Some(size) = frame.image_size else { return Some(bounding_box) };
    let [x0, y0, x1, y1] = bounding_box.edges();
    BoundingBox::new([x0.max(0.0), y0.max(0.0), x1.min(size.x), y1.min(size.y)]).ok()
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;
    use crate::scene_file::SceneFile;

    fn seen(file: &SceneFile, only_detected: bool) -> Vec<SeenObject> {
        CheckedScene::new(file, BodyChoice::Body).unwrap().seen_objects(only_detected)
    }

    #[test]
    fn boxes_end_at_the_border_and_hidden_objects_are_left_out() {
        let mut file = test_scene::three_bodies();
        assert_eq!(seen(&file, false).len(), 6);
        // To the left of the first image, across its border, and behind the camera.
        for (center, count, x0) in [([-9.0, 0.0, 0.0], 5, 0.0), ([-6.4, 0.0, 0.0], 6, 0.0), ([0.0, -20.0, 0.0], 5, 0.0)]
        {
            let body = file.objects[0].ellipsoid.as_mut().unwrap();
            body.center = center;
            file.objects[0].center = None;
            let seen = seen(&file, false);
            let first = seen.iter().find(|s| (s.frame_index, s.object_index) == (0, 0));
            assert_eq!(seen.iter().filter(|s| s.frame_index == 0).count(), count - 3, "{center:?}");
            assert_eq!(first.map(|s| s.bounding_box.x0()), (count == 6).then_some(x0), "{center:?}");
        }
    }

    #[test]
    fn objects_in_view_are_those_of_the_image() {
        let mut file = test_scene::three_bodies();
        file.objects[0].ellipsoid.as_mut().unwrap().center = [-9.0, 0.0, 0.0];
        file.objects[0].center = None;
        let scene = CheckedScene::new(&file, BodyChoice::Body).unwrap();
        let of_frame = |k: usize| scene.objects_in_view(&scene.scene.frames[k]);
        let expected = |k: usize| -> Vec<&str> {
            let seen = scene.seen_objects(false).into_iter().filter(|s| s.frame_index == k);
            seen.map(|s| scene.objects[s.object_index].id.as_str()).collect()
        };
        assert_eq!((of_frame(0), of_frame(1)), (expected(0), expected(1)));
        assert_eq!(of_frame(0).len(), 2);
    }

    #[test]
    fn lenses_bend_boxes() {
        let mut file = test_scene::three_bodies();
        let straight = seen(&file, false)[0].bounding_box;
        file.cameras[0].model = "SIMPLE_RADIAL".into();
        file.cameras[0].params = vec![500.0, 320.0, 240.0, -0.5];
        let bent = seen(&file, false)[0].bounding_box;
        // The right edge is at x = 1.5 of about 10.5: the lens moves it towards the middle by 0.5 r^2 of its distance.
        let r = (straight.x1() - 320.0) / 500.0;
        assert!((bent.x1() - (320.0 + 500.0 * r * (1.0 - 0.5 * r * r))).abs() < 0.5, "{straight:?} {bent:?}");
    }

    #[test]
    fn detected_objects_are_those_of_detections_and_of_residuals() {
        let file = test_scene::three_bodies();
        let found: Vec<_> = seen(&file, true).iter().map(|s| (s.frame_index, s.object_index)).collect();
        assert_eq!(found, [(0, 0), (1, 0), (1, 1)]);
    }
}

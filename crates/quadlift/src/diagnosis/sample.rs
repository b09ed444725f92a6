//! The checked sample: some objects with their boxes and cameras.

use nalgebra::Vector2;

use super::camera::CameraParts;
use crate::geometry::BoundingBox;
use crate::scene::{Detection, Scene};

/// Maximum number of boxes: enough for the check, and few enough to be fast.
const MAX_BOXES: usize = 300;

/// Distance from the image border, in pixels, within which a box counts as cut off: its center is not the object's.
const BORDER_PX: f64 = 2.0;

/// A frame of the sample.
#[derive(Debug, Clone)]
pub(crate) struct SampleFrame {
    /// `None` if the projection has no finite center.
    pub camera: Option<CameraParts>,
    pub image_size: Option<Vector2<f64>>,
}

/// A box of an object.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    /// Index of the frame.
    pub frame: u32,
    pub bounding_box: BoundingBox,
}

/// Objects with their boxes in wholly visible views, and all frames.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sample<'a> {
    pub frames: Vec<SampleFrame>,
    pub frame_ids: Vec<&'a str>,
    pub objects: Vec<Vec<Seen>>,
    /// Which objects of the scene they are.
    pub object_indices: Vec<usize>,
}

impl<'a> Sample<'a> {
    /// Samples objects and views evenly.
    pub(crate) fn new(scene: &'a Scene, is_used: impl Fn(&Detection) -> bool) -> Self {
        Self::with_at_most(scene, is_used, MAX_BOXES)
    }

    /// A sample of another size.
    pub(crate) fn with_at_most(scene: &'a Scene, is_used: impl Fn(&Detection) -> bool, boxes: usize) -> Self {
        let count = |only_whole: bool| {
            let used = scene.detections.iter().filter(|d| d.object_index.is_some() && is_used(d));
            used.filter(|d| measured_box(scene, d, only_whole).is_some()).count()
        };
        // If the border seems to cut nearly all boxes, they are not in pixels.
        let only_whole = 10 * count(true) >= count(false);
        let box_of = |d: &Detection| measured_box(scene, d, only_whole);
        let groups = scene.detections_by_object(|d| is_used(d) && box_of(d).is_some());
        let groups: Vec<(usize, &Vec<u32>)> = groups.iter().enumerate().filter(|(_, group)| group.len() >= 2).collect();
        // Objects with two views carry little information: they are used only if there are no others.
        let has_three = groups.iter().any(|(_, group)| group.len() >= 3);
        let groups: Vec<(usize, &Vec<u32>)> =
            groups.into_iter().filter(|(_, group)| !has_three || group.len() >= 3).collect();
        let total: usize = groups.iter().map(|(_, group)| group.len()).sum();
        // Of large scenes a part of the objects and a part of their views, so that both are spread evenly.
        let share = (total as f64 / boxes as f64).max(1.0);
        let object_stride = share.sqrt().ceil().min((groups.len() as f64 / 5.0).max(1.0)).floor() as usize;
        let per_object = boxes / groups.len().div_ceil(object_stride).max(1);
        let chosen = || groups.iter().step_by(object_stride.max(1));
        let objects = chosen().map(|(_, group)| {
            let view_stride = group.len().div_ceil(per_object.max(3));
            let views = group.iter().step_by(view_stride.max(1)).filter_map(|&index| {
                let detection = &scene.detections[index as usize];
                Some(Seen { frame: detection.frame_index, bounding_box: box_of(detection)? })
            });
            views.collect::<Vec<Seen>>()
        });
        Self {
            objects: objects.collect(),
            object_indices: chosen().map(|(object, _)| *object).collect(),
            frames: scene
                .frames
                .iter()
                .map(|frame| SampleFrame {
                    camera: CameraParts::from_projection(&frame.projection),
                    image_size: frame.image_size,
                })
                .collect(),
            frame_ids: scene.frames.iter().map(|frame| frame.id.as_str()).collect(),
        }
    }

    /// Number of boxes.
    pub(crate) fn boxes(&self) -> usize {
        self.objects.iter().map(Vec::len).sum()
    }
}

/// The boxes that no object took.
pub(crate) fn loose_boxes(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Vec<Seen> {
    let loose = scene.detections.iter().filter(|d| d.object_index.is_none() && is_used(d));
    let seen = loose.filter_map(|d| Some(Seen { frame: d.frame_index, bounding_box: measured_box(scene, d, true)? }));
    seen.take(MAX_BOXES).collect()
}

/// The box of a detection, or the one around its ellipse; with `only_whole` only if the image border does not cut it.
fn measured_box(scene: &Scene, detection: &Detection, only_whole: bool) -> Option<BoundingBox> {
    let measured = detection.measured_box()?;
    let b = detection.box_in_image.unwrap_or(measured);
    let cut = scene.frames[detection.frame_index as usize].image_size.is_some_and(|size| {
        let at = |edge: f64, border: f64| (edge - border).abs() <= BORDER_PX;
        at(b.x0, 0.0) || at(b.y0, 0.0) || at(b.x1, size.x) || at(b.y1, size.y)
    });
    (!(only_whole && cut)).then_some(measured)
}

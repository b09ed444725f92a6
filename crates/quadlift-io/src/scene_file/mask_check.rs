//! Masks compared with their boxes: a mask that lies elsewhere is of another object or image, or was read in another order.

use quadlift::geometry::BoundingBox;
use quadlift::scene::Scene;
use quadlift_segment::Mask;

use super::images::SceneImages;

/// Smallest share of a mask's extent that lies in its box; a part of the object may be hidden, but nothing lies beyond.
const INSIDE: f64 = 0.5;

/// The overlap of a mask's extent with the box of another detection that shows whose mask it is.
const IS_OF_OTHER: f64 = 0.7;

/// With more masks elsewhere than this share of them, none is used.
pub(super) const FEW: f64 = 0.2;

/// Why the mask of a detection does not meet its box, in words; `None` if it does. `detections` are those of the frame.
pub(crate) fn mask_contradiction(
    mask: &Mask,
    index: usize,
    detections: &[usize],
    (scene, images): (&Scene, &SceneImages),
) -> Option<&'static str> {
    let own = images.boxes[index]?;
    let size = scene.frames[scene.detections[index].frame_index as usize].image_size;
    let others = detections.iter().filter(|other| **other != index).filter_map(|&other| images.boxes[other]);
    contradiction(mask, &own, others, size.map(|size| [size.x as u32, size.y as u32]))
}

/// The same of a box and those of the other detections.
fn contradiction(
    mask: &Mask,
    own: &BoundingBox,
    others: impl Iterator<Item = BoundingBox>,
    image_size: Option<[u32; 2]>,
) -> Option<&'static str> {
    let extent = mask.bounding_box()?;
    if meets(&extent, own) {
        return None;
    }
    if image_size.and_then(|size| by_rows(mask, size)).is_some_and(|extent| meets(&extent, own)) {
        return Some("its runs go along the rows of the image, not its columns");
    }
    if others.into_iter().any(|other| extent.iou(&other) > IS_OF_OTHER) {
        return Some("it is the mask of another detection: masks and boxes are in different orders");
    }
    Some("it is of another object or image, or in another order of pixels")
}

/// Whether the extent of a mask lies in its box.
fn meets(extent: &BoundingBox, own: &BoundingBox) -> bool {
    let side = |low: f64, high: f64| (high - low).max(0.0);
    let common = side(extent.x0().max(own.x0()), extent.x1().min(own.x1()))
        * side(extent.y0().max(own.y0()), extent.y1().min(own.y1()));
    common >= INSIDE * side(extent.x0(), extent.x1()) * side(extent.y0(), extent.y1())
}

/// The extent of a mask whose pixels were counted along rows, and read along columns.
fn by_rows(mask: &Mask, [width, height]: [u32; 2]) -> Option<BoundingBox> {
    let pixel = |[x, y]: [u32; 2]| {
        let index = u64::from(x) * u64::from(height) + u64::from(y);
        [index % u64::from(width), index / u64::from(width)].map(|x| x as f64)
    };
    let mut edges = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for [x, y] in mask.pixels().map(pixel) {
        edges = [edges[0].min(x), edges[1].min(y), edges[2].max(x + 1.0), edges[3].max(y + 1.0)];
    }
    BoundingBox::new(edges).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_meet_their_boxes_or_the_reason_is_found() {
        let size = [64, 48];
        let own = BoundingBox::new([10.0, 12.0, 20.0, 18.0]).unwrap();
        let other = BoundingBox::new([40.0, 20.0, 50.0, 30.0]).unwrap();
        let found = |mask: &Mask| contradiction(mask, &own, [other].into_iter(), Some(size));
        let filled =
            |[x0, y0, x1, y1]: [u32; 4]| Mask::from_fn(64, 48, |x, y| (x0..x1).contains(&x) && (y0..y1).contains(&y));
        // Also a visible part, and a mask that is a little larger.
        for window in [[10, 12, 20, 18], [10, 12, 13, 14], [9, 11, 21, 20]] {
            assert_eq!(found(&filled(window)), None);
        }
        let right = filled([10, 12, 20, 18]);
        let by_rows = Mask::from_fn(64, 48, |x, y| {
            let index = x * 48 + y;
            right.contains(index % 64, index / 64)
        });
        assert!(found(&by_rows).unwrap().contains("along the rows"));
        assert!(found(&filled([41, 20, 50, 30])).unwrap().contains("of another detection"));
        assert!(found(&filled([0, 30, 64, 48])).unwrap().contains("another object or image"));
    }
}

//! All masks of one image: their contacts, and which of them may cover only a part of an object.

use nalgebra::Vector2;
use quadlift::geometry::{Camera, OutlineEnd, TangentLines};

use crate::contacts::Contacts;
use crate::hull::ConvexHull;
use crate::mask::Mask;

/// Pixels between two masks, or between a mask and the border of the image, that still count as touching: masks often
/// keep a gap of a pixel.
const TOUCHING: u32 = 2;

/// How many masks of an image cover each of its pixels; 255 means 255 or more.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FrameMasks {
    width: u32,
    counts: Vec<u8>,
}

/// Width and height of the smallest window at the image's origin that holds these masks.
pub fn reach<'a>(masks: impl Iterator<Item = &'a Mask>) -> [u32; 2] {
    masks.filter_map(Mask::extent).fold([0, 0], |[width, height], [.., x, y]| [width.max(x), height.max(y)])
}

impl FrameMasks {
    /// The masks of one image.
    pub fn new<'a>(masks: impl Iterator<Item = &'a Mask> + Clone) -> Self {
        let [width, height] = reach(masks.clone());
        let mut counts = vec![0; width as usize * height as usize];
        for [x, y] in masks.flat_map(Mask::pixels) {
            let count: &mut u8 = &mut counts[y as usize * width as usize + x as usize];
            *count = count.saturating_add(1);
        }
        Self { width, counts }
    }

    /// Whether another mask than this one, which is among them, covers a pixel.
    fn is_covered_by_others(&self, mask: &Mask, x: u32, y: u32) -> bool {
        let count = self.counts.get(y as usize * self.width as usize + x as usize);
        x < self.width && count.is_some_and(|&count| count > u8::from(mask.contains(x, y)))
    }

    /// Where the outline of one of the masks touches the others and the border of the image, whose size is width and
    /// height in pixels.
    pub fn contacts(&self, mask: &Mask, image_size: [u32; 2]) -> Contacts {
        Contacts::of(mask, image_size, |x, y| self.is_covered_by_others(mask, x, y), TOUCHING)
    }

    /// The tangent lines of one of the masks, undistorted with a lens model: cut off at the image border if its size
    /// is known, hidden at other masks. `None` for an empty mask, and if the lens has no pinhole pixels for it.
    pub fn tangent_lines(
        &self,
        mask: &Mask,
        image_size: Option<Vector2<f64>>,
        lens: Option<&Camera>,
    ) -> Option<TangentLines> {
        let hull = ConvexHull::of_mask(mask)?;
        let touching = f64::from(TOUCHING);
        let at_border = |point: &Vector2<f64>| {
            image_size.is_some_and(|size| point.min() <= touching || (size - point).min() <= touching)
        };
        let others_near = |point: &Vector2<f64>| {
            // Casts saturate: what lies above or to the left of the image is at its border.
            let near = |x: f64| (x - touching).floor() as u32..(x + touching).ceil() as u32;
            near(point.y).any(|y| near(point.x).any(|x| self.is_covered_by_others(mask, x, y)))
        };
        let end = |point: &Vector2<f64>| OutlineEnd { cut_off: at_border(point), hidden: others_near(point) };
        let points = match lens {
            Some(lens) => lens.undistort_outline(hull.vertices())?,
            None => hull.vertices().to_vec(),
        };
        TangentLines::of_outline(&points.into_iter().zip(hull.vertices().iter().map(end)).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::CameraModel;

    fn square(x: u32, y: u32) -> Mask {
        Mask { origin: [x, y], width: 10, height: 10, inside: vec![true; 100] }
    }

    #[test]
    fn lines_that_touch_something_are_known() {
        // The second square lies one pixel to the right of the first one, the third one at the left border.
        let masks = [square(20, 20), square(31, 20), square(1, 50)];
        let frame = FrameMasks::new(masks.iter());
        let size = Some(Vector2::new(100.0, 100.0));
        let lines = frame.tangent_lines(&masks[0], size, None).unwrap();
        assert_eq!(lines.bounding_box().unwrap().edges(), [20.0, 20.0, 30.0, 30.0]);
        let flags =
            |lines: &TangentLines, of: fn(&OutlineEnd) -> bool| lines.lines().map(|l| of(&l.end)).collect::<Vec<_>>();
        assert_eq!(flags(&lines, |end| end.cut_off), [false; 8]);
        assert_eq!(flags(&lines, |end| end.hidden), [true, true, true, false, false, false, true, true]);
        let contacts = frame.contacts(&masks[0], [100, 100]);
        assert_eq!(contacts, Contacts { border: 0.0, others: 0.25 });
        let lines = frame.tangent_lines(&masks[2], size, None).unwrap();
        assert_eq!(flags(&lines, |end| end.cut_off), [false, false, true, true, true, true, true, false]);
        assert_eq!(flags(&lines, |end| end.hidden), [false; 8]);
        assert_eq!(flags(&frame.tangent_lines(&masks[2], None, None).unwrap(), |end| end.cut_off), [false; 8]);
        assert_eq!(FrameMasks::default().tangent_lines(&Mask::default(), size, None), None);
    }

    #[test]
    fn masks_that_overlap_touch() {
        let masks = [square(20, 20), square(24, 20)];
        let frame = FrameMasks::new(masks.iter());
        assert!(frame.contacts(&masks[0], [100, 100]).touches_another());
        assert!(frame.tangent_lines(&masks[0], None, None).unwrap().line(0).end.hidden);
    }

    #[test]
    fn lines_of_a_distorted_mask_are_those_of_its_undistorted_outline() {
        let lens = Camera::new(CameraModel::SimpleRadial, &[100.0, 50.0, 50.0, -0.2]).unwrap();
        let mask = square(80, 45);
        let frame = FrameMasks::new(std::iter::once(&mask));
        let lines = frame.tangent_lines(&mask, None, Some(&lens)).unwrap();
        let corner = lens.undistort_point(&Vector2::new(90.0, 45.0)).unwrap();
        assert!((lines.line(0).reach - corner.x).abs() < 1e-9 && corner.x > 91.0, "{lines:?}");
    }
}

//! One object's measurements, gathered over the frames: the input of every solver.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::Scene;
use super::cues::Cues;
use super::parts::Detection;
use crate::geometry::{BoundingBox, Ellipse, Projection, TangentLines};

/// Edges this close to the image border (pixels) count as cut off. KITTI's boxes end at 1241 to 1243 of 1242 pixels.
pub(crate) const BORDER_TOLERANCE_PX: f64 = 2.0;

/// Which of the edges `x0, y0, x1, y1` lie within `tolerance` pixels of the image border.
pub(crate) fn edges_at_border(
    bounding_box: &BoundingBox,
    image_size: Option<Vector2<f64>>,
    tolerance: f64,
) -> [bool; 4] {
    let Some(size) = image_size else { return [false; 4] };
    [
        bounding_box.x0 <= tolerance,
        bounding_box.y0 <= tolerance,
        bounding_box.x1 >= size.x - tolerance,
        bounding_box.y1 >= size.y - tolerance,
    ]
}

/// One object seen in one frame.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Index of the frame in [`crate::scene::SceneParts::frames`]; arbitrary without a scene.
    pub frame_index: usize,
    /// World to pixels.
    pub projection: Projection,
    /// Width and height of the image as it is, in pixels, where known.
    pub image_size: Option<Vector2<f64>>,
    /// The box in pixels.
    pub bounding_box: Option<BoundingBox>,
    /// The ellipse in pixels.
    pub ellipse: Option<Ellipse>,
    /// The tangent lines of mask, outline or oriented box in pixels; if there are any, they replace the edges of the box.
    pub tangent_lines: Option<TangentLines>,
    /// Whether the ellipse may be of a part of the object.
    pub partial: bool,
    /// With lens distortion: the box in the original image, see [`Detection::box_in_image`].
    pub box_in_image: Option<BoundingBox>,
    /// Which edges of the box (left, top, right, bottom) are probably hidden by another detection of the frame.
    pub occluded_edges: [bool; 4],
    /// Which edges of the box, or of the box around the ellipse (left, top, right, bottom), lie so close to the image
    /// border that the object is cut off there: they only bound its extent from below. Decided once, for the fit and
    /// its report (`View::with_cut_off_edges`).
    pub cut_off: [bool; 4],
    /// Depth and 3D box, if known.
    pub cues: Cues,
    /// Which depths share the scale of this one.
    pub depth_scale: DepthScale,
    /// Measured minus true depth, world units: the shift of the source, 0 before it is estimated.
    pub(crate) depth_shift: f64,
}

/// Which depths of a source share a scale that is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DepthScale {
    /// All.
    #[default]
    Source,
    /// Those of the same frame, beside that of all.
    Frame,
    /// They have none: they are lengths of the world.
    Known,
}

impl View {
    /// A view of an object by its box (pixels), for [`crate::solve::Estimator`].
    ///
    /// ```
    /// use nalgebra::Matrix3x4;
    /// use quadlift::geometry::{BoundingBox, Projection};
    /// use quadlift::scene::View;
    ///
    /// let projection = Projection::from_matrix(Matrix3x4::identity())?;
    /// let view = View::from_box(projection, BoundingBox::new([0.1, 0.1, 0.3, 0.2])?).with_image_size(1.0, 1.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_box(projection: Projection, bounding_box: BoundingBox) -> Self {
        Self { bounding_box: Some(bounding_box), ..Self::unmeasured(projection) }
    }

    /// The view in an image of this width and height (pixels): edges at its border only bound the extent of the object
    /// from below.
    #[must_use]
    pub fn with_image_size(self, width: f64, height: f64) -> Self {
        Self { image_size: Some(Vector2::new(width, height)), ..self }.with_cut_off_edges(BORDER_TOLERANCE_PX)
    }

    fn unmeasured(projection: Projection) -> Self {
        Self {
            frame_index: 0,
            projection,
            image_size: None,
            bounding_box: None,
            ellipse: None,
            tangent_lines: None,
            partial: false,
            box_in_image: None,
            occluded_edges: [false; 4],
            cut_off: [false; 4],
            cues: Cues::default(),
            depth_scale: DepthScale::default(),
            depth_shift: 0.0,
        }
    }

    /// The measurement for the closed forms: the ellipse, or the one inscribed in the oriented box or in the box.
    pub fn ellipse_or_inscribed(&self) -> Option<Ellipse> {
        let turned = || self.tangent_lines.as_ref().and_then(TangentLines::inscribed_ellipse);
        self.ellipse.or_else(turned).or_else(|| self.bounding_box.as_ref().map(Ellipse::inscribed_in))
    }

    /// The view with the edges cut off that lie within `tolerance` pixels of the image border; none if the image size
    /// is unknown.
    #[must_use]
    pub(crate) fn with_cut_off_edges(mut self, tolerance: f64) -> Self {
        let measured = self.measured_box().map(|measured| self.in_image(&measured));
        self.cut_off = measured.map_or([false; 4], |b| edges_at_border(&b, self.image_size, tolerance));
        self.tangent_lines = self.tangent_lines.map(|lines| lines.with_cut_off_edges(self.cut_off));
        self
    }

    /// The view with the edges cut off that lie within this fraction of the larger image side from the border, and
    /// within [`BORDER_TOLERANCE_PX`] in any case: detectors are inaccurate near the border.
    #[must_use]
    pub(crate) fn within_margin(self, margin: f64) -> Self {
        let margin = self.image_size.map_or(0.0, |size| margin * size.max());
        self.with_cut_off_edges(margin.max(BORDER_TOLERANCE_PX))
    }

    /// The box of the measurement in pixels: the box itself, or the one around the ellipse.
    pub fn measured_box(&self) -> Option<BoundingBox> {
        self.bounding_box.or_else(|| self.ellipse.as_ref().map(|ellipse| ellipse.bounding_box()))
    }

    /// Where a measured box, or the box around a measured ellipse, lies in the image itself, whose border may cut it:
    /// somewhere else only where a lens bends the image.
    pub(crate) fn in_image(&self, measured: &BoundingBox) -> BoundingBox {
        self.box_in_image.unwrap_or(*measured)
    }
}

/// All views of one object, with its names.
#[derive(Debug, Clone, Default)]
pub(crate) struct ObjectViews {
    /// Index into [`crate::scene::SceneParts::object_ids`].
    pub object_index: usize,
    /// Index into [`crate::scene::SceneParts::categories`]: the most frequent category of its detections, the first one
    /// of ties.
    pub category_index: Option<usize>,
    /// The views, in the order in which their detections were given.
    pub views: Vec<View>,
}

impl Scene {
    /// The view of a detection.
    pub fn view(&self, detection: &Detection) -> View {
        let frame = &self.frames[detection.frame_index as usize];
        let cues = detection.cues.as_deref().copied().unwrap_or_default();
        let is_among = |sources: &BTreeSet<u32>| {
            cues.depth.and_then(|depth| depth.source).is_some_and(|source| sources.contains(&source))
        };
        let depth_scale = match (is_among(&self.scale_known), is_among(&self.scaled_by_frame)) {
            (true, _) => DepthScale::Known,
            (false, true) => DepthScale::Frame,
            (false, false) => DepthScale::Source,
        };
        View {
            frame_index: detection.frame_index as usize,
            projection: frame.projection,
            image_size: frame.image_size,
            bounding_box: detection.bounding_box,
            ellipse: detection.ellipse,
            tangent_lines: detection.tangent_lines.as_deref().copied(),
            partial: detection.partial,
            box_in_image: detection.box_in_image,
            occluded_edges: [false; 4],
            cut_off: [false; 4],
            cues,
            depth_scale,
            depth_shift: 0.0,
        }
        .with_cut_off_edges(BORDER_TOLERANCE_PX)
    }

    /// For each object, the indices of its detections that `keep` accepts.
    pub fn detections_by_object(&self, keep: impl Fn(&Detection) -> bool) -> Vec<Vec<u32>> {
        let mut groups = vec![Vec::new(); self.object_ids.len()];
        for (index, detection) in self.detections.iter().enumerate() {
            if let Some(object) = detection.object_index
                && keep(detection)
            {
                // Checked by the builder to fit.
                groups[object as usize].push(index as u32);
            }
        }
        groups
    }

    /// Gathers the views of one object from the indices of its detections.
    pub(crate) fn object_views(&self, object_index: usize, detections: &[u32]) -> ObjectViews {
        let mut counts: Vec<(u32, usize)> = Vec::new();
        let mut views = Vec::with_capacity(detections.len());
        for &index in detections {
            let detection = &self.detections[index as usize];
            if let Some(category) = detection.category_index {
                match counts.iter_mut().find(|(c, _)| *c == category) {
                    Some((_, n)) => *n += 1,
                    None => counts.push((category, 1)),
                }
            }
            views.push(self.view(detection));
        }
        let most = counts.iter().map(|&(_, n)| n).max();
        let category_index = counts.iter().find(|&&(_, n)| Some(n) == most).map(|&(c, _)| c as usize);
        ObjectViews { object_index, category_index, views }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_side_of_the_border_cuts_off_its_own_edge() {
        let size = Some(Vector2::new(640.0, 480.0));
        let inside = [50.0, 60.0, 600.0, 400.0];
        let at_the_border = [1.5, 1.5, 638.5, 478.5];
        let of = |edges: [f64; 4]| edges_at_border(&BoundingBox::new(edges).unwrap(), size, BORDER_TOLERANCE_PX);
        assert_eq!(of(inside), [false; 4]);
        for edge in 0..4 {
            let mut edges = inside;
            edges[edge] = at_the_border[edge];
            assert_eq!(of(edges), std::array::from_fn(|k| k == edge), "{edges:?}");
        }
        assert_eq!(edges_at_border(&BoundingBox::new(at_the_border).unwrap(), None, 2.0), [false; 4]);
    }
}

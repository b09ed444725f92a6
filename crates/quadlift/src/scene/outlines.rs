//! Outlines and oriented boxes of detections: from the image to tangent lines (docs/method.md, section 2.2).

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::ops::Index;

use nalgebra::Vector2;

use super::error::OutlineError;
use super::parts::{Detection, Frame};
use super::views::BORDER_TOLERANCE_PX;
use crate::geometry::{BoundingBox, Camera, OrientedBox, OutlineEnd, SUPPORT_DIRECTIONS, TangentLine, TangentLines};

/// Distance in pixels up to which an outline touches another one: outlines of networks keep a gap of a pixel or two.
const TOUCHING_PX: f64 = 2.0;

/// Frames with more outlines than this are skipped: every pair is compared.
const MAX_OUTLINES: usize = 1000;

/// With a lens, edges of outlines are divided into parts of at most this share of the outline's extent: straight edges become curves.
const LENS_STEP: f64 = 1.0 / 32.0;

/// An outline is flat when its width is at most this share of its length: rounding of numbers of an image.
const FLAT: f64 = 1e-9;

/// Checks that points are the corners of an outline.
///
/// # Errors
/// [`OutlineError`].
pub fn check_outline(corners: &[[f64; 2]]) -> Result<(), OutlineError> {
    let first = match corners {
        [first, _, _, ..] => Vector2::from(*first),
        _ => return Err(OutlineError::TooFewPoints(corners.len())),
    };
    if !corners.iter().flatten().all(|x| x.is_finite()) {
        return Err(OutlineError::NotFinite);
    }
    let sides = || corners.iter().map(|corner| Vector2::from(*corner) - first);
    let far = sides().max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default();
    let width = sides().map(|side| far.perp(&side).abs()).fold(0.0, f64::max);
    if width > FLAT * far.norm_squared() { Ok(()) } else { Err(OutlineError::Flat) }
}

/// Outline and oriented box of a detection, in the image as it is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Shape<'a> {
    /// Corners of the outline in pixels, a polygon in either direction. Parts outside of the image are cut off.
    pub outline: Option<&'a [[f64; 2]]>,
    /// Oriented box in pixels; an outline comes first.
    pub oriented_box: Option<OrientedBox>,
    /// Which lines of the outline end where another outline of the image begins, if precomputed ([`occluded_lines`]): the other one need
    /// not be in the scene. Otherwise computed from the outlines of the scene.
    pub occluded_lines: Option<[bool; SUPPORT_DIRECTIONS]>,
}

impl Shape<'_> {
    /// The box around it, also beyond the border of the image, as boxes are.
    pub(crate) fn bounding_box(&self) -> Option<BoundingBox> {
        match self.outline {
            Some(corners) => box_around(corners),
            None => self.oriented_box.as_ref()?.bounding_box(),
        }
    }
}

/// Outlines and oriented boxes on their way into a scene: each gives its detection tangent lines; outlines of one image and source
/// that touch each other hide lines.
#[derive(Debug, Default)]
pub struct Outlines {
    /// By frame and source.
    by_image: BTreeMap<(u32, Option<u32>), Vec<ImageOutline>>,
}

impl Outlines {
    /// Gives a detection the lines of its shape and, unless a box was measured, the box around it. `index` is the place of the detection
    /// in the scene; its box is undistorted already, and `has_box` says whether one was measured.
    ///
    /// # Errors
    /// [`OutlineError`]; the detection is unchanged then.
    pub fn add(
        &mut self,
        index: usize,
        detection: &mut Detection,
        has_box: bool,
        frame: &Frame,
        shape: &Shape,
    ) -> Result<(), OutlineError> {
        let outline = shape.outline.map(|corners| ImageOutline::new(index, corners, frame)).transpose()?;
        let turned = shape.oriented_box.filter(|_| outline.is_none());
        let mut lines = match (&outline, &turned) {
            (Some(outline), _) => outline.tangent_lines(),
            (None, Some(turned)) => turned_lines(turned, frame),
            (None, None) => return Ok(()),
        };
        if let Some(given) = &detection.bounding_box {
            lines = lines.map(|lines| lines.beside_box(given));
        } else if !has_box {
            let around = shape.bounding_box();
            detection.bounding_box = match frame.lens {
                Some(_) => lines.as_ref().and_then(TangentLines::bounding_box),
                None => around,
            };
            detection.box_in_image = detection.box_in_image.or(around.filter(|_| frame.lens.is_some()));
        }
        if let Some(outline) = outline {
            match &shape.occluded_lines {
                Some(hidden) => lines = lines.map(|lines| lines.with_hidden(hidden)),
                None => {
                    let image = (detection.frame_index, detection.source_index);
                    self.by_image.entry(image).or_default().push(outline);
                }
            }
        }
        detection.tangent_lines = lines.map(Box::new);
        Ok(())
    }

    /// Marks the lines that other outlines of the image may hide, in the detections to which the indices lead.
    pub fn hide(&self, detections: &mut [Detection]) {
        for outlines in self.by_image.values() {
            for (detection, hidden) in touch(outlines) {
                if let Some(lines) = &mut detections[detection].tangent_lines {
                    **lines = lines.with_hidden(&hidden);
                }
            }
        }
    }
}

/// Which lines (in [`SUPPORT_DIRECTIONS`]) of outlines end where another outline of the same frame begins: for each its frame and its
/// corners in pixels. Outlines that are wrong neither
/// hide nor are hidden. The size of the image is not known here: lines that its border cuts off may count as hidden.
pub fn occluded_lines<F: Ord, C: AsRef<[[f64; 2]]>>(outlines: &[Option<(F, C)>]) -> Vec<[bool; SUPPORT_DIRECTIONS]> {
    let mut by_frame: BTreeMap<&F, Vec<ImageOutline>> = BTreeMap::new();
    for (index, (frame, corners)) in outlines.iter().enumerate().filter_map(|(k, found)| Some((k, found.as_ref()?))) {
        if let Ok(outline) = ImageOutline::in_image(index, corners.as_ref(), None, None) {
            by_frame.entry(frame).or_default().push(outline);
        }
    }
    let mut hidden = vec![[false; SUPPORT_DIRECTIONS]; outlines.len()];
    for (index, lines) in by_frame.values().flat_map(|outlines| touch(outlines)) {
        hidden[index].iter_mut().zip(lines).for_each(|(place, line)| *place = line);
    }
    hidden
}

/// The corners of an outline in a frame that its tangent lines touch, in their order: an outline of them has the same lines. Fewer than
/// three outside of the image.
pub(crate) fn extreme_corners(corners: &[[f64; 2]], frame: &Frame) -> Vec<[f64; 2]> {
    let Ok(outline) = ImageOutline::new(0, corners, frame) else { return Vec::new() };
    let Some(lines) = outline.tangent_lines() else { return Vec::new() };
    let on_line = |p: &Vector2<f64>| lines.lines().any(|line| line.normal.dot(p) == line.reach);
    let touching = outline.points.iter().zip(&outline.corners).filter(|((p, _), _)| on_line(p));
    touching.map(|(_, corner)| (*corner).into()).collect()
}

/// An outline in its image, which [`touch`] compares with others.
#[derive(Debug)]
struct ImageOutline {
    /// Index of its detection.
    detection: usize,
    /// Its corners in the image.
    corners: Vec<Vector2<f64>>,
    /// The box around them.
    around: Option<BoundingBox>,
    /// The corners in pixels of the pinhole camera.
    points: Vec<(Vector2<f64>, OutlineEnd)>,
}

impl ImageOutline {
    /// The corners of an outline inside of the image, checked.
    fn new(detection: usize, corners: &[[f64; 2]], frame: &Frame) -> Result<Self, OutlineError> {
        Self::in_image(detection, corners, frame.image_size, frame.lens.as_ref())
    }

    /// The same with the size of the image and the lens of the frame.
    fn in_image(
        detection: usize,
        corners: &[[f64; 2]],
        image_size: Option<Vector2<f64>>,
        lens: Option<&Camera>,
    ) -> Result<Self, OutlineError> {
        check_outline(corners)?;
        let mut corners: Vec<Vector2<f64>> = corners.iter().map(|corner| Vector2::from(*corner)).collect();
        if let Some(size) = image_size {
            corners = clipped(corners, size);
        }
        let at_border = |p: &Vector2<f64>| {
            let near = |size: Vector2<f64>| p.min() <= BORDER_TOLERANCE_PX || (size - p).min() <= BORDER_TOLERANCE_PX;
            image_size.is_some_and(near)
        };
        if lens.is_some() {
            corners = divided(&corners);
        }
        let ends = corners.iter().map(|p| OutlineEnd { cut_off: at_border(p), hidden: false });
        let points = match lens {
            Some(lens) => lens.undistort_outline(&corners).unwrap_or_default(),
            None => corners.clone(),
        };
        let points = points.into_iter().zip(ends).collect();
        Ok(Self { detection, around: box_around(&corners), corners, points })
    }

    /// The tangent lines; `None` outside of the image, and if the lens has no pinhole pixels for it.
    fn tangent_lines(&self) -> Option<TangentLines> {
        TangentLines::of_outline(&self.points)
    }

    /// Where a point of the image lies.
    fn place_of(&self, point: &Vector2<f64>) -> Place {
        let is_near = |b: &BoundingBox| {
            let [x0, y0, x1, y1] = b.edges();
            point.x >= x0 - TOUCHING_PX
                && point.y >= y0 - TOUCHING_PX
                && point.x <= x1 + TOUCHING_PX
                && point.y <= y1 + TOUCHING_PX
        };
        if !self.around.as_ref().is_some_and(is_near) {
            return Place::Outside;
        }
        let mut inside = false;
        for (k, b) in self.corners.iter().enumerate() {
            let a = &self.corners[(k + self.corners.len() - 1) % self.corners.len()];
            let (along, to_point) = (b - a, point - a);
            let place = (along.dot(&to_point) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
            if (to_point - along * place).norm() <= TOUCHING_PX {
                return Place::Edge;
            }
            if (a.y <= point.y) != (b.y <= point.y) {
                inside ^= a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x) > point.x;
            }
        }
        if inside { Place::Inside } else { Place::Outside }
    }

    /// Whether one reaches into the other, beyond its edge: outlines of whole objects do, those of visible parts do not.
    fn overlaps(&self, other: &Self) -> bool {
        let reaches = |a: &Self, b: &Self| a.corners.iter().any(|corner| b.place_of(corner) == Place::Inside);
        reaches(self, other) || reaches(other, self)
    }
}

/// Where a point lies from an outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Outside,
    /// At most [`TOUCHING_PX`] from its edge.
    Edge,
    Inside,
}

/// The box around points; `None` without an extent.
fn box_around<P: Index<usize, Output = f64>>(points: &[P]) -> Option<BoundingBox> {
    let mut edges = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for p in points {
        edges = [edges[0].min(p[0]), edges[1].min(p[1]), edges[2].max(p[0]), edges[3].max(p[1])];
    }
    BoundingBox::new(edges).ok()
}

/// The part of a polygon inside of an image (Sutherland and Hodgman: parts of a polygon that is not convex stay joined along the
/// border, which changes no tangent line).
fn clipped(mut corners: Vec<Vector2<f64>>, size: Vector2<f64>) -> Vec<Vector2<f64>> {
    for (axis, sign, limit) in [(0, 1.0, 0.0), (1, 1.0, 0.0), (0, -1.0, -size.x), (1, -1.0, -size.y)] {
        let beyond = |p: &Vector2<f64>| sign * p[axis] - limit;
        if corners.iter().all(|p| beyond(p) >= 0.0) {
            continue;
        }
        let mut inside = Vec::with_capacity(corners.len() + 4);
        for (k, b) in corners.iter().enumerate() {
            let a = &corners[(k + corners.len() - 1) % corners.len()];
            let (of_a, of_b) = (beyond(a), beyond(b));
            if (of_a < 0.0) != (of_b < 0.0) {
                let mut crossing = a + (b - a) * (of_a / (of_a - of_b));
                crossing[axis] = sign * limit;
                inside.push(crossing);
            }
            if of_b >= 0.0 {
                inside.push(*b);
            }
        }
        corners = inside;
    }
    corners
}

/// The polygon with more points on its longer edges.
fn divided(corners: &[Vector2<f64>]) -> Vec<Vector2<f64>> {
    let Some(around) = box_around(corners) else { return corners.to_vec() };
    let step = LENS_STEP * around.size().max();
    let mut points = Vec::new();
    for (k, b) in corners.iter().enumerate() {
        let a = &corners[(k + corners.len() - 1) % corners.len()];
        let parts = ((b - a).norm() / step).ceil().max(1.0);
        points.extend((1..=parts as usize).map(|i| a + (b - a) * (i as f64 / parts)));
    }
    points
}

/// Indices of the detections of outlines of one image that touch another one, and which of their lines are hidden there.
fn touch(outlines: &[ImageOutline]) -> Vec<(usize, Vec<bool>)> {
    if outlines.len() < 2 || outlines.len() > MAX_OUTLINES {
        return Vec::new();
    }
    let of_outline = |(index, outline): (usize, &ImageOutline)| {
        let lines = outline.tangent_lines()?;
        let overlaps = vec![OnceCell::new(); outlines.len()];
        let hides = |other: usize| !overlaps[other].get_or_init(|| outline.overlaps(&outlines[other]));
        let others = |point: &Vector2<f64>| {
            let touches = |other: usize| other != index && outlines[other].place_of(point) == Place::Edge;
            (0..outlines.len()).any(|other| touches(other) && hides(other))
        };
        let hidden = |line: TangentLine| {
            let mut on_line = outline.points.iter().zip(&outline.corners);
            on_line.any(|((p, _), corner)| line.normal.dot(p) == line.reach && others(corner))
        };
        let hidden: Vec<bool> = lines.lines().map(hidden).collect();
        hidden.contains(&true).then_some((outline.detection, hidden))
    };
    outlines.iter().enumerate().filter_map(of_outline).collect()
}

/// The lines of the sides of an oriented box, undistorted like a box: by the ellipse in it. `None` if the lens has no pinhole pixels
/// for it.
fn turned_lines(turned: &OrientedBox, frame: &Frame) -> Option<TangentLines> {
    let lines = TangentLines::of_oriented_box(turned, frame.image_size, BORDER_TOLERANCE_PX);
    let undistorted = |lens: &Camera| {
        let ellipse = lens.undistort_ellipse(&turned.inscribed_ellipse()?)?;
        Some(lines.with_reach_of(&ellipse))
    };
    match &frame.lens {
        Some(lens) => undistorted(lens),
        None => Some(lines),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{NewDetection, Scene, SceneBuilder};
    use super::*;
    use crate::geometry::{CamFromWorld, CameraModel, Projection};
    use nalgebra::Matrix3x4;

    fn scene(outlines: &[(&str, &[[f64; 2]])]) -> Scene {
        let mut builder = SceneBuilder::new("test");
        for frame in ["a", "b"] {
            let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
            builder.add_frame(frame, projection, Some([100.0, 80.0])).unwrap();
        }
        for (frame, outline) in outlines {
            builder.add_detection(&NewDetection { frame, outline: Some(outline), ..Default::default() }).unwrap();
        }
        builder.build()
    }

    fn flags(scene: &Scene, detection: usize, of: impl Fn(&OutlineEnd) -> bool) -> Vec<usize> {
        let lines = scene.detections[detection].tangent_lines.as_deref().unwrap();
        lines.lines().enumerate().filter(|(_, line)| of(&line.end)).map(|(k, _)| k).collect()
    }

    const SQUARE: [[f64; 2]; 4] = [[20.0, 20.0], [40.0, 20.0], [40.0, 40.0], [20.0, 40.0]];

    #[test]
    fn an_outline_without_a_box_has_the_box_around_it() {
        let scene = scene(&[("a", &[[10.0, 20.0], [30.0, 25.0], [15.0, 60.0]])]);
        assert_eq!(scene.detections[0].bounding_box.unwrap().edges(), [10.0, 20.0, 30.0, 60.0]);
        let lines = scene.detections[0].tangent_lines.as_deref().unwrap();
        // Right and down: 15 + 60 is more than 30 + 25.
        assert!((lines.line(1).reach - 75.0 * std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
        assert!(flags(&scene, 0, |end| end.is_open()).is_empty());
    }

    #[test]
    fn what_lies_outside_of_the_image_is_cut_off() {
        let scene = scene(&[("a", &[[80.0, 20.0], [120.0, 20.0], [120.0, 40.0], [80.0, 40.0]])]);
        let lines = scene.detections[0].tangent_lines.as_deref().unwrap();
        assert_eq!(lines.line(0).reach, 100.0);
        assert_eq!(flags(&scene, 0, |end| end.cut_off), [0, 1, 2, 6, 7]);
        // The box is as given.
        assert_eq!(scene.detections[0].bounding_box.unwrap().edges(), [80.0, 20.0, 120.0, 40.0]);
        let outside = self::scene(&[("a", &[[180.0, 20.0], [220.0, 20.0], [220.0, 40.0]])]);
        assert!(outside.detections[0].tangent_lines.is_none() && outside.detections[0].bounding_box.is_some());
    }

    #[test]
    fn lines_that_are_hidden_can_be_computed_without_a_scene() {
        let right: [[f64; 2]; 4] = [[41.0, 30.0], [60.0, 30.0], [60.0, 60.0], [41.0, 60.0]];
        let of_scene = scene(&[("a", &SQUARE), ("a", &right), ("b", &SQUARE)]);
        let outlines: [(u8, &[[f64; 2]]); 3] = [(0, &SQUARE), (0, &right), (1, &SQUARE)];
        let flat = [[0.0, 0.0], [1.0, 1.0]];
        let [a, b, c] = outlines.map(Some);
        let found = occluded_lines(&[a, None, b, c, Some((0, flat.as_slice()))]);
        for (index, found) in [0, 2, 3].into_iter().map(|k| found[k]).enumerate() {
            let expected: Vec<usize> = (0..8).filter(|&k| found[k]).collect();
            assert_eq!(flags(&of_scene, index, |end| end.hidden), expected, "{index}");
        }
        assert!(found[0].contains(&true) && found[2].contains(&true));
        assert_eq!([found[1], found[4]], [[false; 8]; 2]);
        // They count where the other outline is not in the scene.
        let frame = &of_scene.frames[0];
        let mut detection = Detection::default();
        let shape = Shape { outline: Some(&SQUARE), occluded_lines: Some(found[0]), ..Default::default() };
        Outlines::default().add(0, &mut detection, false, frame, &shape).unwrap();
        assert_eq!(detection.tangent_lines, of_scene.detections[0].tangent_lines);
    }

    #[test]
    fn lines_that_touch_another_outline_are_hidden() {
        // To the right of the square, a pixel away, lower; and one in another frame.
        let right: [[f64; 2]; 4] = [[41.0, 30.0], [60.0, 30.0], [60.0, 60.0], [41.0, 60.0]];
        let scene =
            scene(&[("a", &SQUARE), ("a", &right), ("b", &SQUARE), ("a", &[[80.0, 1.0], [90.0, 1.0], [85.0, 9.0]])]);
        // Right, right and down, down: the corner at (40, 40) touches.
        assert_eq!(flags(&scene, 0, |end| end.hidden), [0, 1, 2]);
        // The corner at (41, 30) touches the square.
        assert_eq!(flags(&scene, 1, |end| end.hidden), [4, 5, 6]);
        assert!(flags(&scene, 2, |end| end.hidden).is_empty() && flags(&scene, 3, |end| end.hidden).is_empty());
        // Those that overlap are of whole objects.
        let inside = self::scene(&[("a", &[[0.0, 5.0], [90.0, 5.0], [90.0, 75.0], [5.0, 75.0]]), ("a", &SQUARE)]);
        assert!(flags(&inside, 1, |end| end.hidden).is_empty() && flags(&inside, 0, |end| end.hidden).is_empty());
    }

    #[test]
    fn a_box_beside_an_outline_gives_the_lines_along_the_axes() {
        let mut builder = SceneBuilder::new("test");
        builder.add_frame("a", Projection::from_matrix(Matrix3x4::identity()).unwrap(), Some([100.0, 80.0])).unwrap();
        let bounding_box = BoundingBox::new([18.0, 19.0, 43.0, 79.0]).ok();
        let input = NewDetection { frame: "a", bounding_box, outline: Some(&SQUARE), ..Default::default() };
        builder.add_detection(&input).unwrap();
        let scene = builder.build();
        let lines = scene.detections[0].tangent_lines.as_deref().unwrap();
        assert_eq!([0, 2, 4, 6].map(|k| lines.line(k).reach), [43.0, 79.0, -18.0, -19.0]);
        assert!((lines.line(1).reach - 80.0 * std::f64::consts::FRAC_1_SQRT_2).abs() < 1e-12);
        // The box ends at the border of the image, the outline does not.
        let view = scene.view(&scene.detections[0]);
        let cut_off: Vec<usize> = (0..8).filter(|&k| view.tangent_lines.unwrap().line(k).end.cut_off).collect();
        assert_eq!(cut_off, [2]);
    }

    #[test]
    fn a_oriented_box_gives_the_lines_of_its_sides() {
        let mut builder = SceneBuilder::new("test");
        builder.add_frame("a", Projection::from_matrix(Matrix3x4::identity()).unwrap(), Some([100.0, 80.0])).unwrap();
        let turned = OrientedBox::new(Vector2::new(85.0, 40.0), Vector2::new(40.0, 10.0), 0.5).unwrap();
        builder.add_detection(&NewDetection { frame: "a", oriented_box: Some(turned), ..Default::default() }).unwrap();
        let scene = builder.build();
        let lines = scene.detections[0].tangent_lines.as_deref().unwrap();
        assert_eq!(lines.count(), 4);
        for (k, line) in lines.lines().enumerate() {
            let angle = 0.5 + std::f64::consts::FRAC_PI_2 * k as f64;
            assert!((line.normal - Vector2::new(angle.cos(), angle.sin())).norm() < 1e-12);
            let farthest = turned.corners().iter().map(|c| line.normal.dot(c)).fold(f64::NEG_INFINITY, f64::max);
            assert!((line.reach - farthest).abs() < 1e-12, "{k}");
        }
        // The corner to the right and down lies outside of the image: between the sides 0 and 1, and 3 and 0.
        let outside: Vec<usize> = (0..4).filter(|&k| turned.corners()[k].x > 98.0).collect();
        assert_eq!((outside, flags(&scene, 0, |end| end.cut_off)), (vec![0, 3], vec![0, 1, 3]));
        assert_eq!(scene.detections[0].bounding_box, turned.bounding_box());
        let ellipse = lines.inscribed_ellipse().unwrap();
        assert!((ellipse.center() - turned.center()).norm() < 1e-12);
        assert!((ellipse.semi_axes() - Vector2::new(20.0, 5.0)).norm() < 1e-12 && ellipse.angle() == 0.5);
    }

    #[test]
    fn points_that_are_no_outline_are_refused() {
        let frame = &scene(&[]).frames[0];
        let error = |corners: &[[f64; 2]]| ImageOutline::new(0, corners, frame).unwrap_err();
        assert_eq!(error(&SQUARE[..2]), OutlineError::TooFewPoints(2));
        assert_eq!(error(&[[0.0, 0.0], [1.0, 2.0], [2.0, 4.0]]), OutlineError::Flat);
        assert_eq!(error(&[[0.0, 0.0], [f64::NAN, 2.0], [2.0, 4.0]]), OutlineError::NotFinite);
        assert_eq!(error(&[[3.0, 3.0]; 5]), OutlineError::Flat);
    }

    #[test]
    fn lines_in_a_lens_are_those_of_the_undistorted_outline() {
        let camera = Camera::new(CameraModel::SimpleRadial, &[100.0, 50.0, 40.0, -0.2]).unwrap();
        let mut builder = SceneBuilder::new("test");
        let pose = CamFromWorld::new(Matrix3x4::identity()).unwrap();
        builder.add_frame_of_camera("a", &camera, &pose, Some([100.0, 80.0])).unwrap();
        let outline = [[70.0, 20.0], [90.0, 20.0], [90.0, 60.0], [70.0, 60.0]];
        builder.add_detection(&NewDetection { frame: "a", outline: Some(&outline), ..Default::default() }).unwrap();
        let turned = OrientedBox::new(Vector2::new(70.0, 40.0), Vector2::new(20.0, 10.0), 0.4).unwrap();
        builder.add_detection(&NewDetection { frame: "a", oriented_box: Some(turned), ..Default::default() }).unwrap();
        let scene = builder.build();
        let lines = scene.detections[0].tangent_lines.as_deref().unwrap();
        // The right edge bulges outwards at its ends, and the left one towards the middle of the image in its middle.
        let corner = camera.undistort_point(&Vector2::new(90.0, 20.0)).unwrap();
        let middle = camera.undistort_point(&Vector2::new(70.0, 40.0)).unwrap();
        assert!((lines.line(0).reach - corner.x).abs() < 1e-9 && (lines.line(4).reach + middle.x).abs() < 1e-9);
        let ellipse = camera.undistort_ellipse(&turned.inscribed_ellipse().unwrap()).unwrap();
        for line in scene.detections[1].tangent_lines.as_deref().unwrap().lines() {
            let [.., offset] = ellipse.tangent_line(&line.normal);
            assert!((line.reach + offset).abs() < 1e-9);
        }
    }
}

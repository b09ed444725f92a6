//! A picture of one frame: its image or a blank sheet, the detections and the outlines of the bodies; as SVG or PNG.

mod places;
mod bitmap;
mod svg;

use std::collections::HashSet;

use image::RgbImage;
use nalgebra::{Matrix3x4, Vector2};
use quadlift::geometry::{Body, Ellipse, Projection};

pub(crate) use crate::colors::Color;
use crate::colors::UNKNOWN;
use crate::data::{Report, ReportBody, ReportFrame};
use crate::labels::Labels;
use crate::outline::{ellipse_points, outline};
use places::{Places, Rectangle};

const REJECTED: Color = [0xe0, 0x10, 0x10];
const BLACK: Color = [0; 3];
const WHITE: Color = [0xff; 3];
/// The sheet below a label.
const DARK: Color = [0x10, 0x14, 0x18];
/// Without an image.
const SHEET: Color = [0xf2, 0xf3, 0xf5];

/// Height of the letters of labels in an image of VGA size, pixels.
const LABEL: f64 = 17.0;

/// Maximum number of pixels of a blank background.
const MAX_PIXELS: f64 = 1e8;

/// How a line is drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stroke {
    /// Color.
    pub color: Color,
    /// Opacity, in [0, 1].
    pub opacity: f64,
    /// Width in pixels.
    pub width: f64,
    /// Lengths of dashes and of the gaps between them, pixels.
    pub dash: Option<[f64; 2]>,
}

/// About how wide a text is: letters are half as wide as high.
fn label_width(text: &str, height: f64) -> f64 {
    0.56 * height * text.chars().count() as f64
}

/// The canvas of a picture. Coordinates are pixels of the frame.
pub(crate) trait Canvas {
    /// Fills a polygon.
    fn fill(&mut self, polygon: &[Vector2<f64>], color: Color, opacity: f64);
    /// Draws a line through points.
    fn line(&mut self, points: &[Vector2<f64>], stroke: &Stroke);
    /// Writes a text whose lower left corner is here.
    fn text(&mut self, place: Vector2<f64>, height: f64, text: &str, color: Color);
}

/// A text on an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// Its lower left corner, pixels.
    pub place: [f64; 2],
    /// Height of its letters, pixels.
    pub height: f64,
    /// What it says.
    pub text: String,
    /// Color of the letters.
    pub color: Color,
}

/// Writes texts on an image.
///
/// # Errors
/// Text of the drawing library.
pub fn write_labels(image: RgbImage, labels: &[Label]) -> Result<RgbImage, String> {
    let mut bitmap = bitmap::Bitmap::new(image);
    for label in labels {
        bitmap.text(Vector2::from(label.place), label.height, &label.text, label.color);
    }
    bitmap.finish()
}

/// The content of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    /// The data (see [`crate::report()`]).
    pub report: &'a Report,
    /// Index of the frame in the report.
    pub frame_index: usize,
    /// The image of the frame in full size; without it the sheet is blank.
    pub image: Option<&'a RgbImage>,
    /// Whether the labels of the objects ([`Labels`]) are written beside their boxes.
    pub labels: bool,
}

impl Picture<'_> {
    /// The picture as an SVG document with an embedded image; empty if there is no such frame.
    ///
    /// # Errors
    /// Text of the encoder of images.
    pub fn svg(&self) -> Result<String, String> {
        let size = self.size();
        let mut canvas = svg::Svg::new(size, self.image)?;
        self.draw(&mut canvas);
        Ok(canvas.finish())
    }

    /// The picture as an image of the size of the frame.
    ///
    /// # Errors
    /// Text of the drawing library, or that a frame without an image is too large.
    pub fn bitmap(&self) -> Result<RgbImage, String> {
        let [width, height] = self.size().map(f64::ceil);
        let sheet = match self.image {
            Some(image) => image.clone(),
            None if width * height > MAX_PIXELS => {
                return Err(format!("the frame has {width} x {height} pixels, too many for a blank image; use SVG"));
            }
            None => RgbImage::from_pixel(width as u32, height as u32, image::Rgb(SHEET)),
        };
        let mut canvas = bitmap::Bitmap::new(sheet);
        self.draw(&mut canvas);
        canvas.finish()
    }

    /// Width and height in pixels.
    fn size(&self) -> [f64; 2] {
        let image = self.image.map(|image| [f64::from(image.width()), f64::from(image.height())]);
        image.or(self.report.frames.get(self.frame_index).map(|frame| frame.size)).unwrap_or([4.0, 3.0])
    }

    /// Bodies first, then truth, then measurements, which must not be hidden, then labels.
    fn draw(&self, canvas: &mut dyn Canvas) {
        let Some(frame) = self.report.frames.get(self.frame_index) else { return };
        // Lines of one pixel in an image of VGA size, wider ones in larger images.
        let pen = (self.size()[0].max(self.size()[1]) / 640.0).max(1.0);
        let stroke = |color, width: f64| Stroke { color, opacity: 1.0, width: width * pen, dash: None };
        let matrix = Matrix3x4::from_row_slice(&frame.projection);
        let Ok(projection) = Projection::from_matrix(matrix) else { return };
        let detected = || frame.detections.object.iter().filter_map(|&index| usize::try_from(index).ok());
        let outline_of = |body: Option<Body>| body.and_then(|body| outline(&projection, &body));
        // What was not detected here, but lies in the picture.
        let known: HashSet<usize> = detected().collect();
        let mut undetected = Vec::new();
        for index in (0..self.report.objects.len()).filter(|index| !known.contains(index)) {
            let Some(shape) = outline_of(self.body(index, |o| &o.body)) else { continue };
            let Some(place) = around(shape.lines.iter().flatten()).filter(|place| self.shows(place)) else { continue };
            shape.lines.iter().for_each(|line| canvas.line(line, &stroke(self.report.color(index), 0.8)));
            undetected.push((index, place));
        }
        for index in detected() {
            let Some(shape) = outline_of(self.body(index, |o| &o.body)) else { continue };
            let color = self.report.color(index);
            shape.faces.iter().for_each(|face| canvas.fill(face, color, 0.3));
            shape.lines.iter().for_each(|line| canvas.line(line, &stroke(color, 1.4)));
        }
        for index in detected() {
            let Some(shape) = outline_of(self.body(index, |o| &o.truth)) else { continue };
            for line in &shape.lines {
                canvas.line(line, &Stroke { opacity: 0.7, ..stroke(WHITE, 1.8) });
                canvas.line(line, &Stroke { dash: Some([2.0 * pen, 3.0 * pen]), ..stroke(BLACK, 1.0) });
            }
        }
        let measured = self.measurements(canvas, frame, pen);
        if self.labels {
            let objects = measured.into_iter().chain(undetected);
            let objects: Vec<_> = objects.map(|(index, place)| (index, self.within(place))).collect();
            self.write_labels(canvas, &objects, pen);
        }
    }

    /// Draws the measurements. Returns where those of objects are.
    fn measurements(&self, canvas: &mut dyn Canvas, frame: &ReportFrame, pen: f64) -> Vec<(usize, Rectangle)> {
        let detections = &frame.detections;
        let style = |row: usize| {
            let color = usize::try_from(detections.object[row]).map_or(UNKNOWN, |index| self.report.color(index));
            let base = Stroke { color, opacity: 1.0, width: 1.5 * pen, dash: None };
            if detections.state[row] == 2 {
                return Stroke { color: REJECTED, dash: Some([6.0 * pen, 4.0 * pen]), ..base };
            }
            base
        };
        let mut lines = Vec::new();
        for (row, edges) in detections.boxes.chunks_exact(4).enumerate() {
            if let &[Some(x0), Some(y0), Some(x1), Some(y1)] = edges {
                let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]];
                lines.push((row, corners.map(Vector2::from).to_vec()));
            }
        }
        for &(row, x, y, a, b, angle) in &detections.ellipses {
            let Ok(ellipse) = Ellipse::new(Vector2::new(x, y), Vector2::new(a, b), angle) else { continue };
            let mut points = ellipse_points(&ellipse);
            points.push(points[0]);
            lines.push((row, points));
        }
        let (mut named, mut places) = (HashSet::new(), Vec::new());
        for (row, line) in &lines {
            // A dark line under the colored one: it can be seen on any image.
            canvas.line(line, &Stroke { color: BLACK, opacity: 0.5, width: 2.8 * pen, dash: None });
            canvas.line(line, &style(*row));
            // A detection with a box and an ellipse is named once.
            if let (Ok(index), Some(place)) = (usize::try_from(detections.object[*row]), around(line))
                && named.insert(*row)
            {
                places.push((index, place));
            }
        }
        places
    }

    /// Writes the labels of objects that are at these places; those for which there is no room are left out.
    fn write_labels(&self, canvas: &mut dyn Canvas, objects: &[(usize, Rectangle)], pen: f64) {
        let category = |index: i64| Some(self.report.categories.get(usize::try_from(index).ok()?)?.as_str());
        let all = self.report.objects.iter();
        let labels = Labels::new(all.map(|object| (object.id.as_str(), category(object.category))));
        let mut places = Places::new(self.size(), objects.iter().map(|(_, place)| *place).collect());
        let height = LABEL * pen;
        let mut placed = Vec::new();
        for &(index, object) in objects {
            let text = labels.of(&self.report.objects[index].id);
            let sheet = [label_width(text, height) + 0.65 * height, 1.25 * height];
            let Some(place) = places.take(object, sheet) else { continue };
            if let Some(line) = between(place, object, 0.5 * height) {
                let stroke = Stroke { color: self.report.color(index), opacity: 1.0, width: 0.7 * pen, dash: None };
                canvas.line(&line, &stroke);
            }
            placed.push((index, text, place));
        }
        // After all lines, which would cross labels.
        for (index, text, [x0, y0, x1, y1]) in placed {
            let corners = |x1: f64| [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(Vector2::from);
            // White on a dark sheet with the object's color at its left: it can be read on any image.
            canvas.fill(&corners(x1), DARK, 0.85);
            canvas.fill(&corners(x0 + 0.2 * height), self.report.color(index), 1.0);
            canvas.text(Vector2::new(x0 + 0.4 * height, y0 + 0.95 * height), height, text, WHITE);
        }
    }

    /// The part of a rectangle that lies in the picture.
    fn within(&self, [x0, y0, x1, y1]: Rectangle) -> Rectangle {
        let [width, height] = self.size();
        let [x0, x1] = [x0, x1].map(|x| x.max(0.0).min(width));
        let [y0, y1] = [y0, y1].map(|y| y.max(0.0).min(height));
        [x0, y0, x1, y1]
    }

    /// Whether a part of a rectangle lies in the picture.
    fn shows(&self, rectangle: &Rectangle) -> bool {
        let [x0, y0, x1, y1] = self.within(*rectangle);
        x0 < x1 && y0 < y1
    }

    fn body(&self, index: usize, of: impl Fn(&crate::data::ReportObject) -> &Option<ReportBody>) -> Option<Body> {
        of(self.report.objects.get(index)?).as_ref().and_then(ReportBody::body)
    }
}

/// The rectangle around points.
fn around<'a>(points: impl IntoIterator<Item = &'a Vector2<f64>>) -> Option<Rectangle> {
    let of = |p: &Vector2<f64>| [p.x, p.y, p.x, p.y];
    let both = |a: Rectangle, b: Rectangle| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
    points.into_iter().map(of).reduce(both)
}

/// The line from a label to its object, if they are farther from each other than `gap`.
fn between([x0, y0, x1, y1]: Rectangle, [a0, b0, a1, b1]: Rectangle, gap: f64) -> Option<[Vector2<f64>; 2]> {
    let middle = Vector2::new(0.5 * (a0 + a1), 0.5 * (b0 + b1));
    let near = |to: Vector2<f64>, low: [f64; 2], high: [f64; 2]| to.sup(&low.into()).inf(&high.into());
    let start = near(middle, [x0, y0], [x1, y1]);
    let end = near(start, [a0, b0], [a1, b1]);
    ((end - start).norm() > gap).then_some([start, end])
}

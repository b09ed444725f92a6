//! A picture of one frame: its image or a blank sheet, the detections and the outlines of the bodies; as SVG or PNG.

mod bitmap;
mod svg;

use image::RgbImage;
use nalgebra::{Matrix3x4, Vector2};
use quadlift::geometry::{Body, Ellipse, Projection};

pub(crate) use crate::colors::Color;
use crate::colors::UNKNOWN;
use crate::data::{Report, ReportBody, ReportFrame};
use crate::labels::Labels;
use crate::outline::{ellipse_points, outline};

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

    /// Bodies first, then truth, then measurements, which must not be hidden.
    fn draw(&self, canvas: &mut dyn Canvas) {
        let Some(frame) = self.report.frames.get(self.frame_index) else { return };
        // Lines of one pixel in an image of VGA size, wider ones in larger images.
        let pen = (self.size()[0].max(self.size()[1]) / 640.0).max(1.0);
        let stroke = |color, width: f64| Stroke { color, opacity: 1.0, width: width * pen, dash: None };
        let matrix = Matrix3x4::from_row_slice(&frame.projection);
        let Ok(projection) = Projection::from_matrix(matrix) else { return };
        let objects = || frame.detections.object.iter().filter_map(|&index| usize::try_from(index).ok());
        for index in objects() {
            let Some(shape) = self.body(index, |o| &o.body).and_then(|body| outline(&projection, &body)) else {
                continue;
            };
            let color = self.report.color(index);
            shape.faces.iter().for_each(|face| canvas.fill(face, color, 0.3));
            shape.lines.iter().for_each(|line| canvas.line(line, &stroke(color, 1.4)));
        }
        for index in objects() {
            let Some(shape) = self.body(index, |o| &o.truth).and_then(|body| outline(&projection, &body)) else {
                continue;
            };
            for line in &shape.lines {
                canvas.line(line, &Stroke { opacity: 0.7, ..stroke(WHITE, 1.8) });
                canvas.line(line, &Stroke { dash: Some([2.0 * pen, 3.0 * pen]), ..stroke(BLACK, 1.0) });
            }
        }
        self.measurements(canvas, frame, pen);
    }

    fn measurements(&self, canvas: &mut dyn Canvas, frame: &ReportFrame, pen: f64) {
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
        for (row, line) in &lines {
            // A dark line under the colored one: it can be seen on any image.
            canvas.line(line, &Stroke { color: BLACK, opacity: 0.5, width: 2.8 * pen, dash: None });
            canvas.line(line, &style(*row));
        }
        if self.labels {
            let mut taken: Vec<[f64; 4]> = Vec::new();
            let mut named = Vec::new();
            let category = |index: i64| Some(self.report.categories.get(usize::try_from(index).ok()?)?.as_str());
            let objects = self.report.objects.iter();
            let labels = Labels::new(objects.map(|object| (object.id.as_str(), category(object.category))));
            for (row, line) in &lines {
                let Ok(index) = usize::try_from(detections.object[*row]) else { continue };
                // A detection with a box and an ellipse is named once.
                if named.contains(row) {
                    continue;
                }
                named.push(*row);
                let text = labels.of(&self.report.objects[index].id);
                let height = LABEL * pen;
                let place = self.label_place(line, text, height, &mut taken);
                // White on a dark sheet with the object's color at its left: it can be read on any image.
                let [x0, y0] = [place.x - 0.4 * height, place.y - 0.95 * height];
                let sheet = |x1: f64| {
                    let y1 = place.y + 0.3 * height;
                    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(Vector2::from)
                };
                canvas.fill(&sheet(place.x + label_width(text, height) + 0.25 * height), DARK, 0.85);
                canvas.fill(&sheet(x0 + 0.2 * height), self.report.color(index), 1.0);
                canvas.text(place, height, text, WHITE);
            }
        }
    }

    /// The lower left corner of a label beside a line: above, below, inside or beside it, without overlap with other
    /// labels.
    fn label_place(&self, line: &[Vector2<f64>], text: &str, height: f64, taken: &mut Vec<[f64; 4]>) -> Vector2<f64> {
        let [width, tall] = self.size();
        let (low, high) = line.iter().fold((line[0], line[0]), |(low, high), p| (low.inf(p), high.sup(p)));
        let wide = label_width(text, height) + 0.65 * height;
        let gap = 0.35 * height;
        let places = [
            [low.x, low.y - gap],
            [low.x, high.y + height + gap],
            [high.x - wide, low.y - gap],
            [high.x - wide, high.y + height + gap],
            [low.x + gap, low.y + height + gap],
            [high.x + gap, low.y + height],
            [low.x - wide - gap, low.y + height],
        ];
        let inside = |[x, y]: [f64; 2]| [x.clamp(0.0, (width - wide).max(0.0)), y.clamp(height.min(tall), tall)];
        let room = |[x, y]: [f64; 2]| [x, y - height, x + wide, y];
        let is_free = |place: &[f64; 2]| {
            let [x0, y0, x1, y1] = room(*place);
            taken.iter().all(|[a0, b0, a1, b1]| x0 >= *a1 || x1 <= *a0 || y0 >= *b1 || y1 <= *b0)
        };
        let place = places.map(inside).into_iter().find(is_free).unwrap_or_else(|| inside(places[0]));
        taken.push(room(place));
        Vector2::from(place)
    }

    fn body(&self, index: usize, of: impl Fn(&crate::data::ReportObject) -> &Option<ReportBody>) -> Option<Body> {
        of(self.report.objects.get(index)?).as_ref().and_then(ReportBody::body)
    }
}

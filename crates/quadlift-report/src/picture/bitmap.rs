//! Pictures as images. They are drawn twice as large and made smaller at the end, which smooths the lines.

use std::sync::OnceLock;

use image::RgbImage;
use image::imageops::{FilterType, resize};
use nalgebra::Vector2;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

use super::{Canvas, Stroke};

/// Images with more pixels than this are drawn in their own size: they are fine enough, and memory is not for free.
const LARGE: u64 = 8_000_000;

/// Height of a line of text in heights of its letters, as CSS and SVG count these.
const LINE: f64 = 1.33;

type Failure = DrawingAreaErrorKind<<BitMapBackend<'static> as DrawingBackend>::ErrorType>;

/// An image that is being drawn. The first error of the drawing library is returned at the end.
pub(super) struct Bitmap {
    image: RgbImage,
    scale: u32,
    failed: Option<String>,
}

impl Bitmap {
    /// Draws on an image.
    pub(super) fn new(sheet: RgbImage) -> Self {
        let scale = if u64::from(sheet.width()) * u64::from(sheet.height()) > LARGE { 1 } else { 2 };
        let (width, height) = (sheet.width() * scale, sheet.height() * scale);
        Self { image: resize(&sheet, width, height, FilterType::Nearest), scale, failed: None }
    }

    /// The image in its own size.
    pub(super) fn finish(self) -> Result<RgbImage, String> {
        if let Some(reason) = self.failed {
            return Err(reason);
        }
        let (width, height) = (self.image.width() / self.scale, self.image.height() / self.scale);
        // The mean of the pixels that fall together.
        Ok(image::imageops::thumbnail(&self.image, width, height))
    }

    fn draw(&mut self, draw: impl FnOnce(&DrawingArea<BitMapBackend<'_>, Shift>) -> Result<(), Failure>) {
        let size = self.image.dimensions();
        let area = BitMapBackend::with_buffer(&mut self.image, size).into_drawing_area();
        if let Err(error) = draw(&area) {
            self.failed.get_or_insert(error.to_string());
        }
    }

    fn place(&self, point: &Vector2<f64>) -> (i32, i32) {
        // Casts saturate: points far outside the image stay outside. Lines of a million pixels would take long.
        let at = |x: f64| (x * f64::from(self.scale)).round().clamp(-1e5, 1e5) as i32;
        (at(point.x), at(point.y))
    }
}

impl Canvas for Bitmap {
    fn fill(&mut self, polygon: &[Vector2<f64>], color: super::Color, opacity: f64) {
        let points: Vec<_> = polygon.iter().map(|p| self.place(p)).collect();
        self.draw(|area| area.draw(&Polygon::new(points, rgb(color).mix(opacity))));
    }

    fn line(&mut self, points: &[Vector2<f64>], stroke: &Stroke) {
        let width = (stroke.width * f64::from(self.scale)).round().max(1.0) as u32;
        let style = rgb(stroke.color).mix(stroke.opacity).stroke_width(width);
        let pieces = match stroke.dash {
            None => vec![points.to_vec()],
            Some(dash) => dashes(points, dash),
        };
        for piece in pieces {
            let points: Vec<_> = piece.iter().map(|p| self.place(p)).collect();
            self.draw(|area| area.draw(&PathElement::new(points, style)));
        }
    }

    fn text(&mut self, place: Vector2<f64>, height: f64, text: &str, color: super::Color) {
        static REGISTERED: OnceLock<bool> = OnceLock::new();
        if !*REGISTERED.get_or_init(|| register_font("sans-serif", FontStyle::Normal, ttf_noto_sans::REGULAR).is_ok()) {
            self.failed.get_or_insert("the font is not readable".to_owned());
            return;
        }
        // The drawing library counts the height of lines, in whose middle the letters stand.
        let size = LINE * height * f64::from(self.scale);
        let (x, y) = self.place(&place);
        let font = ("sans-serif", size).into_font().color(&rgb(color));
        let top = y - (0.5 * size) as i32;
        self.draw(|area| area.draw(&Text::new(text.to_owned(), (x, top), font)));
    }
}

fn rgb([r, g, b]: super::Color) -> RGBColor {
    RGBColor(r, g, b)
}

/// The pieces of a dashed line.
fn dashes(points: &[Vector2<f64>], [on, off]: [f64; 2]) -> Vec<Vec<Vector2<f64>>> {
    let mut pieces = Vec::new();
    let mut piece: Vec<Vector2<f64>> = points.first().copied().into_iter().collect();
    let (mut left, mut drawing) = (on, true);
    for pair in points.windows(2) {
        let length = (pair[1] - pair[0]).norm();
        let mut done = 0.0;
        // An outline that reaches far out of the image is not worth millions of dashes.
        while length - done > left && pieces.len() < 20_000 {
            done += left;
            let point = pair[0] + (pair[1] - pair[0]) * (done / length);
            piece.push(point);
            if drawing {
                pieces.push(std::mem::take(&mut piece));
            }
            piece = vec![point];
            drawing = !drawing;
            left = if drawing { on } else { off };
        }
        left -= length - done;
        piece.push(pair[1]);
    }
    if drawing {
        pieces.push(piece);
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_go_round_corners() {
        let line = [[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]].map(Vector2::from);
        let pieces = dashes(&line, [4.0, 2.0]);
        let ends: Vec<_> = pieces.iter().map(|piece| (piece[0], piece[piece.len() - 1])).collect();
        let v = Vector2::new;
        // 0 to 4 on the first side; 6 to 10 on the second one.
        assert_eq!(ends, [(v(0.0, 0.0), v(4.0, 0.0)), (v(5.0, 1.0), v(5.0, 5.0))]);
    }

    #[test]
    fn letters_stand_on_their_place() {
        for height in [12.0, 34.0] {
            let mut bitmap = Bitmap::new(RgbImage::from_pixel(100, 60, image::Rgb([255; 3])));
            bitmap.text(Vector2::new(10.0, 50.0), height, "HE", [0; 3]);
            let image = bitmap.finish().unwrap();
            let rows = (0..60).filter(|&y| (0..100).any(|x| image.get_pixel(x, y).0[0] < 100));
            let rows: Vec<u32> = rows.collect();
            // Capital letters have 0.7 of the height.
            let (top, bottom) = (f64::from(rows[0]), f64::from(rows[rows.len() - 1] + 1));
            assert!(
                (bottom - 50.0).abs() <= 1.0 && (50.0 - 0.7 * height - top).abs() <= 1.0,
                "{height}: {top} {bottom}"
            );
        }
    }

    #[test]
    fn lines_and_texts_are_drawn_in_the_colors_that_were_asked_for() {
        let mut bitmap = Bitmap::new(RgbImage::from_pixel(100, 40, image::Rgb([255; 3])));
        let red = Stroke { color: [255, 0, 0], opacity: 1.0, width: 2.0, dash: None };
        bitmap.line(&[Vector2::new(5.0, 10.0), Vector2::new(50.0, 10.0)], &red);
        bitmap.fill(&[[5.0, 20.0], [25.0, 20.0], [25.0, 35.0], [5.0, 35.0]].map(Vector2::from), [0, 0, 255], 0.5);
        bitmap.text(Vector2::new(35.0, 38.0), 24.0, "cup", [0, 128, 0]);
        let image = bitmap.finish().unwrap();
        assert_eq!(image.dimensions(), (100, 40));
        let pixel = image.get_pixel(30, 10).0;
        assert!(pixel[0] > 200 && pixel[1] < 100, "{pixel:?}");
        let pixel = image.get_pixel(15, 28).0;
        assert!(pixel[2] > 250 && (100..160).contains(&pixel[0]), "{pixel:?}");
        let green = image.pixels().filter(|p| p[1] > 100 && p[0] < 60 && p[2] < 60).count();
        assert!(green > 5, "{green}");
    }
}

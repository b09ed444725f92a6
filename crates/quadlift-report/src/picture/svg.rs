//! Pictures as SVG documents.

use std::fmt::Write;
use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{ImageFormat, RgbImage};
use nalgebra::Vector2;

use super::{Canvas, Color, SHEET, Stroke};

/// An SVG document in the making.
pub(super) struct Svg(String);

impl Svg {
    /// A document of this size with the image, which is embedded as PNG, or a blank sheet.
    pub(super) fn new([width, height]: [f64; 2], image: Option<&RgbImage>) -> Result<Self, String> {
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} \
             {height}\">\n"
        );
        match image {
            None => {
                let _ = writeln!(text, "<rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>", hex(SHEET));
            }
            Some(image) => {
                let mut png = Cursor::new(Vec::new());
                image.write_to(&mut png, ImageFormat::Png).map_err(|error| error.to_string())?;
                let _ = writeln!(
                    text,
                    "<image width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{}\"/>",
                    STANDARD.encode(png.into_inner())
                );
            }
        }
        Ok(Self(text))
    }

    /// The whole document.
    pub(super) fn finish(self) -> String {
        self.0 + "</svg>\n"
    }

    fn add(&mut self, text: std::fmt::Arguments) {
        // Writing to a String cannot fail.
        let _ = self.0.write_fmt(text);
    }
}

impl Canvas for Svg {
    fn fill(&mut self, polygon: &[Vector2<f64>], color: Color, opacity: f64) {
        self.add(format_args!(
            "<polygon points=\"{}\" fill=\"{}\" fill-opacity=\"{opacity}\"/>\n",
            list(polygon),
            hex(color)
        ));
    }

    fn line(&mut self, points: &[Vector2<f64>], stroke: &Stroke) {
        let dash = stroke.dash.map_or(String::new(), |[on, off]| format!(" stroke-dasharray=\"{on} {off}\""));
        self.add(format_args!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-opacity=\"{}\" stroke-width=\"{}\"{dash}/>\n",
            list(points),
            hex(stroke.color),
            stroke.opacity,
            stroke.width
        ));
    }

    fn text(&mut self, place: Vector2<f64>, height: f64, text: &str, color: Color) {
        self.add(format_args!(
            "<text x=\"{:.2}\" y=\"{:.2}\" font-family=\"sans-serif\" font-size=\"{height:.1}\" fill=\"{}\">{}</text>\n",
            place.x,
            place.y,
            hex(color),
            escaped(text)
        ));
    }
}

fn list(points: &[Vector2<f64>]) -> String {
    points.iter().map(|p| format!("{:.2},{:.2}", p.x, p.y)).collect::<Vec<_>>().join(" ")
}

fn hex([r, g, b]: Color) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Escapes user text for XML; characters that XML cannot represent become a replacement character.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_stay_texts() {
        assert_eq!(escaped("</text><script>&\u{1b}é"), "&lt;/text&gt;&lt;script&gt;&amp;\u{fffd}é");
        let mut svg = Svg::new([10.0, 10.0], None).unwrap();
        svg.text(Vector2::new(1.0, 2.0), 11.0, "<b>", [0; 3]);
        assert!(svg.finish().contains(">&lt;b&gt;</text>"));
    }
}

//! Plots of curves, as SVG and as PNG. No font of the system is needed: text is set in Noto Sans, which is part of the
//! program (in an SVG the reader's own sans-serif font shows it).

use std::sync::OnceLock;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};
use serde_json::{Value, json};

use crate::error::Error;

/// Width and height of a plot, pixels.
const SIZE: (u32, u32) = (720, 420);

/// Width of the column with the names of the curves, pixels.
const LEGEND_WIDTH: u32 = 150;

/// Colors that people with any color vision can tell apart (Okabe and Ito).
const COLORS: [RGBColor; 6] = [
    RGBColor(213, 94, 0),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 158, 115),
    RGBColor(0, 0, 0),
    RGBColor(204, 121, 167),
];

/// A plot of curves over one kind of noise; y is O3D, from 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// Name of the files, without extension.
    pub name: String,
    /// Title.
    pub title: String,
    /// What x is.
    pub x_label: String,
    /// The curves.
    pub curves: Vec<Curve>,
    /// Points of others, to compare with.
    pub marks: Vec<Mark>,
}

/// A curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Points, x ascending.
    pub points: Vec<(f64, f64)>,
}

/// Published points that belong to one curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Name in the legend.
    pub name: String,
    /// Index of the curve whose color they take.
    pub curve: usize,
    /// The points.
    pub points: Vec<(f64, f64)>,
}

impl Plot {
    /// The plot as an SVG document.
    ///
    /// # Errors
    /// [`Error::Plot`] with the message of the drawing library.
    pub fn svg(&self) -> Result<String, Error> {
        let mut document = String::new();
        self.draw(&SVGBackend::with_string(&mut document, SIZE).into_drawing_area())?;
        Ok(document)
    }

    /// The plot as a PNG file.
    ///
    /// # Errors
    /// [`Error::Plot`] with the message of the drawing library.
    pub fn png(&self) -> Result<Vec<u8>, Error> {
        let (width, height) = SIZE;
        let mut pixels = vec![0; 3 * width as usize * height as usize];
        self.draw(&BitMapBackend::with_buffer(&mut pixels, SIZE).into_drawing_area())?;
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let written = encoder.write_header().and_then(|mut writer| {
            writer.write_image_data(&pixels)?;
            writer.finish()
        });
        written.map_err(|error| self.error(&error))?;
        Ok(file)
    }

    /// The points as JSON.
    pub fn to_json(&self) -> Value {
        let curves: Vec<Value> =
            self.curves.iter().map(|curve| json!({ "name": curve.name, "points": curve.points })).collect();
        let marks: Vec<Value> =
            self.marks.iter().map(|mark| json!({ "name": mark.name, "points": mark.points })).collect();
        json!({ "name": self.name, "title": self.title, "x": self.x_label, "curves": curves, "marks": marks })
    }

    fn error(&self, reason: &dyn std::fmt::Display) -> Error {
        Error::Plot { plot: self.name.clone(), reason: reason.to_string() }
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<(), Error> {
        if !font_is_registered() {
            return Err(self.error(&"the font is not readable"));
        }
        self.draw_with_font(area).map_err(|error| self.error(&error))
    }

    fn draw_with_font<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        area.fill(&WHITE)?;
        let (left, right) = area.split_horizontally(SIZE.0 - LEGEND_WIDTH);
        self.draw_curves(&left)?;
        self.draw_legend(&right)?;
        area.present()
    }

    fn draw_curves<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let points = || self.curves.iter().flat_map(|curve| &curve.points);
        let largest = points().map(|point| point.0).fold(0.0, f64::max);
        let decimals = if largest > 1.0 { 0 } else { 2 };
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 19))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(52)
            // Room for the marks at the ends.
            .build_cartesian_2d(-0.02 * largest..1.02 * largest, -0.02..1.02f64)?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc("O3D")
            .x_label_formatter(&|x| format!("{x:.decimals$}"))
            .label_style(("sans-serif", 14))
            .light_line_style(WHITE)
            .bold_line_style(BLACK.mix(0.12))
            .draw()?;
        for (index, curve) in self.curves.iter().enumerate() {
            chart.draw_series(LineSeries::new(curve.points.iter().copied(), color(index).stroke_width(2)))?;
            chart.draw_series(curve.points.iter().map(|point| Circle::new(*point, 2, color(index).filled())))?;
        }
        for mark in &self.marks {
            let style = color(mark.curve).stroke_width(2);
            chart.draw_series(mark.points.iter().map(|point| Circle::new(*point, 6, style)))?;
        }
        Ok(())
    }

    /// The names beside the curves, where they hide none.
    fn draw_legend<B: DrawingBackend>(
        &self,
        area: &DrawingArea<B, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let mut y = 60;
        for (index, curve) in self.curves.iter().enumerate() {
            area.draw(&PathElement::new(vec![(0, y), (18, y)], color(index).stroke_width(2)))?;
            area.draw(&Text::new(curve.name.as_str(), (26, y - 8), ("sans-serif", 14)))?;
            y += 22;
        }
        for mark in &self.marks {
            area.draw(&Circle::new((9, y), 6, color(mark.curve).stroke_width(2)))?;
            area.draw(&Text::new(mark.name.as_str(), (26, y - 8), ("sans-serif", 14)))?;
            y += 22;
        }
        Ok(())
    }
}

fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}

/// Makes the font known to the drawing library, once.
fn font_is_registered() -> bool {
    static REGISTERED: OnceLock<bool> = OnceLock::new();
    *REGISTERED.get_or_init(|| register_font("sans-serif", FontStyle::Normal, ttf_noto_sans::REGULAR).is_ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        Plot {
            name: "rotation".to_owned(),
            title: "Rotation error".to_owned(),
            x_label: "degrees".to_owned(),
            curves: vec![Curve { name: "posterior".to_owned(), points: vec![(0.0, 1.0), (45.0, 0.9)] }],
            marks: vec![Mark { name: "paper, PfD".to_owned(), curve: 0, points: vec![(45.0, 0.15)] }],
        }
    }

    #[test]
    fn a_plot_is_drawn_with_its_labels_and_always_alike() {
        let svg = plot().svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("paper, PfD") && svg.contains("Rotation error"), "{svg}");
        assert_eq!(svg, plot().svg().unwrap());
        let png = plot().png().unwrap();
        assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
        assert_eq!(png, plot().png().unwrap());
        // Text and lines are drawn: a blank picture would be much smaller.
        assert!(png.len() > 5000, "{}", png.len());
    }
}

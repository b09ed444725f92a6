//! Contact sheets: the crops of one object side by side with their masks and ellipses, for visual inspection.

use std::path::Path;

use anyhow::anyhow;
use image::imageops::{FilterType, replace, resize};
use image::{Rgb, RgbImage};
use nalgebra::Vector2;
use quadlift::geometry::Ellipse;
use quadlift::scene::Scene;
use quadlift_io::file_names::file_names;
use quadlift_io::segmentation::{Found, Segmentation};
use quadlift_io::write_png;
use quadlift_report::{Label, write_labels};
use quadlift_segment::Crop;

/// Pixels of the longer side of a crop on the sheet.
const CROP: u32 = 192;
/// Pixels for the name of its frame below each crop, and for the legend above all.
const NAME: u32 = 20;
const LEGEND: u32 = 84;
/// Height of letters in pixels, and most letters of a name: longer ones keep their end.
const LETTERS: f64 = 14.0;
const MAX_LETTERS: usize = 24;
/// Pixels of the frame around each crop.
const FRAME: u32 = 4;
/// Pixels of the place of a crop, with its frame and a gap.
const PLACE: u32 = CROP + 2 * FRAME + 4;
/// Crops side by side.
const COLUMNS: usize = 6;
/// Columns that the legend needs.
const MIN_COLUMNS: usize = 3;
/// Most crops on a sheet; of more views an evenly spread choice is shown.
const MAX_CROPS: usize = 200;

const PAPER: Rgb<u8> = Rgb([24, 24, 24]);
const INK: Rgb<u8> = Rgb([225, 225, 225]);
/// The mask's outline.
const OUTLINE: Rgb<u8> = Rgb([255, 225, 0]);
/// The ellipse in the box.
const BOX_ELLIPSE: Rgb<u8> = Rgb([0, 200, 255]);
/// The ellipse that was found.
const ELLIPSE: Rgb<u8> = Rgb([255, 0, 160]);
/// Frames: a complete mask, one that is cut or touches another, a rejected one, and no result.
const FREE: Rgb<u8> = Rgb([60, 170, 60]);
const CUT: Rgb<u8> = Rgb([255, 150, 0]);
const GIVEN_UP: Rgb<u8> = Rgb([220, 30, 30]);

/// Writes a contact sheet for each object; detections without an object id share one.
pub(crate) fn write_sheets(segmentation: &Segmentation, scene: &Scene, folder: &Path) -> anyhow::Result<()> {
    let frame = |detection: usize| scene.frames[scene.detections[detection].frame_index as usize].id.as_str();
    let ids = segmentation.groups.iter().map(|group| group.object.as_deref().unwrap_or("without_object"));
    for (group, name) in segmentation.groups.iter().zip(&file_names(ids)) {
        let views: Vec<_> = group
            .detections
            .iter()
            .map(|&index| (frame(index), segmentation.crops[index].as_ref(), segmentation.found[index].as_ref()))
            .collect();
        write_png(&folder.join(format!("{name}.png")), &contact_sheet(&views)?)?;
    }
    Ok(())
}

/// Draws the sheet of an object: row by row, in the order of the views, with the names of their frames.
fn contact_sheet(views: &[(&str, Option<&Crop>, Option<&Found>)]) -> anyhow::Result<RgbImage> {
    let shown = views.len().min(MAX_CROPS);
    let columns = shown.clamp(MIN_COLUMNS, COLUMNS);
    let rows = shown.div_ceil(columns).max(1);
    let tall = PLACE + NAME;
    let mut sheet = RgbImage::from_pixel(columns as u32 * PLACE, LEGEND + rows as u32 * tall, PAPER);
    let mut labels = legend();
    for place in 0..shown {
        let (id, crop, found) = views[place * views.len() / shown];
        let frame = match found {
            None => GIVEN_UP,
            Some(found) if found.fallback.is_some() => GIVEN_UP,
            Some(found) if found.contacts.truncated_by_border() || found.contacts.touches_another() => CUT,
            Some(_) => FREE,
        };
        let drawing = crop.map_or_else(|| RgbImage::from_pixel(CROP, CROP, PAPER), |crop| draw(crop, found));
        let [width, height] = [drawing.width(), drawing.height()];
        let framed = RgbImage::from_pixel(width + 2 * FRAME, height + 2 * FRAME, frame);
        // In the middle of its place.
        let (left, top) = ((place % columns) as u32 * PLACE, LEGEND + (place / columns) as u32 * tall);
        let x = i64::from(left) + i64::from((PLACE - framed.width()) / 2);
        let y = i64::from(top) + i64::from((PLACE - framed.height()) / 2);
        replace(&mut sheet, &framed, x, y);
        replace(&mut sheet, &drawing, x + i64::from(FRAME), y + i64::from(FRAME));
        let corner = [f64::from(left) + 8.0, f64::from(top + tall) - 3.0];
        labels.push(label(corner, &shortened(id), INK));
    }
    write_labels(sheet, &labels).map_err(|reason| anyhow!("cannot draw the contact sheet: {reason}"))
}

/// The legend of lines and frames.
fn legend() -> Vec<Label> {
    let lines = [
        ("mask", OUTLINE),
        ("its ellipse", ELLIPSE),
        ("ellipse in the box", BOX_ELLIPSE),
        ("frame: complete and isolated", FREE),
        ("frame: cut off, or touches another object", CUT),
        ("frame: no reliable mask", GIVEN_UP),
    ];
    // Two columns of three.
    let place = |k: usize| [8.0 + 170.0 * (k / 3) as f64, 24.0 + 24.0 * (k % 3) as f64];
    lines.iter().enumerate().map(|(k, (text, color))| label(place(k), text, *color)).collect()
}

fn label(place: [f64; 2], text: &str, Rgb(color): Rgb<u8>) -> Label {
    Label { place, height: LETTERS, text: text.to_owned(), color }
}

/// A name that fits below a crop: the end tells frames apart.
fn shortened(name: &str) -> String {
    let letters: Vec<char> = name.chars().filter(|c| !c.is_control()).collect();
    match letters.len().checked_sub(MAX_LETTERS) {
        None | Some(0) => letters.into_iter().collect(),
        Some(more) => "…".chars().chain(letters.into_iter().skip(more + 1)).collect(),
    }
}

/// A crop in its true proportions, with the mask's outline and the ellipses.
fn draw(crop: &Crop, found: Option<&Found>) -> RgbImage {
    let window = crop.window();
    let size = window.size();
    let side = |x: f64| ((f64::from(CROP) * x / size.max()).round() as u32).max(1);
    let (width, height) = (side(size.x), side(size.y));
    let grid = crop.grid() as u32;
    let colors = crop.colors();
    let small = RgbImage::from_fn(grid, grid, |x, y| Rgb(colors[(y * grid + x) as usize]));
    let mut drawing = resize(&small, width, height, FilterType::Triangle);
    let scale = Vector2::new(f64::from(width), f64::from(height)).component_div(&size);
    let corner = Vector2::new(window.x0(), window.y0());
    draw_ellipse(&mut drawing, &Ellipse::inscribed_in(crop.bounding_box()), &corner, &scale, BOX_ELLIPSE);
    let Some(found) = found else { return drawing };
    let inside = |x: i64, y: i64| {
        let place = Vector2::new(x as f64 + 0.5, y as f64 + 0.5).component_div(&scale) + corner;
        // Casts saturate: what is left of the image is asked for separately.
        place.min() >= 0.0 && found.mask.contains(place.x as u32, place.y as u32)
    };
    for (x, y, pixel) in drawing.enumerate_pixels_mut() {
        let (x, y) = (i64::from(x), i64::from(y));
        if inside(x, y) && [(1, 0), (-1, 0), (0, 1), (0, -1)].iter().any(|(dx, dy)| !inside(x + dx, y + dy)) {
            *pixel = OUTLINE;
        }
    }
    draw_ellipse(&mut drawing, &found.ellipse, &corner, &scale, ELLIPSE);
    drawing
}

fn draw_ellipse(image: &mut RgbImage, ellipse: &Ellipse, corner: &Vector2<f64>, scale: &Vector2<f64>, color: Rgb<u8>) {
    let axis = Vector2::new(ellipse.angle().cos(), ellipse.angle().sin());
    let other = Vector2::new(-axis.y, axis.x);
    const POINTS: usize = 1000;
    for k in 0..POINTS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / POINTS as f64).sin_cos();
        let point = ellipse.center() + axis * (ellipse.semi_axes().x * cos) + other * (ellipse.semi_axes().y * sin);
        let place = (point - corner).component_mul(scale);
        if place.min() >= 0.0 && place.x < f64::from(image.width()) && place.y < f64::from(image.height()) {
            image.put_pixel(place.x as u32, place.y as u32, color);
        }
    }
}

#[cfg(test)]
mod tests {
    use quadlift::geometry::BoundingBox;
    use quadlift_segment::{Contacts, CropOptions, Mask};

    use super::*;

    #[test]
    fn mask_and_ellipses_are_where_they_are_in_the_image() {
        // A wide box: the drawing keeps its proportions, 280 x 140 pixels of the image on 192 x 96.
        let image = RgbImage::from_pixel(400, 300, Rgb([100, 100, 100]));
        let bounding_box = BoundingBox::new([100.0, 100.0, 300.0, 200.0]).unwrap();
        let crop = Crop::cut(&image, &bounding_box, &CropOptions::default()).unwrap();
        let mask = Mask { origin: [150, 120], ..Mask::from_fn(100, 60, |_, _| true) };
        let ellipse = Ellipse::new([200.0, 150.0].into(), [40.0, 20.0].into(), 0.0).unwrap();
        let found = Found { mask, ellipse, confidence: None, fallback: None, contacts: Contacts::default() };
        let drawing = draw(&crop, Some(&found));
        assert_eq!(drawing.dimensions(), (192, 96));
        let at = |x: f64, y: f64| {
            *drawing.get_pixel(((x - 60.0) * 192.0 / 280.0) as u32, ((y - 80.0) * 96.0 / 140.0) as u32)
        };
        assert_eq!(at(299.9, 150.0), BOX_ELLIPSE);
        assert_eq!(at(239.9, 150.0), ELLIPSE);
        assert_eq!(at(200.0, 120.3), OUTLINE);
        assert_eq!((at(200.0, 150.0), at(70.0, 90.0)), (Rgb([100; 3]), Rgb([100; 3])));
    }

    #[test]
    fn sheets_have_a_place_for_each_view_and_no_more_than_fit() {
        let size = |views: usize| contact_sheet(&vec![("7", None, None); views]).unwrap().dimensions();
        let of = |columns: u32, rows: u32| (columns * PLACE, LEGEND + rows * (PLACE + NAME));
        assert_eq!(size(1), of(3, 1));
        assert_eq!(size(8), of(6, 2));
        assert_eq!(size(5000), of(6, 34));
    }

    #[test]
    fn frames_are_named_below_their_crops_and_the_legend_stands_above() {
        let sheet = |name: &str| contact_sheet(&[(name, None, None)]).unwrap();
        let (one, other) = (sheet("000001"), sheet("000888"));
        let differ = |rows: std::ops::Range<u32>| {
            rows.flat_map(|y| (0..PLACE).map(move |x| (x, y)))
                .filter(|&(x, y)| one.get_pixel(x, y) != other.get_pixel(x, y))
                .count()
        };
        assert!(differ(LEGEND + PLACE..LEGEND + PLACE + NAME) > 20);
        assert_eq!(differ(0..LEGEND + PLACE), 0);
        let yellow = (0..LEGEND).flat_map(|y| (0..PLACE).map(move |x| (x, y))).filter(|&(x, y)| {
            let Rgb([r, g, b]) = *one.get_pixel(x, y);
            r > 150 && g > 130 && b < 90
        });
        assert!(yellow.count() > 30, "the outline of the mask is explained in its color");
        let short = shortened("a/very/long/path/to/the/frame_000012");
        assert!(
            short.chars().count() == MAX_LETTERS && short.starts_with('…') && short.ends_with("frame_000012"),
            "{short}"
        );
    }
}

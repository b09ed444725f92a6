//! The crop of a detection: its box, enlarged, on a small grid that is the same for all crops of an object.

use image::RgbImage;
use nalgebra::Vector2;
use quadlift::geometry::BoundingBox;

use crate::mask::Mask;
use crate::resample::taps;

/// Options of crops. All crops of one object must use the same options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CropOptions {
    /// Pixels of the grid along each side, 8 to 256.
    pub grid: usize,
    /// What the crop shows beyond the box, on each side, in parts of the box's width or height, 0.05 to 1.
    pub margin: f64,
}

impl Default for CropOptions {
    fn default() -> Self {
        Self { grid: 64, margin: 0.2 }
    }
}

/// Why there is no crop.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CropError {
    /// A side of the box is shorter than a hundredth of a pixel.
    #[error("the box [{}, {}, {}, {}] is too small", .0[0], .0[1], .0[2], .0[3])]
    TooSmall([f64; 4]),
    /// Nothing of the box (or only a sliver) lies in the image.
    #[error("the box [{}, {}, {}, {}] lies outside the image of {width} x {height} pixels",
        edges[0], edges[1], edges[2], edges[3])]
    OutsideImage {
        /// The box.
        edges: [f64; 4],
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
    },
    /// The options are outside of their ranges.
    #[error("a grid of {} pixels and a margin of {}; expected a grid of 8 to 256 and a margin of 0.05 to 1", .0.grid, .0.margin)]
    Options(CropOptions),
}

/// A crop: a window of the image, resampled to a grid.
///
/// Row-major; grid pixel i covers [i, i + 1) of the grid's coordinates, as image pixels do of the image's. It needs
/// three bytes for each pixel of the grid and does not refer to the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Crop {
    options: CropOptions,
    bounding_box: BoundingBox,
    window: BoundingBox,
    image_size: [u32; 2],
    colors: Vec<[u8; 3]>,
}

impl Crop {
    /// Cuts the crop of a box out of an image.
    ///
    /// Parts of the window outside the image repeat the border and count as not visible.
    ///
    /// # Errors
    /// [`CropError`] if the box or the options are invalid or if the box is outside the image.
    pub fn cut(image: &RgbImage, bounding_box: &BoundingBox, options: &CropOptions) -> Result<Self, CropError> {
        if !(8..=256).contains(&options.grid) || !(0.05..=1.0).contains(&options.margin) {
            return Err(CropError::Options(*options));
        }
        let edges = bounding_box.edges();
        let size = bounding_box.size();
        if size.min() < 0.01 {
            return Err(CropError::TooSmall(edges));
        }
        let beyond = size * options.margin;
        let (width, height) = image.dimensions();
        let outside = CropError::OutsideImage { edges, width, height };
        let around = [edges[0] - beyond.x, edges[1] - beyond.y, edges[2] + beyond.x, edges[3] + beyond.y];
        let Ok(window) = BoundingBox::new(around) else { return Err(outside) };
        let mut crop = Self {
            options: *options,
            bounding_box: *bounding_box,
            window,
            image_size: [width, height],
            colors: vec![],
        };
        let shows_box = window.size().iter().all(|x| x.is_finite())
            && crop.seen_columns().iter().zip(&crop.columns_of_box()).any(|(seen, of_box)| *seen && *of_box)
            && crop.seen_rows().iter().zip(&crop.rows_of_box()).any(|(seen, of_box)| *seen && *of_box);
        if !shows_box {
            return Err(outside);
        }
        crop.colors = resampled(image, &window, options.grid);
        Ok(crop)
    }

    /// The options of the crop.
    pub fn options(&self) -> &CropOptions {
        &self.options
    }

    /// Pixels of the grid along each side.
    pub fn grid(&self) -> usize {
        self.options.grid
    }

    /// The box of the detection, in the image.
    pub fn bounding_box(&self) -> &BoundingBox {
        &self.bounding_box
    }

    /// The window of the crop in the image.
    pub fn window(&self) -> &BoundingBox {
        &self.window
    }

    /// Width and height of the image in pixels.
    pub fn image_size(&self) -> [u32; 2] {
        self.image_size
    }

    /// The colors (sRGB) of the grid's pixels, row by row.
    pub fn colors(&self) -> &[[u8; 3]] {
        &self.colors
    }

    /// Size of a grid pixel in image pixels, along both axes: a point g of the grid is at `window.x0y0 + scale * g`.
    pub fn scale(&self) -> Vector2<f64> {
        self.window.size() / self.options.grid as f64
    }

    /// Maps a point of the grid to the image.
    pub fn to_image(&self, point: &Vector2<f64>) -> Vector2<f64> {
        point.component_mul(&self.scale()) + Vector2::new(self.window.x0(), self.window.y0())
    }

    /// Whether the center of each grid pixel lies in the image, row by row.
    pub fn seen(&self) -> Vec<bool> {
        product(&self.seen_rows(), &self.seen_columns())
    }

    /// Whether the center of each grid pixel lies in the detection's box, row by row.
    pub fn in_box(&self) -> Vec<bool> {
        product(&self.rows_of_box(), &self.columns_of_box())
    }

    fn seen_columns(&self) -> Vec<bool> {
        within(self.window.x0(), self.scale().x, self.options.grid, 0.0, f64::from(self.image_size[0]))
    }

    fn seen_rows(&self) -> Vec<bool> {
        within(self.window.y0(), self.scale().y, self.options.grid, 0.0, f64::from(self.image_size[1]))
    }

    fn columns_of_box(&self) -> Vec<bool> {
        within(self.window.x0(), self.scale().x, self.options.grid, self.bounding_box.x0(), self.bounding_box.x1())
    }

    fn rows_of_box(&self) -> Vec<bool> {
        within(self.window.y0(), self.scale().y, self.options.grid, self.bounding_box.y0(), self.bounding_box.y1())
    }

    /// The mask in the image of pixels of the grid (`grid * grid` entries, row by row; missing ones are outside).
    ///
    /// An image pixel belongs to it where the linear interpolation between the grid's pixel centers (1 inside, 0
    /// outside) exceeds 1/2 at its own center.
    pub fn mask_in_image(&self, inside: &[bool]) -> Mask {
        let (xs, first_x) = interpolation(self.window.x0(), self.window.x1(), self.scale().x, self.image_size[0]);
        let (ys, first_y) = interpolation(self.window.y0(), self.window.y1(), self.scale().y, self.image_size[1]);
        let grid = self.options.grid as i64;
        let at = |column: i64, row: i64| {
            let known = (0..grid).contains(&column) && (0..grid).contains(&row);
            let index = if known { (row * grid + column) as usize } else { usize::MAX };
            if inside.get(index).copied().unwrap_or(false) { 1.0 } else { 0.0 }
        };
        let mut pixels = Vec::with_capacity(xs.len() * ys.len());
        for &(row, v) in &ys {
            // The interpolation in y first, once for each grid column.
            let blended: Vec<f64> = (-1..=grid).map(|c| (1.0 - v) * at(c, row) + v * at(c, row + 1)).collect();
            pixels.extend(xs.iter().map(|&(column, u)| {
                let index = (column + 1) as usize;
                (1.0 - u) * blended[index] + u * blended.get(index + 1).copied().unwrap_or(0.0) > 0.5
            }));
        }
        let origin = [first_x, first_y];
        Mask { origin, width: xs.len() as u32, height: ys.len() as u32, inside: pixels }.trimmed()
    }
}

/// Whether `start + (i + 1/2) step` lies in `low .. high`, for i in `0 .. count`.
fn within(start: f64, step: f64, count: usize, low: f64, high: f64) -> Vec<bool> {
    (0..count).map(|i| start + (i as f64 + 0.5) * step).map(|x| (low..high).contains(&x)).collect()
}

fn product(rows: &[bool], columns: &[bool]) -> Vec<bool> {
    rows.iter().flat_map(|&row| columns.iter().map(move |&column| row && column)).collect()
}

/// For each image pixel of one axis whose center is between `start` and `end`: the grid pixel before it (from -1) and
/// how far it is on the way to the next one; and the first image pixel.
fn interpolation(start: f64, end: f64, step: f64, size: u32) -> (Vec<(i64, f64)>, u32) {
    let first = (start - 0.5).ceil().clamp(0.0, f64::from(size)) as u32;
    let stop = (end - 0.5).floor().clamp(-1.0, f64::from(size) - 1.0) + 1.0;
    let count = ((end - start) / step).round() as i64;
    let cells = (first..stop as u32)
        .map(|pixel| {
            let position = (f64::from(pixel) + 0.5 - start) / step - 0.5;
            let before = position.floor();
            ((before as i64).clamp(-1, count - 1), position - before)
        })
        .collect();
    (cells, first)
}

/// The colors of a window on a grid: the mean color of each grid pixel's area.
fn resampled(image: &RgbImage, window: &BoundingBox, grid: usize) -> Vec<[u8; 3]> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let columns = taps(window.x0(), window.x1(), grid, width);
    let rows = taps(window.y0(), window.y1(), grid, height);
    // Each image row is shrunk once and added to the grid rows that it takes part in.
    let mut sums = vec![[0.0f32; 3]; grid * grid];
    let mut shrunk = vec![[0.0f32; 3]; grid];
    let first = rows.iter().map(|taps| taps.first).min().unwrap_or(0);
    let stop = rows.iter().map(|taps| taps.first + taps.weights.len()).max().unwrap_or(0);
    let mut next = 0;
    for (y, pixels) in image.as_raw().chunks_exact(3 * width.max(1)).enumerate().take(stop).skip(first) {
        for (cell, taps) in shrunk.iter_mut().zip(&columns) {
            *cell = [0.0; 3];
            for (weight, pixel) in taps.weights.iter().zip(pixels[3 * taps.first..].chunks_exact(3)) {
                for c in 0..3 {
                    cell[c] += weight * f32::from(pixel[c]);
                }
            }
        }
        // Rows whose pixels all lie above are done; the remaining ones start in the order of their pixels.
        while next < grid && rows[next].first + rows[next].weights.len() <= y {
            next += 1;
        }
        for (row, taps) in rows.iter().enumerate().skip(next).take_while(|(_, taps)| taps.first <= y) {
            let Some(&weight) = taps.weights.get(y - taps.first) else { continue };
            for (sum, cell) in sums[row * grid..(row + 1) * grid].iter_mut().zip(&shrunk) {
                for c in 0..3 {
                    sum[c] += weight * cell[c];
                }
            }
        }
    }
    // `as` saturates and rounds towards zero.
    sums.iter().map(|sum| sum.map(|c| (c + 0.5) as u8)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;
    use proptest::prelude::*;

    /// Red rises with x, green with y, blue is constant.
    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| Rgb([x as u8, y as u8, 77]))
    }

    fn cut(image: &RgbImage, edges: [f64; 4]) -> Result<Crop, CropError> {
        Crop::cut(image, &BoundingBox::new(edges).unwrap(), &CropOptions::default())
    }

    #[test]
    fn the_colors_are_those_of_the_place() {
        let image = ramp(200, 150);
        for edges in [[50.0, 40.0, 150.0, 100.0], [80.5, 70.25, 84.0, 71.25], [60.0, 60.0, 61.0, 61.0]] {
            let crop = cut(&image, edges).unwrap();
            for (index, color) in crop.colors().iter().enumerate() {
                let center = Vector2::new((index % 64) as f64 + 0.5, (index / 64) as f64 + 0.5);
                let place = crop.to_image(&center);
                // A pixel of value v has its center at v + 1/2; a level is rounded by 1/2.
                let expected = [place.x - 0.5, place.y - 0.5, 77.0];
                for (found, expected) in color.iter().zip(expected) {
                    assert!((f64::from(*found) - expected).abs() < 0.51, "{edges:?} {place} {color:?}");
                }
            }
        }
    }

    #[test]
    fn what_lies_outside_of_the_image_is_not_seen() {
        let image = ramp(100, 80);
        let crop = cut(&image, [-30.0, 20.0, 30.0, 60.0]).unwrap();
        let seen = crop.seen();
        // The window is [-42, 42]: the left half of the columns.
        assert!((0..64 * 64).all(|i| seen[i] == (i % 64 >= 32)));
        assert_eq!(crop.colors()[32 * 64][0], 0);
        assert!(crop.mask_in_image(&vec![true; 64 * 64]).origin[0] == 0);
        for edges in
            [[-60.0, 20.0, -1.0, 60.0], [100.0, 0.0, 120.0, 20.0], [1e9, 1e9, 2e9, 2e9], [0.0, 80.0, 1.0, 81.0]]
        {
            assert!(matches!(cut(&image, edges), Err(CropError::OutsideImage { .. })), "{edges:?}");
        }
        // Far larger than the image: seen in the middle.
        let large = cut(&image, [-1e5, -1e5, 1e5, 1e5]);
        assert!(large.is_err() || large.unwrap().colors().len() == 64 * 64);
        assert!(matches!(cut(&RgbImage::new(0, 0), [0.0, 0.0, 5.0, 5.0]), Err(CropError::OutsideImage { .. })));
        assert!(matches!(cut(&image, [5.0, 5.0, 5.001, 6.0]), Err(CropError::TooSmall(_))));
        assert!(matches!(cut(&image, [-1e308, 0.0, 1e308, 5.0]), Err(CropError::OutsideImage { .. })));
        let options = CropOptions { grid: 4, margin: 0.2 };
        let error = Crop::cut(&image, crop.bounding_box(), &options).unwrap_err();
        assert!(error.to_string().contains("a grid of 4 pixels"), "{error}");
    }

    #[test]
    fn the_box_is_the_middle_of_the_crop() {
        let crop = cut(&ramp(200, 200), [50.0, 40.0, 150.0, 100.0]).unwrap();
        let of_box = crop.in_box();
        let inside = |c: usize| (c as f64 + 0.5) / 64.0 > 0.2 / 1.4 && (c as f64 + 0.5) / 64.0 < 1.2 / 1.4;
        assert!((0..64 * 64).all(|i| of_box[i] == (inside(i % 64) && inside(i / 64))));
    }

    #[test]
    fn a_disc_on_the_grid_is_an_ellipse_in_the_image() {
        let crop = cut(&ramp(300, 300), [100.0, 50.0, 200.0, 250.0]).unwrap();
        let disc: Vec<bool> =
            (0..64 * 64).map(|i| (i % 64 - 32i32).pow(2) + (i / 64 - 32i32).pow(2) <= 20 * 20).collect();
        let mask = crop.mask_in_image(&disc);
        let scale = crop.scale();
        let area = disc.iter().filter(|&&inside| inside).count() as f64 * scale.x * scale.y;
        assert!((mask.count() as f64 / area - 1.0).abs() < 0.01, "{} {area}", mask.count());
        let center = mask.bounding_box().unwrap().center() - crop.to_image(&Vector2::new(32.5, 32.5));
        assert!(center.amax() <= 0.5, "{center}");
    }

    proptest! {
        #[test]
        fn masks_lie_in_the_image(
            x in -20.0..100.0f64, y in -20.0..100.0f64, w in 0.02..300.0f64, h in 0.02..300.0f64,
        ) {
            if let Ok(crop) = cut(&ramp(100, 90), [x, y, x + w, y + h]) {
                let mask = crop.mask_in_image(&vec![true; 64 * 64]);
                if let Some([_, _, right, bottom]) = mask.extent() {
                    prop_assert!(right <= 100 && bottom <= 90);
                }
            }
        }
    }
}

//! Masks as polygons: COCO's other form.

use nalgebra::{Matrix2, Vector2};

use crate::hull::ConvexHull;
use crate::mask::Mask;
use crate::moments::Moments;

/// Most crossings of edges with rows of pixels, and most pixels in the boxes of all polygons of a mask: about a second. The
/// outline of an object has at most as many as its box has pixels.
const MAX_STEPS: u64 = 1 << 28;

/// Why lists of numbers are not valid polygons.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PolygonError {
    /// A list [x, y, x, y, ...] has an odd number of numbers.
    #[error("polygon {part} has {count} numbers; expected an even number [x, y, x, y, ...]")]
    Odd {
        /// Index of the polygon, from 0.
        part: usize,
        /// How many numbers it has.
        count: usize,
    },
    /// A polygon has fewer than three points.
    #[error("polygon {part} has {points} points; expected three or more")]
    TooFewPoints {
        /// Index of the polygon, from 0.
        part: usize,
        /// How many points it has.
        points: usize,
    },
    /// A polygon holds a number that is not finite.
    #[error("polygon {part} holds a number that is not finite")]
    NotFinite {
        /// Index of the polygon, from 0.
        part: usize,
    },
    /// The polygons cross the rows of pixels, or cover the image, too often.
    #[error(
        "the polygons cross the rows of the image, or cover its pixels, more than {MAX_STEPS} times; expected outlines"
    )]
    TooComplex,
}

/// A region of the image: the union of one or several polygons, as in COCO. None of them is a hole, whatever its
/// direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygons {
    parts: Vec<Vec<Vector2<f64>>>,
}

impl Polygons {
    /// Checked polygons from COCO's form: a list `[x, y, x, y, ...]` in pixels for each.
    ///
    /// # Errors
    /// [`PolygonError`] for the first list that is not a polygon.
    pub fn new(parts: &[Vec<f64>]) -> Result<Self, PolygonError> {
        let polygon = |(part, numbers): (usize, &Vec<f64>)| {
            if numbers.len() % 2 != 0 {
                return Err(PolygonError::Odd { part, count: numbers.len() });
            }
            if numbers.len() < 6 {
                return Err(PolygonError::TooFewPoints { part, points: numbers.len() / 2 });
            }
            if !numbers.iter().all(|x| x.is_finite()) {
                return Err(PolygonError::NotFinite { part });
            }
            Ok(numbers.chunks_exact(2).map(|p| Vector2::new(p[0], p[1])).collect())
        };
        Ok(Self { parts: parts.iter().enumerate().map(polygon).collect::<Result<_, _>>()? })
    }

    /// The corners of each polygon in pixels; the last one is joined to the first.
    pub fn parts(&self) -> &[Vec<Vector2<f64>>] {
        &self.parts
    }

    /// The window `[x0, y0, x1, y1]` (end not included) of an image of this size that holds the pixels whose centers lie
    /// in the region.
    pub fn window(&self, width: u32, height: u32) -> [u32; 4] {
        self.parts.iter().fold([width, height, 0, 0], |all, part| {
            let [x0, y0, x1, y1] = window(part, width, height);
            [all[0].min(x0), all[1].min(y0), all[2].max(x1), all[3].max(y1)]
        })
    }

    /// The pixels of an image of this size whose centers lie in the region, in the smallest window that holds them.
    /// Where a polygon crosses itself, the even-odd rule holds.
    ///
    /// # Errors
    /// [`PolygonError::TooComplex`] when edges cross rows of pixels, or boxes of polygons hold pixels, more often than
    /// 2^28 times; such polygons are not the outline of an object.
    pub fn to_mask(&self, width: u32, height: u32) -> Result<Mask, PolygonError> {
        let [left, top, right, bottom] = self.window(width, height);
        if left >= right || top >= bottom {
            return Ok(Mask::default());
        }
        let windows: Vec<[u32; 4]> = self.parts.iter().map(|part| window(part, width, height)).collect();
        let area = |[x0, y0, x1, y1]: [u32; 4]| u64::from(x1.saturating_sub(x0)) * u64::from(y1.saturating_sub(y0));
        let edges = || self.parts.iter().flat_map(|part| edges(part));
        let crossings: u64 = edges().map(|(a, b)| rows(&a, &b, height).len() as u64).sum();
        if crossings.max(windows.iter().copied().map(area).sum()) > MAX_STEPS {
            return Err(PolygonError::TooComplex);
        }
        let mut mask = Mask { origin: [left, top], width: right - left, height: bottom - top, ..Mask::default() };
        mask.inside = vec![false; mask.width as usize * mask.height as usize];
        // Whether an odd number of edges begins at a pixel of a row.
        let mut toggles = Vec::new();
        for (part, [x0, y0, x1, y1]) in self.parts.iter().zip(windows) {
            if x0 >= x1 || y0 >= y1 {
                continue;
            }
            // An edge to the right of all pixels begins at one more.
            let stride = (x1 - x0) as usize + 1;
            toggles.clear();
            toggles.resize(stride * (y1 - y0) as usize, false);
            for (a, b) in self::edges(part) {
                for row in rows(&a, &b, height) {
                    let y = f64::from(row) + 0.5;
                    let x = first_center(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x), width).clamp(x0, x1);
                    toggles[(row - y0) as usize * stride + (x - x0) as usize] ^= true;
                }
            }
            let rows = mask.inside.chunks_exact_mut(mask.width as usize).skip((y0 - top) as usize);
            for (row, toggles) in rows.zip(toggles.chunks_exact(stride)) {
                let mut inside = false;
                for (pixel, toggle) in row[(x0 - left) as usize..(x1 - left) as usize].iter_mut().zip(toggles) {
                    inside ^= toggle;
                    *pixel |= inside;
                }
            }
        }
        Ok(mask.trimmed())
    }

    /// The moments of the region by Green's theorem, exact and without a raster; also of what lies outside of the
    /// image. `None` if it has no area.
    ///
    /// Where two polygons overlap, or one crosses itself, the overlap counts more than once; [`Polygons::to_mask`] is
    /// right there too.
    pub fn moments(&self) -> Option<Moments> {
        let origin = *self.parts.first()?.first()?;
        let (mut area, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for part in &self.parts {
            let (mut part_area, mut part_first, mut part_second) = (0.0, Vector2::zeros(), Matrix2::zeros());
            for (a, b) in edges(part) {
                // The triangle between the edge and the origin, which lies near: nothing large cancels.
                let (a, b) = (a - origin, b - origin);
                let twice = a.perp(&b);
                part_area += twice / 2.0;
                part_first += (a + b) * (twice / 6.0);
                let sum = a + b;
                part_second += (a * a.transpose() + b * b.transpose() + sum * sum.transpose()) * (twice / 24.0);
            }
            let sign = part_area.signum();
            area += sign * part_area;
            first += part_first * sign;
            second += part_second * sign;
        }
        let center = first / area;
        let moments =
            Moments { area, center: center + origin, covariance: second / area - center * center.transpose() };
        (area > 0.0 && moments.covariance.iter().all(|x| x.is_finite())).then_some(moments)
    }

    /// The convex hull of the region; `None` if it has no area.
    pub fn hull(&self) -> Option<ConvexHull> {
        ConvexHull::of_points(self.parts.concat())
    }
}

/// The edges of a polygon.
fn edges(part: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    part.iter().copied().zip(part.iter().copied().cycle().skip(1))
}

/// The rows of an image of this height whose centers an edge crosses.
fn rows(a: &Vector2<f64>, b: &Vector2<f64>, height: u32) -> std::ops::Range<u32> {
    first_center(a.y.min(b.y), height)..first_center(a.y.max(b.y), height)
}

/// The window `[x0, y0, x1, y1]` of an image of this size that holds the pixels of a polygon; its end is not after its start
/// where there are none.
fn window(part: &[Vector2<f64>], width: u32, height: u32) -> [u32; 4] {
    part.iter().fold([width, height, 0, 0], |all, point| {
        let [x, y] = [first_center(point.x, width), first_center(point.y, height)];
        [all[0].min(x), all[1].min(y), all[2].max(x), all[3].max(y)]
    })
}

/// The first pixel whose center is at or after a coordinate, from 0 to `size`.
fn first_center(x: f64, size: u32) -> u32 {
    // The cast saturates.
    ((x - 0.5).ceil() as u32).min(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::moments::PixelTerm;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn wrong_lists_are_named() {
        let error = |parts: &[Vec<f64>]| Polygons::new(parts).unwrap_err().to_string();
        let good = vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
        assert_eq!(error(&[vec![1.0; 7]]), "polygon 0 has 7 numbers; expected an even number [x, y, x, y, ...]");
        assert_eq!(error(&[good.clone(), vec![1.0; 4]]), "polygon 1 has 2 points; expected three or more");
        assert_eq!(error(&[vec![f64::NAN; 6]]), "polygon 0 holds a number that is not finite");
        assert!(Polygons::new(&[good]).is_ok());
    }

    #[test]
    fn a_triangle_has_the_moments_of_the_textbook() {
        // Right-angled, legs 6 and 3: variance leg^2 / 18, covariance -(product of the legs) / 36.
        let forward = vec![1000.0, 500.0, 1006.0, 500.0, 1000.0, 503.0];
        let backward = vec![1000.0, 500.0, 1000.0, 503.0, 1006.0, 500.0];
        for part in [forward, backward] {
            let moments = Polygons::new(&[part]).unwrap().moments().unwrap();
            assert!((moments.area - 9.0).abs() < 1e-12);
            assert!((moments.center - Vector2::new(1002.0, 501.0)).norm() < 1e-9);
            assert!((moments.covariance - Matrix2::new(2.0, -0.5, -0.5, 0.5)).amax() < 1e-9);
        }
    }

    #[test]
    fn regions_without_area_have_no_moments() {
        let flat = Polygons::new(&[vec![0.0, 0.0, 4.0, 4.0, 8.0, 8.0]]).unwrap();
        assert_eq!((flat.moments(), flat.hull(), flat.to_mask(20, 20).unwrap().count()), (None, None, 0));
        let none = Polygons::new(&[]).unwrap();
        assert_eq!((none.moments(), none.hull(), none.to_mask(20, 20).unwrap()), (None, None, Mask::default()));
        let huge = Polygons::new(&[vec![1e300, 0.0, -1e300, 1e300, 0.0, -1e300]]).unwrap();
        assert_eq!(huge.moments(), None);
        assert_eq!(huge.to_mask(3, 2).unwrap().count(), 6);
    }

    #[test]
    fn the_raster_is_that_of_the_even_odd_rule_at_each_center() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        for _ in 0..200 {
            let mut coordinate = || {
                let x: f64 = rng.random_range(-5.0..30.0);
                // Some on centers and borders of pixels.
                if rng.random_bool(0.3) { (2.0 * x).round() / 2.0 } else { x }
            };
            let parts: Vec<Vec<f64>> = (0..3).map(|_| (0..14).map(|_| coordinate()).collect()).collect();
            let polygons = Polygons::new(&parts).unwrap();
            let mask = polygons.to_mask(24, 20).unwrap();
            let inside = |part: &[Vector2<f64>], x: f64, y: f64| {
                let left = |(a, b): &(Vector2<f64>, Vector2<f64>)| {
                    (a.y <= y) != (b.y <= y) && a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x) <= x
                };
                edges(part).filter(left).count() % 2 == 1
            };
            for (x, y) in (0..24).flat_map(|x| (0..20).map(move |y| (x, y))) {
                let (u, v) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let expected = polygons.parts().iter().any(|part| inside(part, u, v));
                assert_eq!(mask.contains(x, y), expected, "{x} {y} of {parts:?}");
            }
        }
    }

    #[test]
    fn what_would_take_for_ever_is_refused() {
        let zigzag = |points: u32| (0..points).flat_map(|k| [f64::from(k % 1000), f64::from(k % 2) * 5000.0]).collect();
        let start = std::time::Instant::now();
        assert_eq!(Polygons::new(&[zigzag(1_000_000)]).unwrap().to_mask(10_000, 10_000), Err(PolygonError::TooComplex));
        let triangle = vec![0.0, 0.0, 1e4, 0.0, 0.0, 1e4];
        assert_eq!(Polygons::new(&vec![triangle; 100]).unwrap().to_mask(10_000, 10_000), Err(PolygonError::TooComplex));
        // Fine outlines of small things stay.
        let circle = |k: u32| [50.0 + 40.0 * f64::from(k).sin(), 50.0 + 40.0 * f64::from(k).cos()];
        assert!(Polygons::new(&[(0..1_000_000).flat_map(circle).collect()]).unwrap().to_mask(100, 100).is_ok());
        assert!(start.elapsed().as_secs() < 10, "{:?}", start.elapsed());
    }

    #[test]
    fn the_image_cuts_the_raster() {
        let square = Polygons::new(&[vec![-5.0, -5.0, 2.0, -5.0, 2.0, 1.0, -5.0, 1.0]]).unwrap();
        assert_eq!(
            square.to_mask(10, 10).unwrap(),
            Mask { origin: [0, 0], width: 2, height: 1, inside: vec![true; 2] }
        );
        let outside = Polygons::new(&[vec![50.0, 0.0, 60.0, 0.0, 60.0, 9.0]]).unwrap();
        assert_eq!(outside.to_mask(10, 10).unwrap(), Mask::default());
    }

    #[test]
    fn overlapping_polygons_are_one_region_in_the_raster_and_neighbors_share_no_pixel() {
        let rectangle = |x0: f64, x1: f64| vec![x0, 0.0, x1, 0.0, x1, 4.0, x0, 4.0];
        let both = Polygons::new(&[rectangle(0.0, 6.0), rectangle(3.0, 9.0)]).unwrap();
        assert_eq!(both.to_mask(20, 20).unwrap().count(), 36);
        for cut in [3.0, 3.3, 3.5, 3.9] {
            let count = |a, b| Polygons::new(&[rectangle(a, b)]).unwrap().to_mask(20, 20).unwrap().count();
            assert_eq!(count(0.0, cut) + count(cut, 9.0), 36);
        }
    }

    #[test]
    fn the_raster_is_the_test_of_every_center() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        for _ in 0..50 {
            let corners: Vec<f64> = (0..14).map(|_| rng.random_range(-3.0..23.0)).collect();
            let polygons = Polygons::new(&[corners]).unwrap();
            let mask = polygons.to_mask(20, 20).unwrap();
            for (x, y) in (0..20).flat_map(|x| (0..20).map(move |y| (x, y))) {
                let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                // A ray to the right, counted edge by edge.
                let crossed = edges(&polygons.parts[0])
                    .filter(|(a, b)| (a.y > py) != (b.y > py))
                    .filter(|(a, b)| px < (b.x - a.x) * (py - a.y) / (b.y - a.y) + a.x)
                    .count();
                assert_eq!(mask.contains(x, y), crossed % 2 == 1, "{x} {y}");
            }
        }
    }

    #[test]
    fn the_moments_of_a_raster_come_near_those_of_the_polygon() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        for _ in 0..20 {
            let star: Vec<f64> = (0..9)
                .flat_map(|k| {
                    let (sin, cos) = (f64::from(k) / 9.0 * std::f64::consts::TAU).sin_cos();
                    let r = rng.random_range(60.0..140.0);
                    [150.0 + r * cos, 150.0 + r * sin]
                })
                .collect();
            let polygons = Polygons::new(&[star]).unwrap();
            let exact = polygons.moments().unwrap();
            let raster = Moments::of_mask(&polygons.to_mask(300, 300).unwrap(), PixelTerm::Centers).unwrap();
            assert!((exact.area / raster.area - 1.0).abs() < 3e-3);
            assert!((exact.center - raster.center).norm() < 0.15);
            assert!((exact.covariance - raster.covariance).amax() < 4e-3 * exact.covariance.amax());
        }
    }

    proptest! {
        #[test]
        fn green_on_the_outline_of_pixels_is_the_sum_over_their_squares(
            rows in proptest::collection::vec((0..6u32, 7..13u32), 1..9), x in 0..500u32, y in 0..500u32,
        ) {
            // Every row has one run, and all of the runs meet: the outline is one ring, down the right and up the left.
            let corner = |x0: u32, row: usize| [f64::from(x + x0), f64::from(y) + row as f64];
            let right = rows.iter().enumerate().flat_map(|(k, run)| [corner(run.1, k), corner(run.1, k + 1)]);
            let left = rows.iter().enumerate().rev().flat_map(|(k, run)| [corner(run.0, k + 1), corner(run.0, k)]);
            let outline = Polygons::new(&[right.chain(left).flatten().collect()]).unwrap();
            let mask = Mask::from_fn(13, rows.len() as u32, |column, row| {
                let run = rows[row as usize];
                (run.0..run.1).contains(&column)
            });
            let mask = Mask { origin: [x, y], ..mask };
            let (green, squares) = (outline.moments().unwrap(), Moments::of_mask(&mask, PixelTerm::Squares).unwrap());
            prop_assert!((green.area - squares.area).abs() < 1e-9);
            prop_assert!((green.center - squares.center).norm() < 1e-9);
            prop_assert!((green.covariance - squares.covariance).amax() < 1e-9);
            prop_assert_eq!(outline.to_mask(1000, 1000).unwrap(), mask.trimmed());
            prop_assert_eq!(outline.hull(), ConvexHull::of_mask(&mask));
        }
    }
}

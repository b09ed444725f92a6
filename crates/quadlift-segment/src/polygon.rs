//! Masks as polygons: COCO's other form.

use nalgebra::{Matrix2, Vector2};

use crate::hull::ConvexHull;
use crate::mask::Mask;
use crate::moments::Moments;

/// Why lists of numbers are no polygons.
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
    /// [`PolygonError`] for the first list that is no polygon.
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

    /// The pixels of an image of this size whose centres lie in the region, in the smallest window that holds them.
    /// Where a polygon crosses itself, the even-odd rule holds.
    pub fn to_mask(&self, width: u32, height: u32) -> Mask {
        // The window of the image that the region can reach: the first centre at or after each end.
        let (mut low, mut high) = ([width, height], [0, 0]);
        for point in self.parts.iter().flatten() {
            for (axis, size) in [width, height].into_iter().enumerate() {
                let pixel = first_center(point[axis], size);
                low[axis] = low[axis].min(pixel);
                high[axis] = high[axis].max(pixel);
            }
        }
        if low[0] >= high[0] || low[1] >= high[1] {
            return Mask::default();
        }
        let [window_width, window_height] = [high[0] - low[0], high[1] - low[1]];
        let mut inside = vec![false; window_width as usize * window_height as usize];
        let mut crossings = Vec::new();
        for (row, y) in inside.chunks_exact_mut(window_width as usize).zip(low[1]..) {
            let y = f64::from(y) + 0.5;
            for part in &self.parts {
                crossings.clear();
                crossings.extend(edges(part).filter(|(a, b)| (a.y <= y) != (b.y <= y)).map(|(a, b)| {
                    first_center(a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x), width).clamp(low[0], high[0]) - low[0]
                }));
                crossings.sort_unstable();
                for pair in crossings.chunks_exact(2) {
                    row[pair[0] as usize..pair[1] as usize].fill(true);
                }
            }
        }
        Mask { origin: low, width: window_width, height: window_height, inside }.trimmed()
    }

    /// The moments of the region by Green's theorem, exact and without a raster; also of what lies outside of the image.
    /// `None` when it has no area.
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

    /// The convex hull of the region; `None` when it has no area.
    pub fn hull(&self) -> Option<ConvexHull> {
        ConvexHull::of_points(self.parts.concat())
    }
}

/// The edges of a polygon.
fn edges(part: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
    part.iter().copied().zip(part.iter().copied().cycle().skip(1))
}

/// The first pixel whose centre is at or after a coordinate, from 0 to `size`.
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
        assert_eq!((flat.moments(), flat.hull(), flat.to_mask(20, 20).count()), (None, None, 0));
        let none = Polygons::new(&[]).unwrap();
        assert_eq!((none.moments(), none.hull(), none.to_mask(20, 20)), (None, None, Mask::default()));
        let huge = Polygons::new(&[vec![1e300, 0.0, -1e300, 1e300, 0.0, -1e300]]).unwrap();
        assert_eq!(huge.moments(), None);
        assert_eq!(huge.to_mask(3, 2).count(), 6);
    }

    #[test]
    fn the_image_cuts_the_raster() {
        let square = Polygons::new(&[vec![-5.0, -5.0, 2.0, -5.0, 2.0, 1.0, -5.0, 1.0]]).unwrap();
        assert_eq!(square.to_mask(10, 10), Mask { origin: [0, 0], width: 2, height: 1, inside: vec![true; 2] });
        let outside = Polygons::new(&[vec![50.0, 0.0, 60.0, 0.0, 60.0, 9.0]]).unwrap();
        assert_eq!(outside.to_mask(10, 10), Mask::default());
    }

    #[test]
    fn overlapping_polygons_are_one_region_in_the_raster_and_neighbours_share_no_pixel() {
        let rectangle = |x0: f64, x1: f64| vec![x0, 0.0, x1, 0.0, x1, 4.0, x0, 4.0];
        let both = Polygons::new(&[rectangle(0.0, 6.0), rectangle(3.0, 9.0)]).unwrap();
        assert_eq!(both.to_mask(20, 20).count(), 36);
        for cut in [3.0, 3.3, 3.5, 3.9] {
            let count = |a, b| Polygons::new(&[rectangle(a, b)]).unwrap().to_mask(20, 20).count();
            assert_eq!(count(0.0, cut) + count(cut, 9.0), 36);
        }
    }

    #[test]
    fn the_raster_is_the_test_of_every_centre() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        for _ in 0..50 {
            let corners: Vec<f64> = (0..14).map(|_| rng.random_range(-3.0..23.0)).collect();
            let polygons = Polygons::new(&[corners]).unwrap();
            let mask = polygons.to_mask(20, 20);
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
            let raster = Moments::of_mask(&polygons.to_mask(300, 300), PixelTerm::Centers).unwrap();
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
            prop_assert_eq!(outline.to_mask(1000, 1000), mask.trimmed());
            prop_assert_eq!(outline.hull(), ConvexHull::of_mask(&mask));
        }
    }
}

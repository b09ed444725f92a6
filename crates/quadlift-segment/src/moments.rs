//! Area, center and second central moments of a mask, and the ellipse with these moments.

use nalgebra::{Matrix2, Vector2};
use quadlift::geometry::Ellipse;

use crate::mask::Mask;

/// How to interpret the pixels of a mask: whether their own extent is included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum PixelTerm {
    /// A pixel is the object's when its center is: the pixels are samples of the outline's inside, and their moments
    /// those of the points. For masks of rendering, of thresholds and of networks; without bias for these.
    #[default]
    Centers,
    /// The object is the union of the pixels' squares: each adds its own second moment, `I / 12`. Exact for areas of
    /// whole pixels; a mask made by testing centers comes out too large (semi-axes 3, 2 read 3.04, 2.06).
    Squares,
}

impl PixelTerm {
    /// What is added to each variance, in squared pixels.
    pub fn variance(self) -> f64 {
        match self {
            Self::Centers => 0.0,
            Self::Squares => 1.0 / 12.0,
        }
    }
}

/// Eigenvalues of a covariance whose ratio is below this are those of a line.
const MIN_RATIO: f64 = 1e-12;

/// Area, center and second central moments of a region of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Area in squared pixels; always positive.
    pub area: f64,
    /// Center of mass in pixels (the center of the first pixel is (0.5, 0.5)).
    pub center: Vector2<f64>,
    /// Second central moments in squared pixels, symmetric.
    pub covariance: Matrix2<f64>,
}

impl Moments {
    /// The moments of the pixels of a mask; `None` if it has none.
    pub fn of_mask(mask: &Mask, term: PixelTerm) -> Option<Self> {
        let mut sums = PixelSums::default();
        for (row, y) in mask.rows().zip(0u64..) {
            let mut column = 0;
            while let Some(skipped) = row[column..].iter().position(|&inside| inside) {
                let start = column + skipped;
                let length = row[start..].iter().position(|&inside| !inside).unwrap_or(row.len() - start);
                sums.add_run(y, start as u64, length as u64);
                column = start + length;
            }
        }
        sums.moments(mask.origin, term)
    }

    /// The moments after the map `x -> diag(scale) x + offset`: from the grid of a crop to the image.
    ///
    /// The covariance is mapped, `D C D`; an ellipse's angle must not be, because unequal factors turn its axes.
    #[must_use]
    pub fn mapped(&self, scale: &Vector2<f64>, offset: &Vector2<f64>) -> Self {
        let d = Matrix2::from_diagonal(scale);
        Self {
            area: self.area * (scale.x * scale.y).abs(),
            center: self.center.component_mul(scale) + offset,
            covariance: d * self.covariance * d,
        }
    }

    /// The ellipse with the same center and second moments, semi-axes `2 sqrt(eigenvalues)`; its area equals that of
    /// the region only if the region is an ellipse. `None` if the region is a point or a line.
    pub fn ellipse(&self) -> Option<Ellipse> {
        let (trace, determinant) = (self.covariance.trace(), self.covariance.determinant());
        // About the ratio of the eigenvalues, where it is small. Written so that NaN is refused too.
        let wide = determinant > MIN_RATIO * trace * trace;
        if wide { Ellipse::from_shape(self.center, &(self.covariance * 4.0)).ok() } else { None }
    }
}

/// Sums over pixels of the powers of their column and row numbers, as whole numbers: exact, so that every way to visit
/// the same pixels gives the same moments.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct PixelSums {
    count: u128,
    x: u128,
    y: u128,
    xx: u128,
    xy: u128,
    yy: u128,
}

impl PixelSums {
    /// Adds the pixels of row `y` with the columns `start .. start + length`.
    pub(crate) fn add_run(&mut self, y: u64, start: u64, length: u64) {
        let (y, start, n) = (u128::from(y), u128::from(start), u128::from(length));
        if n == 0 {
            return;
        }
        // Sums over 0 .. n of 1, k and k^2, then shifted by the start.
        let (first, second) = (n * (n - 1) / 2, n * (n - 1) * (2 * n - 1) / 6);
        let x = n * start + first;
        self.count += n;
        self.x += x;
        self.y += n * y;
        self.xx += n * start * start + 2 * start * first + second;
        self.xy += x * y;
        self.yy += n * y * y;
    }

    /// The same pixels with rows and columns exchanged.
    pub(crate) fn transposed(self) -> Self {
        Self { x: self.y, y: self.x, xx: self.yy, yy: self.xx, ..self }
    }

    /// The moments of the pixels, whose numbers count from `origin`; `None` if there are none.
    pub(crate) fn moments(&self, origin: [u32; 2], term: PixelTerm) -> Option<Moments> {
        if self.count == 0 {
            return None;
        }
        let n = self.count;
        let mean = |sum: u128, origin: u32| (sum + n * u128::from(origin)) as f64 / n as f64 + 0.5;
        // n sum(ab) - sum(a) sum(b) is formed exactly: no digits are lost far from the origin.
        let central = |ab: u128, a: u128, b: u128| ((n * ab) as i128 - (a * b) as i128) as f64 / (n as f64 * n as f64);
        let (xx, yy) = (central(self.xx, self.x, self.x), central(self.yy, self.y, self.y));
        let xy = central(self.xy, self.x, self.y);
        Some(Moments {
            area: n as f64,
            center: Vector2::new(mean(self.x, origin[0]), mean(self.y, origin[1])),
            covariance: Matrix2::new(xx + term.variance(), xy, xy, yy + term.variance()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    /// The moments by their definition.
    fn plain_moments(mask: &Mask) -> (Vector2<f64>, Matrix2<f64>) {
        let points: Vec<_> = mask.pixels().map(|p| Vector2::from(p.map(|x| f64::from(x) + 0.5))).collect();
        let n = points.len() as f64;
        let center = points.iter().sum::<Vector2<f64>>() / n;
        let covariance: Matrix2<f64> = points.iter().map(|p| (p - center) * (p - center).transpose()).sum();
        (center, covariance / n)
    }

    /// The pixels whose centers lie in an ellipse.
    fn rendered(ellipse: &Ellipse, size: u32) -> Mask {
        let inverse = ellipse.shape().try_inverse().unwrap();
        Mask::from_fn(size, size, |column, row| {
            let d = Vector2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) - ellipse.center();
            d.dot(&(inverse * d)) <= 1.0
        })
    }

    #[test]
    fn centers_give_ellipses_without_bias_and_squares_those_of_the_known_size() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let (mut centers, mut squares) = (Vector2::zeros(), Vector2::zeros());
        let n = 4000;
        for _ in 0..n {
            let center = Vector2::from_fn(|_, _| rng.random_range(5.5..6.5));
            let ellipse = Ellipse::new(center, Vector2::new(3.0, 2.0), rng.random_range(0.0..3.0)).unwrap();
            let mask = rendered(&ellipse, 12);
            centers += Moments::of_mask(&mask, PixelTerm::Centers).unwrap().ellipse().unwrap().semi_axes();
            squares += Moments::of_mask(&mask, PixelTerm::Squares).unwrap().ellipse().unwrap().semi_axes();
        }
        let (centers, squares) = (centers / f64::from(n), squares / f64::from(n));
        assert!((centers - Vector2::new(3.0, 1.97)).amax() < 0.01, "{centers}");
        assert!((squares - Vector2::new(3.04, 2.06)).amax() < 0.01, "{squares}");
        assert_eq!(PixelTerm::default(), PixelTerm::Centers);
    }

    #[test]
    fn a_large_ellipse_comes_back() {
        let ellipse = Ellipse::new(Vector2::new(210.3, 190.8), Vector2::new(150.0, 60.0), -0.7).unwrap();
        let moments = Moments::of_mask(&rendered(&ellipse, 400), PixelTerm::Centers).unwrap();
        let back = moments.ellipse().unwrap();
        // About 700 pixels of the border are wrong by half a pixel either way: sqrt(700 / 12) = 8 pixels of area, at an
        // arm of about 100 pixels, out of 28000: standard deviation 0.03 pixels.
        assert!((back.center() - ellipse.center()).norm() < 0.1, "{back:?}");
        assert!((back.angle() - ellipse.angle()).abs() < 1e-3, "{back:?}");
        assert!((back.semi_axes() - ellipse.semi_axes()).norm() < 0.1, "{back:?}");
        assert!((moments.area / (std::f64::consts::PI * 150.0 * 60.0) - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_block_of_squares_has_the_moments_of_the_rectangle() {
        let mask = Mask { origin: [100, 50], width: 6, height: 2, inside: vec![true; 12] };
        let moments = Moments::of_mask(&mask, PixelTerm::Squares).unwrap();
        assert_eq!((moments.area, moments.center), (12.0, Vector2::new(103.0, 51.0)));
        assert!((moments.covariance - Matrix2::new(3.0, 0.0, 0.0, 4.0 / 12.0)).amax() < 1e-14);
    }

    #[test]
    fn degenerate_masks_have_no_ellipse() {
        assert_eq!(Moments::of_mask(&Mask::default(), PixelTerm::Squares), None);
        assert_eq!(Moments::of_mask(&Mask::from_fn(4, 3, |_, _| false), PixelTerm::Centers), None);
        let one = Mask::from_fn(5, 5, |column, row| (column, row) == (3, 1));
        let moments = Moments::of_mask(&one, PixelTerm::Centers).unwrap();
        assert_eq!((moments.area, moments.center), (1.0, Vector2::new(3.5, 1.5)));
        assert_eq!(moments.ellipse(), None);
        let lines: [fn(u32, u32) -> bool; 4] =
            [|_, row| row == 7, |column, _| column == 2, |column, row| column == row, |column, row| row == 3 * column];
        for line in lines {
            let mask = Mask::from_fn(37, 37, line);
            assert!(Moments::of_mask(&mask, PixelTerm::Centers).unwrap().ellipse().is_none());
            // As squares they have a width.
            assert!(Moments::of_mask(&mask, PixelTerm::Squares).unwrap().ellipse().is_some());
        }
        // Two rows are no line, however long.
        let long = Mask::from_fn(10_000, 2, |_, _| true);
        let ellipse = Moments::of_mask(&long, PixelTerm::Centers).unwrap().ellipse().unwrap();
        assert!((ellipse.semi_axes().y - 1.0).abs() < 1e-9);
    }

    #[test]
    fn far_from_the_origin_no_digits_are_lost() {
        let near = Mask::from_fn(7, 9, |column, row| (column * 5 + row * 3) % 4 < 2);
        let far = Mask { origin: [4_000_000_000, 3_000_000_000], ..near.clone() };
        let covariance = |mask| Moments::of_mask(mask, PixelTerm::Centers).unwrap().covariance;
        assert_eq!(covariance(&near), covariance(&far));
    }

    proptest! {
        #[test]
        fn moments_are_those_of_the_definition(
            bits in proptest::collection::vec(any::<bool>(), 63), x in 0..2000u32, y in 0..2000u32,
        ) {
            let mask = Mask::new([x, y], 9, 7, bits).unwrap();
            match Moments::of_mask(&mask, PixelTerm::Centers) {
                None => prop_assert_eq!(mask.count(), 0),
                Some(moments) => {
                    let (center, covariance) = plain_moments(&mask);
                    prop_assert_eq!(moments.area, mask.count() as f64);
                    prop_assert!((moments.center - center).norm() < 1e-9);
                    prop_assert!((moments.covariance - covariance).amax() < 1e-9);
                }
            }
        }

        #[test]
        fn mapped_moments_are_those_of_the_mapped_points(
            bits in proptest::collection::vec(any::<bool>(), 63),
            sx in 0.1..5.0f64, sy in 0.1..5.0f64, ox in -50.0..50.0f64, oy in -50.0..50.0f64,
        ) {
            let mask = Mask::new([0, 0], 9, 7, bits).unwrap();
            prop_assume!(mask.count() > 0);
            let (scale, offset) = (Vector2::new(sx, sy), Vector2::new(ox, oy));
            let mapped = Moments::of_mask(&mask, PixelTerm::Centers).unwrap().mapped(&scale, &offset);
            let points: Vec<_> = mask
                .pixels()
                .map(|p| Vector2::from(p.map(|x| f64::from(x) + 0.5)).component_mul(&scale) + offset)
                .collect();
            let center = points.iter().sum::<Vector2<f64>>() / points.len() as f64;
            let covariance: Matrix2<f64> = points.iter().map(|p| (p - center) * (p - center).transpose()).sum();
            prop_assert!((mapped.center - center).norm() < 1e-9);
            prop_assert!((mapped.covariance - covariance / points.len() as f64).amax() < 1e-9);
            prop_assert!((mapped.area - mask.count() as f64 * sx * sy).abs() < 1e-9 * mapped.area);
        }
    }
}

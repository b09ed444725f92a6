//! An affine map of pixels: another image size, a margin, a turned or mirrored picture.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::{Ellipse, EllipseError};

/// The affine map `linear x + shift` of pixels, whose linear part scales the axes and may exchange or mirror them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelMap {
    /// One entry in each row and column is not zero.
    linear: Matrix2<f64>,
    /// Pixels.
    shift: Vector2<f64>,
}

impl PixelMap {
    /// The map that changes nothing.
    pub const IDENTITY: Self = Self { linear: Matrix2::new(1.0, 0.0, 0.0, 1.0), shift: Vector2::new(0.0, 0.0) };

    /// Multiplies x and y by factors and moves them.
    pub fn scaling(factors: Vector2<f64>, shift: Vector2<f64>) -> Self {
        Self { linear: Matrix2::from_diagonal(&factors), shift }
    }

    /// From the pixels of an image as a viewer shows it to those of the stored image of this size, whose EXIF orientation is
    /// given (2 to 8; anything else changes nothing). With `stretched` the shown image was scaled to the size of the stored one,
    /// as fractions of its sides are that are multiplied by the wrong sides.
    ///
    /// Source: EXIF 2.32, tag 0x0112.
    pub fn from_shown(orientation: u8, size: Vector2<f64>, stretched: bool) -> Self {
        let (w, h) = (size.x, size.y);
        let (linear, shift) = match orientation {
            2 => ([-1.0, 0.0, 0.0, 1.0], [w, 0.0]),
            3 => ([-1.0, 0.0, 0.0, -1.0], [w, h]),
            4 => ([1.0, 0.0, 0.0, -1.0], [0.0, h]),
            5 => ([0.0, 1.0, 1.0, 0.0], [0.0, 0.0]),
            6 => ([0.0, 1.0, -1.0, 0.0], [0.0, h]),
            7 => ([0.0, -1.0, -1.0, 0.0], [w, h]),
            8 => ([0.0, -1.0, 1.0, 0.0], [w, 0.0]),
            _ => return Self::IDENTITY,
        };
        let [a, b, c, d] = linear;
        let turn = Matrix2::new(a, b, c, d);
        // The shown image is as wide as the stored one is high.
        let shown = if orientation > 4 && stretched { Vector2::new(h / w, w / h) } else { Vector2::repeat(1.0) };
        Self { linear: turn * Matrix2::from_diagonal(&shown), shift: shift.into() }
    }

    /// The inverse.
    #[must_use]
    pub(crate) fn inverse(&self) -> Self {
        let [[a, c], [b, d]] = self.linear.into();
        let of = |x: f64| if x == 0.0 { 0.0 } else { x.recip() };
        // Axes that are exchanged are exchanged back.
        let linear = Matrix2::new(of(a), of(c), of(b), of(d));
        Self { linear, shift: -(linear * self.shift) }
    }

    /// This map, and then another one.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self { linear: next.linear * self.linear, shift: next.point(self.shift) }
    }

    /// A point.
    pub fn point(&self, point: Vector2<f64>) -> Vector2<f64> {
        self.linear * point + self.shift
    }

    /// The four edges of a box, x0, y0, x1, y1: the smaller ones stay first where the axes are mirrored.
    pub fn edges(&self, [x0, y0, x1, y1]: [f64; 4]) -> [f64; 4] {
        let (a, b) = (self.point(Vector2::new(x0, y0)), self.point(Vector2::new(x1, y1)));
        let (low, high): ([f64; 2], [f64; 2]) = (a.into(), b.into());
        let row = |k: usize| self.linear[(k, 0)] + self.linear[(k, 1)];
        let sorted = |k: usize| if row(k) < 0.0 { (high[k], low[k]) } else { (low[k], high[k]) };
        let ((x0, x1), (y0, y1)) = (sorted(0), sorted(1));
        [x0, y0, x1, y1]
    }

    /// An ellipse.
    ///
    /// # Errors
    /// The result is no ellipse.
    pub fn ellipse(&self, ellipse: &Ellipse) -> Result<Ellipse, EllipseError> {
        if *self == Self::IDENTITY {
            return Ok(*ellipse);
        }
        Ellipse::from_shape(self.point(ellipse.center), &(self.linear * ellipse.shape() * self.linear.transpose()))
    }

    /// The factor on lengths: the square root of that on areas.
    pub(crate) fn scale(&self) -> f64 {
        self.linear.determinant().abs().sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the corners of a stored image of 4 x 3 pixels are shown, as viewers do it: 6 turns by 90 degrees clockwise.
    #[test]
    fn orientations_are_those_of_viewers() {
        // The pixel at the upper left of the stored image is shown at ..., in an image of 3 x 4 pixels from 5 on.
        let shown = [
            (2, [3.5, 0.5]),
            (3, [3.5, 2.5]),
            (4, [0.5, 2.5]),
            (5, [0.5, 0.5]),
            (6, [2.5, 0.5]),
            (7, [2.5, 3.5]),
            (8, [0.5, 3.5]),
        ];
        for (orientation, place) in shown {
            let map = PixelMap::from_shown(orientation, Vector2::new(4.0, 3.0), false);
            assert_eq!(map.point(place.into()), Vector2::new(0.5, 0.5), "{orientation}");
        }
        // Its right neighbor.
        let shown = [
            (2, [2.5, 0.5]),
            (3, [2.5, 2.5]),
            (4, [1.5, 2.5]),
            (5, [0.5, 1.5]),
            (6, [2.5, 1.5]),
            (7, [2.5, 2.5]),
            (8, [0.5, 2.5]),
        ];
        for (orientation, place) in shown {
            let map = PixelMap::from_shown(orientation, Vector2::new(4.0, 3.0), false);
            assert_eq!(map.point(place.into()), Vector2::new(1.5, 0.5), "{orientation}");
        }
    }

    #[test]
    fn fractions_of_a_turned_image_find_their_sides() {
        // At .25 and .5 of a shown image of 960 x 1280, multiplied by 1280 x 960.
        let map = PixelMap::from_shown(6, Vector2::new(1280.0, 960.0), true);
        let found = map.point(Vector2::new(0.25 * 1280.0, 0.5 * 960.0));
        assert!((found - Vector2::new(640.0, 720.0)).norm() < 1e-9, "{found}");
    }

    #[test]
    fn inverses_undo() {
        for orientation in 1..=8 {
            for stretched in [false, true] {
                let map = PixelMap::from_shown(orientation, Vector2::new(1280.0, 960.0), stretched);
                let b = [100.0, 200.0, 180.0, 260.0];
                let (there, back) = (map.edges(b), map.inverse().edges(map.edges(b)));
                assert!(there[0] < there[2] && there[1] < there[3], "{orientation}");
                assert!(back.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9), "{orientation} {stretched}: {back:?}");
                assert!((map.scale() - 1.0).abs() < 1e-12);
            }
        }
    }
}

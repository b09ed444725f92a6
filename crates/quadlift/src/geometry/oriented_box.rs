//! Oriented boxes in the image.

use nalgebra::{Rotation2, Vector2};

use super::bounding_box::BoundingBox;
use super::ellipse::Ellipse;

/// Why numbers are no oriented box.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OrientedBoxError {
    /// A number is NaN or infinite.
    #[error("the oriented box holds a number that is not finite")]
    NotFinite,
    /// Width or height is zero or negative.
    #[error("the size of the oriented box is {width} x {height}; expected two positive numbers")]
    Empty {
        /// Extent along the direction of the angle, pixels.
        width: f64,
        /// Extent across, pixels.
        height: f64,
    },
}

/// A rectangle in the image that may be turned, in pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    center: Vector2<f64>,
    size: Vector2<f64>,
    angle: f64,
}

impl OrientedBox {
    /// A checked box from its center, its width and height, and the direction of the width (radians, from x towards y).
    ///
    /// # Errors
    /// [`OrientedBoxError`] if a number is not finite, or a side is not positive.
    pub fn new(center: Vector2<f64>, size: Vector2<f64>, angle: f64) -> Result<Self, OrientedBoxError> {
        if !center.iter().chain(size.iter()).chain([&angle]).all(|x| x.is_finite()) {
            return Err(OrientedBoxError::NotFinite);
        }
        if size.min() <= 0.0 {
            return Err(OrientedBoxError::Empty { width: size.x, height: size.y });
        }
        Ok(Self { center, size, angle })
    }

    /// The rectangle that has the center, the directions and the extents of a parallelogram by its corners in order; of a rectangle
    /// itself. The first side is the width. `None` if it is empty or a number is not finite.
    pub fn of_corners([a, b, c, d]: [Vector2<f64>; 4]) -> Option<Self> {
        let (along, across) = ((b - a + c - d) * 0.5, (c - b + d - a) * 0.5);
        Self::new((a + b + c + d) * 0.25, Vector2::new(along.norm(), across.norm()), along.y.atan2(along.x)).ok()
    }

    /// The center, pixels.
    pub fn center(&self) -> Vector2<f64> {
        self.center
    }

    /// Width (along the direction of the angle) and height, pixels.
    pub fn size(&self) -> Vector2<f64> {
        self.size
    }

    /// Direction of the width, radians from x towards y.
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// The corners from x towards y, the first one between the sides in the direction of the angle and across.
    pub fn corners(&self) -> [Vector2<f64>; 4] {
        let half = self.size * 0.5;
        [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
            .map(|(x, y)| self.center + Rotation2::new(self.angle) * Vector2::new(x * half.x, y * half.y))
    }

    /// The box around its corners.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        let corners = self.corners();
        let extent = |k: usize| {
            corners.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), c| (low.min(c[k]), high.max(c[k])))
        };
        let ((x0, x1), (y0, y1)) = (extent(0), extent(1));
        BoundingBox::new([x0, y0, x1, y1]).ok()
    }

    /// The ellipse that touches the four sides in their middles.
    pub fn inscribed_ellipse(&self) -> Option<Ellipse> {
        Ellipse::new(self.center, self.size * 0.5, self.angle).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_no_box_are_refused() {
        let of = |w: f64, angle: f64| OrientedBox::new(Vector2::new(1.0, 2.0), Vector2::new(w, 3.0), angle);
        assert_eq!(of(-1.0, 0.0), Err(OrientedBoxError::Empty { width: -1.0, height: 3.0 }));
        assert_eq!(of(1.0, f64::NAN), Err(OrientedBoxError::NotFinite));
        assert_eq!(of(0.0, 0.0), Err(OrientedBoxError::Empty { width: 0.0, height: 3.0 }));
    }

    #[test]
    fn a_box_is_that_of_its_corners() {
        for angle in [-2.0, -0.3, 0.0, 0.7, 1.5, 3.0] {
            let turned = OrientedBox::new(Vector2::new(10.0, -4.0), Vector2::new(6.0, 2.0), angle).unwrap();
            // The first side has to run along the direction of the angle.
            let [a, b, c, d] = turned.corners();
            let again = OrientedBox::of_corners([c, d, a, b]).unwrap();
            assert!((again.center() - turned.center()).norm() < 1e-12);
            assert!((again.size() - turned.size()).norm() < 1e-12);
            assert!((again.angle() - turned.angle()).abs() < 1e-12, "{angle}");
            for corner in turned.corners() {
                let edges = turned.bounding_box().unwrap().edges();
                assert!(corner.x >= edges[0] && corner.y >= edges[1] && corner.x <= edges[2] && corner.y <= edges[3]);
            }
        }
        assert_eq!(OrientedBox::of_corners([Vector2::zeros(); 4]), None);
    }

    #[test]
    fn a_box_that_is_not_turned_is_its_bounding_box() {
        let straight = OrientedBox::new(Vector2::new(10.0, 20.0), Vector2::new(4.0, 6.0), 0.0).unwrap();
        assert_eq!(straight.bounding_box().unwrap().edges(), [8.0, 17.0, 12.0, 23.0]);
    }
}

//! Axis-aligned boxes in the image.

use nalgebra::Vector2;

/// Why four numbers are no box.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BoundingBoxError {
    /// A coordinate is NaN or infinite.
    #[error("the box [{}, {}, {}, {}] holds a number that is not finite", .0[0], .0[1], .0[2], .0[3])]
    NotFinite([f64; 4]),
    /// The right edge is not right of the left one, or the bottom edge not below the top one.
    #[error("the box [{}, {}, {}, {}] is empty or reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1",
        .0[0], .0[1], .0[2], .0[3])]
    Empty([f64; 4]),
}

/// An axis-aligned box by its edges, in pixels (origin at the top-left corner of the image).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingBox {
    pub(crate) x0: f64,
    pub(crate) y0: f64,
    pub(crate) x1: f64,
    pub(crate) y1: f64,
}

impl BoundingBox {
    /// A checked box from `[x0, y0, x1, y1]`.
    ///
    /// # Errors
    /// [`BoundingBoxError`] when a number is not finite, or when the box is empty.
    pub fn new(edges: [f64; 4]) -> Result<Self, BoundingBoxError> {
        let [x0, y0, x1, y1] = edges;
        if !edges.iter().all(|x| x.is_finite()) {
            return Err(BoundingBoxError::NotFinite(edges));
        }
        if x0 >= x1 || y0 >= y1 {
            return Err(BoundingBoxError::Empty(edges));
        }
        Ok(Self { x0, y0, x1, y1 })
    }

    /// Left edge.
    pub fn x0(&self) -> f64 {
        self.x0
    }

    /// Top edge.
    pub fn y0(&self) -> f64 {
        self.y0
    }

    /// Right edge.
    pub fn x1(&self) -> f64 {
        self.x1
    }

    /// Bottom edge.
    pub fn y1(&self) -> f64 {
        self.y1
    }

    /// The edges `[x0, y0, x1, y1]`.
    pub fn edges(&self) -> [f64; 4] {
        [self.x0, self.y0, self.x1, self.y1]
    }

    /// The center.
    pub fn center(&self) -> Vector2<f64> {
        Vector2::new(0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1))
    }

    /// Width and height.
    pub fn size(&self) -> Vector2<f64> {
        Vector2::new(self.x1 - self.x0, self.y1 - self.y0)
    }

    /// Mean half size `(w + h) / 4`: the unit in which box noise is measured.
    pub fn mean_half_size(&self) -> f64 {
        let size = self.size();
        0.25 * (size.x + size.y)
    }

    /// Intersection over union with another box, in [0, 1].
    pub fn iou(&self, other: &Self) -> f64 {
        let w = self.x1.min(other.x1) - self.x0.max(other.x0);
        let h = self.y1.min(other.y1) - self.y0.max(other.y0);
        if w <= 0.0 || h <= 0.0 {
            return 0.0;
        }
        let area = |b: &Self| b.size().x * b.size().y;
        w * h / (area(self) + area(other) - w * h)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn empty_and_non_finite_boxes_are_refused() {
        assert!(matches!(BoundingBox::new([0.0, 0.0, 0.0, 1.0]), Err(BoundingBoxError::Empty(_))));
        assert!(matches!(BoundingBox::new([2.0, 0.0, 1.0, 1.0]), Err(BoundingBoxError::Empty(_))));
        assert!(matches!(BoundingBox::new([0.0, 0.0, f64::NAN, 1.0]), Err(BoundingBoxError::NotFinite(_))));
    }

    #[test]
    fn iou_of_known_boxes() {
        let a = BoundingBox::new([0.0, 0.0, 2.0, 2.0]).unwrap();
        let b = BoundingBox::new([1.0, 1.0, 3.0, 3.0]).unwrap();
        let c = BoundingBox::new([5.0, 5.0, 6.0, 6.0]).unwrap();
        assert!((a.iou(&b) - 1.0 / 7.0).abs() < 1e-15);
        assert_eq!(a.iou(&c), 0.0);
        assert_eq!(a.iou(&a), 1.0);
        assert_eq!(a.mean_half_size(), 1.0);
    }
}

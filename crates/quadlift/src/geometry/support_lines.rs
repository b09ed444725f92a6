//! Supporting lines of a mask: its extent in eight directions.

use nalgebra::Vector2;

use super::{BoundingBox, Ellipse};

/// Number of directions.
pub const SUPPORT_DIRECTIONS: usize = 8;

/// Cosine of 45 degrees; a constant, so that opposite directions are opposite to the last bit.
const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The supporting lines of an outline's convex hull in eight directions, every 45 degrees (docs/method.md, section 2.2). The lines to the
/// right, bottom, left and top are the edges of its tight box; the diagonal ones cut the corners in which the object is
/// not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SupportLines {
    /// For each direction `n_k` (see [`Self::normal`]), how far the hull reaches: the largest `n_k . x`, in pixels.
    pub reach: [f64; SUPPORT_DIRECTIONS],
    /// Whether the hull touches the line where the border of the image cuts the object off.
    pub cut_off: [bool; SUPPORT_DIRECTIONS],
    /// Whether the hull touches the line where another object begins, which may hide a part of this one.
    pub hidden: [bool; SUPPORT_DIRECTIONS],
}

/// What is known of a point of an outline, besides its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutlineEnd {
    /// The border of the image is here.
    pub cut_off: bool,
    /// Another object is here.
    pub hidden: bool,
}

impl SupportLines {
    /// The direction with an index: 0 to the right, 1 to the right and down, 2 down, and so on (y points down).
    pub fn normal(direction: usize) -> Vector2<f64> {
        const COORDINATES: [f64; SUPPORT_DIRECTIONS] = [1.0, DIAGONAL, 0.0, -DIAGONAL, -1.0, -DIAGONAL, 0.0, DIAGONAL];
        Vector2::new(COORDINATES[direction % 8], COORDINATES[(direction + 6) % 8])
    }

    /// The lines of the points of an outline, in pixels, with what is known of each of them. A line is cut off, or
    /// hidden, when a point on it is.
    ///
    /// `None` when there are no points, when one is not finite, or when all lie on a horizontal or vertical line.
    pub fn of_outline(points: &[(Vector2<f64>, OutlineEnd)]) -> Option<Self> {
        let mut lines = Self {
            reach: [f64::NEG_INFINITY; SUPPORT_DIRECTIONS],
            cut_off: [false; SUPPORT_DIRECTIONS],
            hidden: [false; SUPPORT_DIRECTIONS],
        };
        for k in 0..SUPPORT_DIRECTIONS {
            let normal = Self::normal(k);
            for (point, end) in points {
                let reach = normal.dot(point);
                if !reach.is_finite() {
                    return None;
                }
                if reach > lines.reach[k] {
                    (lines.reach[k], lines.cut_off[k], lines.hidden[k]) = (reach, end.cut_off, end.hidden);
                } else if reach == lines.reach[k] {
                    lines.cut_off[k] |= end.cut_off;
                    lines.hidden[k] |= end.hidden;
                }
            }
        }
        lines.bounding_box().map(|_| lines)
    }

    /// The tangent lines of an ellipse that is seen as a whole.
    pub fn of_ellipse(ellipse: &Ellipse) -> Self {
        let reach = |k| {
            let [.., offset] = ellipse.tangent_line(&Self::normal(k));
            -offset
        };
        Self { reach: std::array::from_fn(reach), cut_off: [false; 8], hidden: [false; 8] }
    }

    /// The tight box, from the lines along x and y; `None` when it is empty.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        BoundingBox::new([-self.reach[4], -self.reach[6], self.reach[0], self.reach[2]]).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn free(points: &[[f64; 2]]) -> Vec<(Vector2<f64>, OutlineEnd)> {
        points.iter().map(|p| (Vector2::from(*p), OutlineEnd::default())).collect()
    }

    #[test]
    fn directions_turn_from_x_to_y() {
        for k in 0..SUPPORT_DIRECTIONS {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
            assert!((SupportLines::normal(k) - Vector2::new(cos, sin)).norm() < 1e-15, "{k}");
            assert_eq!(SupportLines::normal(k), -SupportLines::normal(k + 4));
        }
    }

    #[test]
    fn a_triangle_has_the_lines_of_its_corners() {
        let mut points = free(&[[10.0, 20.0], [30.0, 20.0], [10.0, 60.0]]);
        points[1].1.cut_off = true;
        points[2].1.hidden = true;
        let lines = SupportLines::of_outline(&points).unwrap();
        assert_eq!(lines.bounding_box().unwrap().edges(), [10.0, 20.0, 30.0, 60.0]);
        let diagonal = lines.reach[1] * std::f64::consts::SQRT_2;
        assert!((diagonal - 70.0).abs() < 1e-12, "10 + 60 is more than 30 + 20");
        // To the right it touches the second corner; the line at the top touches the first two.
        assert_eq!(lines.cut_off, [true, false, false, false, false, false, true, true]);
        assert_eq!(lines.hidden, [false, true, true, true, true, false, false, false]);
    }

    #[test]
    fn what_has_no_extent_has_no_lines() {
        assert_eq!(SupportLines::of_outline(&[]), None);
        assert_eq!(SupportLines::of_outline(&free(&[[1.0, 1.0], [1.0, 5.0]])), None);
        assert_eq!(SupportLines::of_outline(&free(&[[1.0, 1.0], [2.0, f64::NAN], [5.0, 5.0]])), None);
    }

    proptest! {
        #[test]
        fn lines_of_an_ellipse_are_its_tangent_lines(
            x in -500.0..500.0, y in -500.0..500.0, a in 5.0..200.0, b in 5.0..200.0, angle in 0.0..3.0,
        ) {
            let ellipse = Ellipse::new(Vector2::new(x, y), Vector2::new(a, b), angle).unwrap();
            let (sin, cos) = angle.sin_cos();
            let points: Vec<_> = (0..2000)
                .map(|i| {
                    let (s, c) = (std::f64::consts::TAU * f64::from(i) / 2000.0).sin_cos();
                    let offset = Vector2::new(a * c * cos - b * s * sin, a * c * sin + b * s * cos);
                    (ellipse.center + offset, OutlineEnd::default())
                })
                .collect();
            let lines = SupportLines::of_outline(&points).unwrap();
            let exact = SupportLines::of_ellipse(&ellipse);
            for k in 0..SUPPORT_DIRECTIONS {
                let [.., d] = ellipse.tangent_line(&SupportLines::normal(k));
                prop_assert!((lines.reach[k] + d).abs() < 2e-5 * a.max(b), "{} {}", lines.reach[k], d);
                prop_assert_eq!((exact.reach[k], exact.cut_off[k], exact.hidden[k]), (-d, false, false));
            }
        }
    }
}

//! Tangent lines of an outline: how far it reaches in several directions.

use nalgebra::Vector2;

use super::bounding_box::BoundingBox;
use super::ellipse::Ellipse;
use super::oriented_box::OrientedBox;

/// Number of directions of the tangent lines of a mask or a polygon.
pub const SUPPORT_DIRECTIONS: usize = 8;

/// Most directions that [`TangentLines`] has room for.
pub(crate) const MAX_SUPPORT_DIRECTIONS: usize = 8;

/// The tangent lines of an outline's convex hull in directions that are spread evenly over the circle (docs/method.md, section 2.2).
/// Of a mask there are [`SUPPORT_DIRECTIONS`]: those to the right, bottom, left and top are the edges of its tight box; the diagonal
/// ones cut the corners in which the object is not. An oriented box has four, its sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentLines {
    /// Number of directions, a multiple of four.
    pub(crate) count: usize,
    /// The first direction, radians from x towards y.
    pub(crate) angle: f64,
    /// For each direction `n_k` (see [`Self::normal`]), how far the hull reaches: the largest `n_k . x`, in pixels.
    pub(crate) reach: [f64; MAX_SUPPORT_DIRECTIONS],
    /// Whether the hull touches the line where the border of the image cuts the object off.
    pub(crate) cut_off: [bool; MAX_SUPPORT_DIRECTIONS],
    /// Whether the hull touches the line where another object begins, which may hide a part of this one.
    pub(crate) hidden: [bool; MAX_SUPPORT_DIRECTIONS],
    /// Whether the lines along x and y are the edges of a box ([`Self::beside_box`]).
    pub(crate) of_box: bool,
}

/// What is known of a point of an outline, besides its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OutlineEnd {
    /// The border of the image is here.
    pub cut_off: bool,
    /// Another object is here.
    pub hidden: bool,
}

impl OutlineEnd {
    /// Whether the object may go on here unseen: its extent is only bounded from below.
    pub(crate) fn is_open(self) -> bool {
        self.cut_off || self.hidden
    }
}

/// One tangent line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentLine {
    /// Its direction, a unit vector in the image that points away from the object.
    pub normal: Vector2<f64>,
    /// How far the outline reaches: the largest `normal . x`, in pixels.
    pub reach: f64,
    /// What is known of the points in which the line touches the outline.
    pub end: OutlineEnd,
}

/// The direction with an index, of `count` (a multiple of four) that start at an angle (radians from x towards y). Opposite directions
/// are opposite to the last bit.
fn direction(count: usize, angle: f64, index: usize) -> Vector2<f64> {
    let (quarter, step) = (index / (count / 4), index % (count / 4));
    let turn = std::f64::consts::TAU * step as f64 / count as f64;
    let (sin, cos) = match (angle, 8 * step) {
        (0.0, 0) => (0.0, 1.0),
        (0.0, eighths) if eighths == count => (std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2),
        _ => (angle + turn).sin_cos(),
    };
    match quarter % 4 {
        0 => Vector2::new(cos, sin),
        1 => Vector2::new(-sin, cos),
        2 => Vector2::new(-cos, -sin),
        _ => Vector2::new(sin, -cos),
    }
}

impl TangentLines {
    /// The lines in [`SUPPORT_DIRECTIONS`] directions, every 45 degrees, of the points of an outline, in pixels, with what is known of
    /// each of them. The first line is the one to the right, then from x towards y. A line is cut off, or hidden, when a point on it is.
    ///
    /// `None` when there are no points, when one is not finite, or when all lie on a horizontal or vertical line.
    pub fn of_outline(points: &[(Vector2<f64>, OutlineEnd)]) -> Option<Self> {
        Self::of_outline_in(points, SUPPORT_DIRECTIONS, 0.0)
    }

    /// [`Self::of_outline`] in another number of directions, a multiple of four up to [`MAX_SUPPORT_DIRECTIONS`], of which the first
    /// has an angle (radians from x towards y). `None` also for any other number and an angle that is not finite.
    pub(crate) fn of_outline_in(points: &[(Vector2<f64>, OutlineEnd)], count: usize, angle: f64) -> Option<Self> {
        if count == 0 || !count.is_multiple_of(4) || count > MAX_SUPPORT_DIRECTIONS || !angle.is_finite() {
            return None;
        }
        let mut lines = Self {
            count,
            angle,
            reach: [f64::NEG_INFINITY; MAX_SUPPORT_DIRECTIONS],
            cut_off: [false; MAX_SUPPORT_DIRECTIONS],
            hidden: [false; MAX_SUPPORT_DIRECTIONS],
            of_box: false,
        };
        for k in 0..count {
            let normal = direction(count, angle, k);
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
        let narrow = |k: usize| lines.reach[k] + lines.reach[k + count / 2] <= 0.0;
        (!points.is_empty() && !(0..count / 2).any(narrow)).then_some(lines)
    }

    /// The tangent lines of an ellipse that is seen as a whole, every 45 degrees.
    pub fn of_ellipse(ellipse: &Ellipse) -> Self {
        let (reach, no) = ([f64::NEG_INFINITY; MAX_SUPPORT_DIRECTIONS], [false; MAX_SUPPORT_DIRECTIONS]);
        Self { count: SUPPORT_DIRECTIONS, angle: 0.0, reach, cut_off: no, hidden: no, of_box: false }
            .with_reach_of(ellipse)
    }

    /// The lines of a box that was measured beside the outline: its edges in place of the lines along x and y, because detectors and
    /// segmentations place the edges of boxes better than the outermost pixels of masks. Lines of an oriented box stay as they are.
    #[must_use]
    pub fn beside_box(mut self, bounding_box: &BoundingBox) -> Self {
        if self.angle == 0.0 {
            let [x0, y0, x1, y1] = bounding_box.edges();
            for (k, reach) in [x1, y1, -x0, -y0].into_iter().enumerate() {
                self.reach[k * self.count / 4] = reach;
            }
            self.of_box = true;
        }
        self
    }

    /// The same lines with the edges (left, top, right, bottom) of the box in them cut off where they are said to be; lines that are
    /// not of a box stay as they are.
    #[must_use]
    pub(crate) fn with_cut_off_edges(mut self, cut_off: [bool; 4]) -> Self {
        if self.of_box {
            for (k, edge) in [2, 3, 0, 1].into_iter().enumerate() {
                self.cut_off[k * self.count / 4] |= cut_off[edge];
            }
        }
        self
    }

    /// Whether all lines are of one outline that is seen as a whole.
    pub(crate) fn is_of_whole_outline(&self) -> bool {
        self.count == SUPPORT_DIRECTIONS && !self.of_box && self.lines().all(|line| !line.end.is_open())
    }

    /// The lines of an oriented box: those of its sides. Cut off are sides of which a corner lies within `tolerance` pixels of the border
    /// of an image of this size, or outside of it.
    pub fn of_oriented_box(turned: &OrientedBox, image_size: Option<Vector2<f64>>, tolerance: f64) -> Self {
        let corners = turned.corners();
        let outside =
            corners.map(|c| image_size.is_some_and(|size| c.min() <= tolerance || (size - c).min() <= tolerance));
        let (mut reach, no) = ([f64::NEG_INFINITY; MAX_SUPPORT_DIRECTIONS], [false; MAX_SUPPORT_DIRECTIONS]);
        let mut lines = Self { count: 4, angle: turned.angle(), reach, cut_off: no, hidden: no, of_box: false };
        for side in 0..4 {
            // The corners follow the directions: the one with index k lies between the sides k and k + 1.
            let half = 0.5 * turned.size()[side % 2];
            reach[side] = direction(4, turned.angle(), side).dot(&turned.center()) + half;
            lines.cut_off[side] = outside[side] || outside[(side + 3) % 4];
        }
        Self { reach, ..lines }
    }

    /// The same lines as far as an ellipse reaches.
    #[must_use]
    pub(crate) fn with_reach_of(mut self, ellipse: &Ellipse) -> Self {
        for k in 0..self.count {
            let [.., offset] = ellipse.tangent_line(&direction(self.count, self.angle, k));
            self.reach[k] = -offset;
        }
        self
    }

    /// The ellipse that touches the four sides of an oriented box in their middles; `None` for other lines.
    pub fn inscribed_ellipse(&self) -> Option<Ellipse> {
        if self.count != 4 {
            return None;
        }
        let semi_axes = Vector2::from_fn(|k, _| 0.5 * (self.reach[k] + self.reach[k + 2]));
        let center = (0..2).fold(Vector2::zeros(), |sum, k| {
            sum + direction(4, self.angle, k) * (0.5 * (self.reach[k] - self.reach[k + 2]))
        });
        Ellipse::new(center, semi_axes, self.angle).ok()
    }

    /// Number of lines, a multiple of four. The line opposite to the one with index k has index k + half of it.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The line with an index below [`Self::count`].
    pub fn line(&self, index: usize) -> TangentLine {
        TangentLine {
            normal: direction(self.count, self.angle, index),
            reach: self.reach[index],
            end: OutlineEnd { cut_off: self.cut_off[index], hidden: self.hidden[index] },
        }
    }

    /// The lines, from the first direction towards y.
    pub fn lines(&self) -> impl Iterator<Item = TangentLine> + '_ {
        (0..self.count).map(|index| self.line(index))
    }

    /// Mean of half its width and half its height along the first direction and across, pixels: of a mask the mean half size of its box.
    pub(crate) fn mean_half_size(&self) -> f64 {
        let quarter = self.count / 4;
        (0..4).map(|k| self.reach[k * quarter]).sum::<f64>() / 4.0
    }

    /// The same lines, hidden where it is said, in their order.
    #[must_use]
    pub(crate) fn with_hidden(mut self, hidden: &[bool]) -> Self {
        self.hidden.iter_mut().zip(hidden).for_each(|(line, hidden)| *line = *hidden);
        self
    }

    /// The same lines with other ends: what is known of the points in which each line touches the outline.
    #[must_use]
    pub fn with_ends(mut self, end: impl Fn(&TangentLine) -> OutlineEnd) -> Self {
        for k in 0..self.count {
            let end = end(&self.line(k));
            (self.cut_off[k], self.hidden[k]) = (end.cut_off, end.hidden);
        }
        self
    }

    /// The tight box, from the lines along x and y; of an oriented box the box around its corners.
    /// `None` when it is empty.
    pub fn bounding_box(&self) -> Option<BoundingBox> {
        let quarter = self.count / 4;
        if self.angle == 0.0 {
            let of = |k: usize| self.reach[k * quarter];
            return BoundingBox::new([-of(2), -of(3), of(0), of(1)]).ok();
        }
        // The corners between neighboring lines bound the outline.
        let corner = |k: usize| {
            let (a, b) = (self.line(k), self.line((k + 1) % self.count));
            let cross = a.normal.perp(&b.normal);
            Vector2::new(a.reach * b.normal.y - b.reach * a.normal.y, b.reach * a.normal.x - a.reach * b.normal.x)
                / cross
        };
        let mut edges = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for corner in (0..self.count).map(corner) {
            edges = [edges[0].min(corner.x), edges[1].min(corner.y), edges[2].max(corner.x), edges[3].max(corner.y)];
        }
        BoundingBox::new(edges).ok()
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
        for (count, angle) in [(8, 0.0), (4, 0.0), (4, 0.3), (4, -2.0), (8, 1.0)] {
            for k in 0..count {
                let (sin, cos) = (angle + std::f64::consts::TAU * k as f64 / count as f64).sin_cos();
                assert!((direction(count, angle, k) - Vector2::new(cos, sin)).norm() < 1e-15, "{count} {angle} {k}");
                assert_eq!(direction(count, angle, k), -direction(count, angle, k + count / 2));
            }
        }
    }

    #[test]
    fn a_triangle_has_the_lines_of_its_corners() {
        let mut points = free(&[[10.0, 20.0], [30.0, 20.0], [10.0, 60.0]]);
        points[1].1.cut_off = true;
        points[2].1.hidden = true;
        let lines = TangentLines::of_outline(&points).unwrap();
        assert_eq!(lines.bounding_box().unwrap().edges(), [10.0, 20.0, 30.0, 60.0]);
        let diagonal = lines.reach[1] * std::f64::consts::SQRT_2;
        assert!((diagonal - 70.0).abs() < 1e-12, "10 + 60 is more than 30 + 20");
        // To the right it touches the second corner; the line at the top touches the first two.
        assert_eq!(lines.cut_off, [true, false, false, false, false, false, true, true]);
        assert_eq!(lines.hidden, [false, true, true, true, true, false, false, false]);
    }

    #[test]
    fn what_has_no_extent_has_no_lines() {
        assert_eq!(TangentLines::of_outline(&[]), None);
        assert_eq!(TangentLines::of_outline(&free(&[[1.0, 1.0], [1.0, 5.0]])), None);
        assert_eq!(TangentLines::of_outline(&free(&[[1.0, 1.0], [2.0, f64::NAN], [5.0, 5.0]])), None);
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
            let lines = TangentLines::of_outline(&points).unwrap();
            let exact = TangentLines::of_ellipse(&ellipse);
            for k in 0..SUPPORT_DIRECTIONS {
                let [.., d] = ellipse.tangent_line(&direction(8, 0.0, k));
                prop_assert!((lines.reach[k] + d).abs() < 2e-5 * a.max(b), "{} {}", lines.reach[k], d);
                prop_assert_eq!((exact.reach[k], exact.cut_off[k], exact.hidden[k]), (-d, false, false));
            }
        }
    }
}

//! The area shared by a circle and an ellipse, exactly (docs/method.md, section 17).
//!
//! On the ellipse `(c1 + a cos, c2 + b sin)` the function `g = |p|^2 - radius^2` is
//! `al + be cos + ga sin + de cos 2 theta`, with at most four zeros; between them the boundary of the common region
//! runs along the ellipse (where g < 0) or along the circle.

use std::f64::consts::{PI, TAU};

/// Area common to the circle with the given radius about the origin and the axis-aligned ellipse with the given
/// center and semi-axes, in squared units of the input. Zero when a length is not positive.
pub(super) fn circle_ellipse_area(radius: f64, center: [f64; 2], semi_axes: [f64; 2]) -> f64 {
    let ([c1, c2], [a, b]) = (center, semi_axes);
    let (disc, oval) = (PI * radius * radius, PI * a * b);
    let smaller = disc.min(oval);
    if !(radius > 0.0 && a > 0.0 && b > 0.0 && smaller > 0.0) {
        return 0.0;
    }
    let g = TrigQuadratic::new(radius, center, semi_axes);
    let (far, [base_cos, base_sin]) = g.farthest_node();
    if far.abs() <= 1e-10 * disc {
        return smaller; // The two curves are nearly one: their crossings would be noise.
    }
    let (mut t, count) = g.zeros(far, [base_cos, base_sin]);
    if count < 2 {
        // No crossing: one lies in the other, or they are apart.
        let circle_inside = (c1 / a).powi(2) + (c2 / b).powi(2) < 1.0;
        return if far < 0.0 || circle_inside { smaller } else { 0.0 };
    }
    // The function has the sign of `far` before the first zero; arrange the zeros as entry, exit, entry, exit.
    let wraps = far < 0.0;
    if wraps {
        t[..count].rotate_left(1);
    }
    let mut points = [[0.0; 2]; 4]; // On both curves.
    let mut angles = [[0.0; 2]; 4]; // Cosine and sine of the ellipse's parameter there.
    for i in 0..count {
        let (x, y) = (1.0 - t[i] * t[i], 2.0 * t[i]);
        let norm = 1.0 / (1.0 + t[i] * t[i]);
        let (cos, sin) = ((base_cos * x - base_sin * y) * norm, (base_sin * x + base_cos * y) * norm);
        // One Newton step on the unexpanded form, which does not cancel when the ellipse is much the larger.
        let (px, py) = (c1 + a * cos, c2 + b * sin);
        let slope = 2.0 * (py * b * cos - px * a * sin);
        let step = -(px * px + py * py - radius * radius) / slope;
        let step = if step.abs() < 1e-2 { step } else { 0.0 };
        t[i] += 0.5 * step * (1.0 + t[i] * t[i]);
        let (cos, sin) = (cos - step * sin, sin + step * cos);
        let norm = 1.0 / (cos * cos + sin * sin).sqrt();
        angles[i] = [cos * norm, sin * norm];
        points[i] = [c1 + a * angles[i][0], c2 + b * angles[i][1]];
    }
    let (mut twice_area, mut circle_arcs) = (0.0, 0.0);
    for i in (0..count).step_by(2) {
        let ([cos0, sin0], [cos1, sin1]) = (angles[i], angles[i + 1]);
        let turn = if wraps && i + 2 == count { TAU } else { 0.0 };
        let arc = turn + 2.0 * (t[i + 1] - t[i]).atan2(1.0 + t[i] * t[i + 1]);
        twice_area += a * b * arc + c1 * b * (sin1 - sin0) - c2 * a * (cos1 - cos0);
        let (p, q) = (points[i + 1], points[(i + 2) % count]);
        let arc = (p[0] * q[1] - p[1] * q[0]).atan2(p[0] * q[0] + p[1] * q[1]);
        circle_arcs += if arc < 0.0 { arc + TAU } else { arc };
        if count == 2 && arc < 1e-3 {
            // Rounding can turn an empty arc into a full one: the far side of the circle tells which it is.
            let (x, y) = (-(p[0] + q[0]), -(p[1] + q[1]));
            let scale = radius / x.hypot(y);
            let far_side_inside = ((x * scale - c1) / a).powi(2) + ((y * scale - c2) / b).powi(2) < 1.0;
            circle_arcs = match (far_side_inside, arc < 0.0) {
                (true, true) => arc + TAU,
                (true, false) => TAU,
                (false, true) => 0.0,
                (false, false) => arc,
            };
        }
    }
    if circle_arcs > TAU {
        circle_arcs -= TAU; // The same rounding with four crossings: no arcs sum to more than the circle.
    }
    (0.5 * (twice_area + radius * radius * circle_arcs)).max(0.0).min(smaller)
}

/// The number of points (0, 2 or 4) that the circle and the ellipse of [`circle_ellipse_area`] have in common.
pub(super) fn circle_ellipse_crossings(radius: f64, center: [f64; 2], semi_axes: [f64; 2]) -> usize {
    let g = TrigQuadratic::new(radius, center, semi_axes);
    let (far, base) = g.farthest_node();
    if far == 0.0 { 0 } else { g.zeros(far, base).1 }
}

/// `constant + cos cos(theta) + sin sin(theta) + cos2 cos(2 theta)`.
struct TrigQuadratic {
    constant: f64,
    cos: f64,
    sin: f64,
    cos2: f64,
}

impl TrigQuadratic {
    fn new(radius: f64, [c1, c2]: [f64; 2], [a, b]: [f64; 2]) -> Self {
        Self {
            constant: c1 * c1 + c2 * c2 + 0.5 * (a * a + b * b) - radius * radius,
            cos: 2.0 * a * c1,
            sin: 2.0 * b * c2,
            cos2: 0.5 * (a * a - b * b),
        }
    }

    /// The value of largest modulus at the angles 0, 90, 180, 270 degrees, and the (cos, sin) opposite to it.
    fn farthest_node(&self) -> (f64, [f64; 2]) {
        let (plus, minus) = (self.constant + self.cos2, self.constant - self.cos2);
        let nodes = [
            (plus + self.cos, [-1.0, 0.0]),
            (minus + self.sin, [0.0, -1.0]),
            (plus - self.cos, [1.0, 0.0]),
            (minus - self.sin, [0.0, 1.0]),
        ];
        nodes.into_iter().fold(nodes[0], |best, node| if node.0.abs() > best.0.abs() { node } else { best })
    }

    /// The zeros as `t = tan((theta - base) / 2)` in ascending order, and their number (0, 2 or 4).
    ///
    /// With the largest node at t = infinity all zeros of the quartic in t have a modulus of at most 9, so that they
    /// come out with an absolute precision that is good everywhere.
    fn zeros(&self, far: f64, base: [f64; 2]) -> ([f64; 4], usize) {
        let [base_cos, base_sin] = base;
        let cos = self.cos * base_cos + self.sin * base_sin;
        let sin = self.sin * base_cos - self.cos * base_sin;
        let cos2 = self.cos2 * (base_cos * base_cos - base_sin * base_sin);
        let scale = 1.0 / far;
        let p0 = (self.constant + cos + cos2) * scale;
        let p1 = 2.0 * sin * scale; // The coefficients of t and of t^3.
        let p2 = (2.0 * self.constant - 6.0 * cos2) * scale;
        quartic_zeros(p1, p2, p1, p0)
    }
}

/// The real zeros of `t^4 + c3 t^3 + c2 t^2 + c1 t + c0`, ascending, and their number (0, 2 or 4).
///
/// Ferrari: `y^4 + p y^2 + q y + r` with `y = t + c3 / 4` is `(y^2 + s y + u) (y^2 - s y + v)`, where `s^2` is the
/// largest zero of the resolvent cubic.
fn quartic_zeros(c3: f64, c2: f64, c1: f64, c0: f64) -> ([f64; 4], usize) {
    let h = 0.25 * c3;
    let p = c2 - 6.0 * h * h;
    let q = c1 - 2.0 * c2 * h + 8.0 * h * h * h;
    let r = c0 + h * (-c1 + h * (c2 - 3.0 * h * h));
    let z = largest_cubic_zero(2.0 * p, p * p - 4.0 * r, -q * q);
    let s = z.max(0.0).sqrt();
    // Without q the factors are those of a quadratic in y^2; its discriminant is positive when z is zero.
    let split = if s > 0.0 { q / s } else { (p * p - 4.0 * r).max(0.0).sqrt() };
    let (mut zeros, mut count) = ([0.0; 4], 0);
    for (s, doubled) in [(s, p + z - split), (-s, p + z + split)] {
        let square = z - 2.0 * doubled;
        if square > 0.0 {
            let root = square.sqrt();
            zeros[count] = 0.5 * (-s - root) - h;
            zeros[count + 1] = 0.5 * (-s + root) - h;
            count += 2;
        }
    }
    zeros[..count].sort_unstable_by(f64::total_cmp);
    (zeros, count)
}

/// The largest real zero of `z^3 + b z^2 + c z + d`.
fn largest_cubic_zero(b: f64, c: f64, d: f64) -> f64 {
    let shift = b / 3.0;
    let p = shift * shift - c / 3.0;
    let q = shift * (shift * shift - 0.5 * c) + 0.5 * d;
    // x^3 - 3 p x + 2 q = 0 with z = x - shift.
    let discriminant = q * q - p * p * p;
    let x = if discriminant <= 0.0 {
        2.0 * p.sqrt() * ((-q / (p * p.sqrt())).clamp(-1.0, 1.0).acos() / 3.0).cos()
    } else {
        let w = -q.signum() * (q.abs() + discriminant.sqrt()).cbrt();
        w + p / w
    };
    // One Newton step repairs the rounding of the closed form.
    let z = x - shift;
    let step = (((z + b) * z + c) * z + d) / ((3.0 * z + 2.0 * b) * z + c);
    if step.abs() < 1e-3 { z - step } else { z }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The area as an integral of chords along the first coordinate, by the trapezoidal rule.
    fn by_chords(radius: f64, [c1, c2]: [f64; 2], [a, b]: [f64; 2]) -> f64 {
        let (low, high) = ((-radius).max(c1 - a), radius.min(c1 + a));
        let n = 40_000;
        let step = (high - low) / f64::from(n);
        if step <= 0.0 {
            return 0.0;
        }
        (0..n)
            .map(|i| {
                let x = low + (f64::from(i) + 0.5) * step;
                let (p, q) = ((radius * radius - x * x).sqrt(), b * (1.0 - ((x - c1) / a).powi(2)).max(0.0).sqrt());
                (p.min(c2 + q) - (-p).max(c2 - q)).max(0.0) * step
            })
            .sum()
    }

    #[test]
    fn containment_and_tangency() {
        let cases = [
            (1.0, [0.0, 0.0], [0.5, 0.2], 0.1 * PI),
            (1.0, [0.5, 0.0], [0.5, 0.2], 0.1 * PI), // touches from inside
            (1.0, [0.0, 0.0], [1.0, 0.2], 0.2 * PI), // touches twice from inside
            (1.0, [0.2, 0.1], [3.0, 4.0], PI),       // the circle inside
            (1.0, [0.0, 0.0], [1.0, 4.0], PI),       // the circle inside, touching twice
            (1.0, [0.0, 0.0], [1.0, 1.0], PI),       // equal
            (1.0, [2.0, 0.0], [1.0, 0.5], 0.0),      // touches from outside
            (1.0, [3.0, 3.0], [1.0, 0.5], 0.0),
            (0.0, [0.0, 0.0], [1.0, 0.5], 0.0),
            (1.0, [0.0, 0.0], [f64::NAN, 0.5], 0.0),
        ];
        for (radius, center, semi_axes, expected) in cases {
            let area = circle_ellipse_area(radius, center, semi_axes);
            assert!((area - expected).abs() < 1e-9, "{center:?} {semi_axes:?}: {area} {expected}");
        }
    }

    #[test]
    fn the_tip_of_a_long_ellipse() {
        // All four crossings lie within 0.1 radians of the tip, where a coarse search for changes of sign fails.
        for c2 in [0.0, 1e-9, 1e-4] {
            let (center, semi_axes) = ([-999.5, c2], [1e3, 1e-3]);
            let area = circle_ellipse_area(0.3, center, semi_axes);
            assert!((area - by_chords(0.3, center, semi_axes)).abs() < 1e-6 * area, "{c2} {area}");
        }
    }

    #[test]
    fn quartics_with_known_zeros() {
        let from_zeros = |z: [f64; 4]| {
            let e1 = z.iter().sum::<f64>();
            let e2 = z[0] * z[1] + z[0] * z[2] + z[0] * z[3] + z[1] * z[2] + z[1] * z[3] + z[2] * z[3];
            let e3 = z[0] * z[1] * z[2] + z[0] * z[1] * z[3] + z[0] * z[2] * z[3] + z[1] * z[2] * z[3];
            quartic_zeros(-e1, e2, -e3, z.iter().product())
        };
        for z in [[-2.0, -1.0, 1.0, 2.0], [-3.0, 0.1, 0.2, 5.0], [-0.04, -0.02, 0.02, 0.04], [1.0, 2.0, 3.0, 4.0]] {
            let (zeros, count) = from_zeros(z);
            assert_eq!(count, 4);
            for (zero, expected) in zeros.iter().zip(z) {
                assert!((zero - expected).abs() < 1e-9, "{zeros:?}");
            }
        }
        assert_eq!(quartic_zeros(0.0, 2.0, 0.0, 1.0).1, 0);
        let (zeros, count) = quartic_zeros(0.0, 0.0, 0.0, -16.0);
        assert_eq!(count, 2);
        assert!((zeros[0] + 2.0).abs() < 1e-12 && (zeros[1] - 2.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn agrees_with_chords(
            radius in 0.2..2.0f64, center in prop::array::uniform2(-2.0..2.0f64),
            semi_axes in prop::array::uniform2(0.05..3.0f64),
        ) {
            let area = circle_ellipse_area(radius, center, semi_axes);
            prop_assert!((area - by_chords(radius, center, semi_axes)).abs() < 1e-5);
        }
    }
}

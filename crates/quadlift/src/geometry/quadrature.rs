//! Adaptive integration over an interval: the Gauss-Kronrod pair of 7 and 15 nodes.

/// Positive nodes of the 15-point Kronrod rule on [-1, 1], descending; every second one is a Gauss node.
const NODES: [f64; 7] = [
    0.9914553711208126,
    0.9491079123427585,
    0.8648644233597691,
    0.7415311855993945,
    0.5860872354676911,
    0.4058451513773972,
    0.20778495500789848,
];
/// Kronrod weights of [`NODES`].
const KRONROD: [f64; 7] = [
    0.022935322010529224,
    0.06309209262997856,
    0.10479001032225019,
    0.14065325971552592,
    0.1690047266392679,
    0.19035057806478542,
    0.20443294007529889,
];
/// Kronrod and Gauss weight of the middle node.
const MIDDLE: (f64, f64) = (0.20948214108472782, 0.4179591836734694);
/// Gauss weights of the second, fourth and sixth of [`NODES`].
const GAUSS: [f64; 3] = [0.1294849661688697, 0.27970539148927664, 0.3818300505051189];

/// Intervals after which the subdivision stops.
const MAX_INTERVALS: usize = 400;

/// The integral of `f` over `[a, b]` by 15 nodes, and its difference from the 7-point Gauss rule.
pub(crate) fn gauss_kronrod15(f: &impl Fn(f64) -> f64, a: f64, b: f64) -> (f64, f64) {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    let center = f(middle);
    let (mut kronrod, mut gauss) = (MIDDLE.0 * center, MIDDLE.1 * center);
    for i in 0..7 {
        let pair = f(middle - half * NODES[i]) + f(middle + half * NODES[i]);
        kronrod += KRONROD[i] * pair;
        if i % 2 == 1 {
            gauss += GAUSS[i / 2] * pair;
        }
    }
    (kronrod * half, ((kronrod - gauss) * half).abs())
}

/// A height in `[a, b]` for `u` in [-1, 1], dense towards both ends: what grows there like the distance to the power
/// of 1/2 or 3/2 is smooth in `u`. Returns the height and its derivative.
pub(crate) fn dense_at_ends(a: f64, b: f64, u: f64) -> (f64, f64) {
    let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
    (middle + half * 0.5 * u * (3.0 - u * u), half * 1.5 * (1.0 - u * u))
}

/// The integral of `f` from the first to the last of the ascending `breaks`, between which `f` is smooth (at them it
/// may behave like the distance to the power of 1/2 or 3/2).
///
/// The interval with the largest error estimate is halved until the sum of the estimates is at most `tolerance` times
/// the integral. The work is bounded (12,000 evaluations), so that a hopeless tolerance ends too.
pub(crate) fn integrate(f: impl Fn(f64) -> f64, breaks: &[f64], tolerance: f64) -> f64 {
    let part = |piece: usize, low: f64, high: f64| {
        let smoothed = |u: f64| {
            let (x, derivative) = dense_at_ends(breaks[piece], breaks[piece + 1], u);
            f(x) * derivative
        };
        let (value, error) = gauss_kronrod15(&smoothed, low, high);
        Interval { piece, low, high, value, error }
    };
    let mut intervals: Vec<Interval> =
        (1..breaks.len()).flat_map(|end| [part(end - 1, -1.0, 0.0), part(end - 1, 0.0, 1.0)]).collect();
    loop {
        let (mut value, mut error, mut worst) = (0.0, 0.0, 0);
        for (i, interval) in intervals.iter().enumerate() {
            value += interval.value;
            error += interval.error;
            if interval.error > intervals[worst].error {
                worst = i;
            }
        }
        // Written so that NaN ends the loop.
        let unfinished = error > tolerance * value.abs();
        if !unfinished || intervals.len() >= MAX_INTERVALS {
            return value;
        }
        let Interval { piece, low, high, .. } = intervals[worst];
        let middle = 0.5 * (low + high);
        intervals[worst] = part(piece, low, middle);
        intervals.push(part(piece, middle, high));
    }
}

/// A part of a piece, in the piece's own coordinate from -1 to 1.
struct Interval {
    piece: usize,
    low: f64,
    high: f64,
    value: f64,
    error: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pair_is_exact_to_its_degrees() {
        // The Kronrod rule of 15 nodes integrates polynomials of degree 22 exactly, the Gauss rule degree 13.
        for degree in 0..=22 {
            let (value, error) = gauss_kronrod15(&|x: f64| x.powi(degree), 0.0, 2.0);
            let exact = 2.0f64.powi(degree + 1) / f64::from(degree + 1);
            assert!((value - exact).abs() < 1e-14 * exact, "degree {degree}");
            assert_eq!(error > 1e-13 * exact, degree > 13, "degree {degree}");
        }
    }

    #[test]
    fn roots_and_kinks_at_breaks_are_smooth() {
        // Only a few intervals: the tolerance would not be met by halving at the singular points.
        let count = std::cell::Cell::new(0);
        let value = integrate(
            |x| {
                count.set(count.get() + 1);
                x.sqrt() + (x - 0.3).max(0.0).powf(1.5)
            },
            &[0.0, 0.3, 1.0],
            1e-13,
        );
        assert!((value - 2.0 / 3.0 - 0.7f64.powf(2.5) / 2.5).abs() < 1e-13);
        assert!(count.get() <= 120, "{} evaluations", count.get());
    }

    #[test]
    fn unknown_kinks_are_resolved_to_the_tolerance() {
        let value = integrate(|x| (x - 0.3).max(0.0).powf(1.5), &[0.0, 1.0], 1e-10);
        assert!((value - 0.7f64.powf(2.5) / 2.5).abs() < 1e-10);
        assert_eq!(integrate(|_| 0.0, &[0.0, 1.0], 1e-10), 0.0);
        assert!(integrate(|_| f64::NAN, &[0.0, 1.0], 1e-10).is_nan());
        assert_eq!(integrate(|_| 1.0, &[], 1e-10), 0.0);
    }
}

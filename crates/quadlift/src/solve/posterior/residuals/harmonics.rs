//! Errors of a whole outline: its tangent lines as harmonics (docs/method.md, section 2.2).
//!
//! An outline is mostly wrong smoothly: too large, misplaced, too long. The errors of neighboring lines are then alike, and eight of them
//! tell no more than five numbers.

use std::f64::consts::FRAC_PI_4;

use super::row::ResidualRow;
use crate::geometry::SUPPORT_DIRECTIONS;

/// Components that are compared: size, place (two), elongation (two).
const SMOOTH: usize = 5;

/// The weights of the lines in a component, which are those of an orthonormal basis but for the size. Size, place and elongation err
/// by about the same: a size that is wrong by one is wrong by one in all eight lines, a place in four of them on average.
fn weight(component: usize, k: usize) -> f64 {
    let harmonic = component.div_ceil(2);
    let angle = FRAC_PI_4 * (harmonic * k % SUPPORT_DIRECTIONS) as f64;
    match component {
        0 => 0.25,
        1 | 3 => 0.5 * angle.cos(),
        _ => 0.5 * angle.sin(),
    }
}

/// Replaces the whitened residuals from the index `first` on, those of the lines of an outline, opposite ones after each other, by
/// their smooth components.
pub(super) fn to_harmonics(rows: &mut Vec<ResidualRow>, first: usize) {
    let mut components = [ResidualRow { residual: 0.0, row: [0.0; 9], ..rows[first] }; SMOOTH];
    for (position, line) in rows[first..].iter().enumerate() {
        let k = position / 2 + position % 2 * (SUPPORT_DIRECTIONS / 2);
        for (component, sum) in components.iter_mut().enumerate() {
            let weight = weight(component, k);
            sum.residual += weight * line.residual;
            (0..9).for_each(|i| sum.row[i] += weight * line.row[i]);
        }
    }
    rows.truncate(first);
    rows.extend(components);
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_1_SQRT_2;

    use super::*;
    use crate::solve::posterior::noise::groups::NoiseGroup;

    /// The components of residuals by direction.
    fn components(residuals: [f64; 8]) -> Vec<f64> {
        let row = |residual: f64| ResidualRow { residual, row: [residual; 9], group: NoiseGroup::Edge, counts: true };
        // Behind another row; each direction is followed by the opposite one.
        let lines = [0, 4, 1, 5, 2, 6, 3, 7].map(|k| row(residuals[k]));
        let mut rows: Vec<ResidualRow> = std::iter::once(row(7.0)).chain(lines).collect();
        to_harmonics(&mut rows, 1);
        assert!(rows.len() == 1 + SMOOTH && rows[0].residual == 7.0);
        assert!(rows.iter().all(|row| row.row.iter().all(|x| (x - row.residual).abs() < 1e-12)));
        rows[1..].iter().map(|row| row.residual).collect()
    }

    #[test]
    fn size_place_and_elongation_count_alike_and_what_is_not_smooth_does_not() {
        let of = |error: &dyn Fn(f64) -> f64| components(std::array::from_fn(|k| error(FRAC_PI_4 * k as f64)));
        for (k, error) in [|_| FRAC_1_SQRT_2, f64::cos, f64::sin, |x: f64| (2.0 * x).cos(), |x: f64| (2.0 * x).sin()]
            .iter()
            .enumerate()
        {
            let found = of(error);
            for (l, found) in found.into_iter().enumerate() {
                let expected = match (k == l, k) {
                    (true, 0) => 2.0 * FRAC_1_SQRT_2,
                    (true, _) => 2.0,
                    _ => 0.0,
                };
                assert!((found - expected).abs() < 1e-12, "{k} {l} {found}");
            }
        }
        for error in [|x: f64| (3.0 * x).cos(), |x: f64| (3.0 * x).sin(), |x: f64| (4.0 * x).cos()] {
            assert!(of(&error).iter().all(|x| x.abs() < 1e-12));
        }
    }
}

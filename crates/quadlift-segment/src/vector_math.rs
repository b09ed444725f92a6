//! Exponentials and logarithms of many numbers at once.
//!
//! Written without branches, so that the compiler uses vector instructions, and without the platform's mathematical
//! library, so that every machine gives the same bits. The polynomials are those of the Cephes library.
// Constants are written as published, with more digits than f32 keeps.
#![allow(clippy::excessive_precision)]

/// Adding and subtracting this rounds to the nearest whole number, which then stands in the lowest bits.
const ROUND: f32 = 12_582_912.0;

/// `exp(x)` with a relative error below 2e-7; arguments are clamped to [-87, 87], so that the result is never zero,
/// subnormal or infinite.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    let x = x.clamp(-87.0, 87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    // x - n ln 2, the logarithm in two parts so that the product is exact.
    let r = x - n * 0.693_359_375 + n * 2.121_944_4e-4;
    let p = 1.987_569_15e-4;
    let p = p * r + 1.398_199_95e-3;
    let p = p * r + 8.333_451_9e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_55e-1;
    let p = p * r + 5.000_000_1e-1;
    let p = p * (r * r) + r + 1.0;
    let power = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    p * f32::from_bits(power)
}

/// `ln(x)` of a positive normal number, with an error below 2e-7 (absolute near 1, relative elsewhere).
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    // x = 2^e m with m in [sqrt(1/2), sqrt(2)).
    let offset = x.to_bits().wrapping_sub(0x3f35_04f3);
    let e = (offset as i32) >> 23;
    let m = f32::from_bits((offset & 0x007f_ffff).wrapping_add(0x3f35_04f3)) - 1.0;
    let e = e as f32;
    let z = m * m;
    let p = 7.037_683_6e-2;
    let p = p * m - 1.151_461_0e-1;
    let p = p * m + 1.167_699_9e-1;
    let p = p * m - 1.242_014_1e-1;
    let p = p * m + 1.424_932_3e-1;
    let p = p * m - 1.666_805_7e-1;
    let p = p * m + 2.000_071_5e-1;
    let p = p * m - 2.499_999_4e-1;
    let p = p * m + 3.333_333_1e-1;
    let y = p * m * z - e * 2.121_944_4e-4 - 0.5 * z;
    m + y + e * 0.693_359_375
}

/// Numbers added side by side before they are added up.
const LANES: usize = 8;

/// The sum of the products of two lists of the same length.
#[inline]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    let (a, b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = a.remainder().iter().zip(b.remainder()).map(|(x, y)| x * y).sum();
    for (a, b) in a.zip(b) {
        for i in 0..LANES {
            lanes[i] += a[i] * b[i];
        }
    }
    lanes.iter().sum::<f32>() + rest
}

/// The sum of the weights, and of their products with each of nine lists; all of the same length.
#[inline]
pub(crate) fn weighted_sums(weights: &[f32], lists: [&[f32]; 9]) -> [f32; 10] {
    // Four at a time: the ten running sums then stay in registers.
    const FEW: usize = 4;
    let n = weights.len();
    let lists = lists.map(|list| &list[..n]);
    let whole = n - n % FEW;
    let mut lanes = [[0.0f32; FEW]; 10];
    for start in (0..whole).step_by(FEW) {
        let w: [f32; FEW] = std::array::from_fn(|i| weights[start + i]);
        for i in 0..FEW {
            lanes[0][i] += w[i];
        }
        for (lane, list) in lanes[1..].iter_mut().zip(&lists) {
            let list = &list[start..start + FEW];
            for i in 0..FEW {
                lane[i] += w[i] * list[i];
            }
        }
    }
    let mut sums = lanes.map(|lane| (lane[0] + lane[1]) + (lane[2] + lane[3]));
    for i in whole..n {
        sums[0] += weights[i];
        for (sum, list) in sums[1..].iter_mut().zip(&lists) {
            *sum += weights[i] * list[i];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exponentials_and_logarithms_are_those_of_f64(x in -86.9..86.9f32, y in 1e-30..1e30f64, small in 0.5..2.0f32) {
            let exact = f64::from(x).exp();
            prop_assert!((f64::from(exp(x)) / exact - 1.0).abs() < 2e-7 * (1.0 + 0.0));
            for y in [y as f32, small] {
                let exact = f64::from(y).ln();
                prop_assert!((f64::from(ln(y)) - exact).abs() < 2e-7 * exact.abs().max(1.0), "ln {y}: {}", ln(y));
            }
        }

        #[test]
        fn sums_are_those_of_the_definition(a in proptest::collection::vec(-1.0..1.0f32, 0..100)) {
            let b: Vec<f32> = a.iter().map(|x| 1.0 - x * 0.3).collect();
            let exact: f64 = a.iter().zip(&b).map(|(x, y)| f64::from(*x) * f64::from(*y)).sum();
            prop_assert!((f64::from(dot(&a, &b)) - exact).abs() < 1e-4);
            let sums = weighted_sums(&a, std::array::from_fn(|k| if k == 7 { &b[..] } else { &a[..] }));
            prop_assert!((f64::from(sums[8]) - exact).abs() < 1e-4);
            prop_assert!((f64::from(sums[0]) - a.iter().map(|&x| f64::from(x)).sum::<f64>()).abs() < 1e-4);
        }
    }

    #[test]
    fn extremes_stay_finite() {
        for x in [f32::NEG_INFINITY, -1e30, -100.0, 0.0, 100.0, f32::INFINITY] {
            assert!(exp(x).is_normal(), "{x}: {}", exp(x));
        }
        assert_eq!((exp(0.0), ln(1.0)), (1.0, 0.0));
        assert!((ln(f32::MIN_POSITIVE) + 87.336_54).abs() < 1e-4);
    }
}

//! The O(F) closed form against references: a dense singular value decomposition, and 100-digit arithmetic.

// The reader of the fixture is test code, which clippy cannot tell outside of #[test] functions.
use crate::common::{Vech, Views, dense_pfd, normalized, scene, vech4};
use crate::test_cases::cases;
use nalgebra::{Matrix3x4, Vector2, Vector3};
use proptest::prelude::*;
use quadlift::geometry::{Ellipse, Projection};
use quadlift::solve::pfd;

/// A double in C's hexadecimal notation, as Python's `float.hex` writes it.
fn hexadecimal(text: &str) -> f64 {
    let (sign, digits) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    let (mantissa, exponent) = digits.strip_prefix("0x").unwrap().split_once('p').unwrap();
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let bits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).unwrap() as f64;
    sign * bits * 2f64.powi(exponent.parse::<i32>().unwrap() - 4 * fraction.len() as i32)
}

/// One case of the fixture.
#[derive(Default)]
struct Case {
    name: String,
    views: Views,
    w: Vec<f64>,
    residual: f64,
}

fn fixture() -> Vec<Case> {
    let mut cases: Vec<Case> = Vec::new();
    for line in include_str!("fixtures/pfd_pixels.txt").lines().filter(|line| !line.starts_with('#')) {
        let (kind, rest) = line.split_once(' ').unwrap();
        if kind == "case" {
            cases.push(Case { name: rest.to_owned(), ..Default::default() });
            continue;
        }
        let case = cases.last_mut().unwrap();
        let numbers: Vec<f64> = rest.split(' ').map(hexadecimal).collect();
        match kind {
            "view" => {
                let p = Projection::from_matrix(Matrix3x4::from_row_slice(&numbers[..12])).unwrap();
                let e = &numbers[12..];
                let ellipse = Ellipse::new(Vector2::new(e[0], e[1]), Vector2::new(e[2], e[3]), e[4]).unwrap();
                case.views.push((p, ellipse));
            }
            "w" => case.w = numbers,
            "residual" => case.residual = numbers[0],
            other => panic!("unknown line {other}"),
        }
    }
    cases
}

#[test]
fn pixel_coordinates_agree_with_100_digit_arithmetic() {
    let cases = fixture();
    assert_eq!(cases.len(), 6);
    for case in &cases {
        let solution = pfd(&case.views).unwrap();
        let found = vech4(solution.dual_quadric.matrix()).normalize();
        let error = (found - Vech::from_column_slice(&case.w)).norm();
        let difference = (solution.residual - case.residual).abs();
        println!("{}: v {error:.1e}, residual {:e} off by {difference:.1e}", case.name, solution.residual);
        assert!(error < 1e-9, "{}: {error:e}", case.name);
        // Exact outlines leave rounding errors only: entries of M are as large as 1e10.
        assert!(difference < 1e-9 * case.residual + 1e-6, "{}: {} {}", case.name, solution.residual, case.residual);
    }
}

proptest! {
    #![proptest_config(cases(60))]

    #[test]
    fn normalized_coordinates_agree_with_the_dense_decomposition(
        count in 3usize..=100, noise in prop_oneof![Just(0.0), 0.01..0.3f64], seed in 0u64..10_000,
    ) {
        let (views, body) = scene(count, noise, seed);
        let views = normalized(&views, &(body.center.coords + Vector3::repeat(0.3)), body.semi_axes.product().cbrt());
        let (w, sigma) = dense_pfd(&views);
        let solution = pfd(&views).unwrap();
        let expected = Vech::from_column_slice(&w[..10]);
        let sign = -expected[9].signum();
        let error = (vech4(solution.dual_quadric.matrix()).normalize() - expected.normalize() * sign).norm();
        prop_assert!(error < 1e-9, "v {error:e}");
        let betas = solution.betas.iter().zip(&w[10..]).map(|(a, b)| (a - sign * b).abs()).fold(0.0, f64::max);
        prop_assert!(betas < 1e-9, "beta {betas:e}");
        prop_assert!((solution.residual - sigma).abs() < 1e-12, "{:e} {sigma:e}", solution.residual);
        prop_assert!(solution.iterations <= 12, "{} iterations", solution.iterations);
    }
}

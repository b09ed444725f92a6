//! The O(F) closed form against references: a dense singular value decomposition, and 100-digit arithmetic.

use nalgebra::{Matrix3x4, SVector, Vector2};
use quadlift::geometry::{Ellipse, Projection};
use quadlift::solve::{pfd, pfd_unit_quadric};

type Vech = SVector<f64, 10>;

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
    views: Vec<(Projection, Ellipse)>,
    w: Vec<f64>,
    v: Vec<f64>,
    residual: Vec<f64>,
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
            "v" => case.v = numbers,
            "residual" => case.residual = numbers,
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
        let unit_w = pfd(&case.views).unwrap();
        let unit_v = pfd_unit_quadric(&case.views).unwrap();
        for (solution, expected, residual) in
            [(&unit_w, &case.w, case.residual[0]), (&unit_v, &case.v, case.residual[1])]
        {
            let error = (solution.dual_quadric.vech().normalize() - Vech::from_column_slice(expected)).norm();
            println!(
                "{}: v {error:.1e}, residual {:.6e} {residual:.6e} its {}",
                case.name, solution.residual, solution.iterations
            );
            assert!(error < 1e-9, "{}: {error:e}", case.name);
        }
    }
}

//! Values of options that several commands share.

use quadlift::UnknownName;
use quadlift::geometry::BodyKind;

/// Reads a kind of body.
pub(crate) fn body(text: &str) -> Result<BodyKind, UnknownName> {
    text.parse()
}

/// Reads a number that is neither NaN nor infinite.
pub(crate) fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("expected a finite number".to_owned()),
    }
}

/// Reads a finite number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "expected a number above 0".to_owned())
}

/// Reads three numbers separated by commas.
pub(crate) fn three_numbers(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, String> = text.split(',').map(finite).collect();
    match numbers?.as_slice() {
        &[x, y, z] => Ok([x, y, z]),
        _ => Err("expected three numbers X,Y,Z".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_finite() {
        assert_eq!(three_numbers("1, -2,3e1"), Ok([1.0, -2.0, 30.0]));
        assert!(three_numbers("1,2").is_err() && three_numbers("1,2,inf").is_err() && finite("nan").is_err());
    }
}

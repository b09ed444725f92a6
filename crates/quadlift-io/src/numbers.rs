//! Lists of a fixed number of numbers in JSON.
//!
//! serde's own arrays report a list that is too long as "trailing characters", which is misleading.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, SeqAccess, Visitor};
use serde::ser::Serializer;

/// What a [`List`] can hold.
pub(crate) trait Item: Copy {
    /// Fills the list before its items are read.
    const ZERO: Self;
    /// Names several of them in a message.
    fn plural(f: &mut fmt::Formatter<'_>) -> fmt::Result;
}

impl Item for f64 {
    const ZERO: Self = 0.0;
    fn plural(f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("numbers")
    }
}

impl Item for u32 {
    const ZERO: Self = 0;
    fn plural(f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("whole numbers")
    }
}

/// A list of exactly `N` items.
#[derive(Clone, Copy)]
pub(crate) struct List<T, const N: usize>([T; N]);

impl<T: Item, const N: usize> Item for List<T, N> {
    const ZERO: Self = Self([T::ZERO; N]);
    fn plural(f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "lists of {N} ")?;
        T::plural(f)
    }
}

struct ListVisitor<T, const N: usize>(PhantomData<T>);

impl<'de, T: Item + Deserialize<'de>, const N: usize> Visitor<'de> for ListVisitor<T, N> {
    type Value = List<T, N>;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "a list of {N} ")?;
        T::plural(f)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
        let mut list = List::ZERO;
        let mut count = 0;
        while count < N {
            match seq.next_element()? {
                Some(item) => list.0[count] = item,
                None => return Err(A::Error::invalid_length(count, &self)),
            }
            count += 1;
        }
        while seq.next_element::<IgnoredAny>()?.is_some() {
            count += 1;
        }
        if count > N { Err(A::Error::invalid_length(count, &self)) } else { Ok(list) }
    }
}

impl<'de, T: Item + Deserialize<'de>, const N: usize> Deserialize<'de> for List<T, N> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_seq(ListVisitor(PhantomData))
    }
}

/// For `deserialize_with`: `N` numbers.
pub(crate) fn list<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<[f64; N], D::Error> {
    List::deserialize(deserializer).map(|list| list.0)
}

/// For `deserialize_with`: `N` whole numbers that are not negative.
pub(crate) fn whole_list<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<[u32; N], D::Error> {
    List::deserialize(deserializer).map(|list| list.0)
}

/// For `deserialize_with`: `N` numbers, or `null`.
pub(crate) fn optional_list<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<Option<[f64; N]>, D::Error> {
    Option::<List<f64, N>>::deserialize(d).map(|list| list.map(|list| list.0))
}

/// For `deserialize_with`: any number of lists of `N` numbers.
pub(crate) fn lists<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<Vec<[f64; N]>, D::Error> {
    Ok(Vec::<List<f64, N>>::deserialize(deserializer)?.into_iter().map(|list| list.0).collect())
}

/// Any number of lists of `N` numbers.
type Lists<const N: usize> = Box<[[f64; N]]>;

/// For `deserialize_with`: any number of lists of `N` numbers, or `null`.
pub(crate) fn optional_lists<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<Option<Lists<N>>, D::Error> {
    let lists = Option::<Vec<List<f64, N>>>::deserialize(d)?;
    Ok(lists.map(|lists| lists.into_iter().map(|list| list.0).collect()))
}

/// For `deserialize_with`: a matrix by rows.
pub(crate) fn matrix<'de, D: Deserializer<'de>, const R: usize, const C: usize>(
    d: D,
) -> Result<[[f64; C]; R], D::Error> {
    List::<List<f64, C>, R>::deserialize(d).map(|rows| rows.0.map(|row| row.0))
}

/// For `deserialize_with`: a matrix by rows, or `null`.
pub(crate) fn optional_matrix<'de, D: Deserializer<'de>, const R: usize, const C: usize>(
    d: D,
) -> Result<Option<[[f64; C]; R]>, D::Error> {
    Option::<List<List<f64, C>, R>>::deserialize(d).map(|rows| rows.map(|rows| rows.0.map(|row| row.0)))
}

/// For `serialize_with`: whole numbers, such as image sizes and levels, without ".0".
pub(crate) fn plain<S: Serializer>(number: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
    match number {
        None => serializer.serialize_none(),
        Some(x) if x.fract() == 0.0 && x.abs() < 1e15 => serializer.serialize_i64(*x as i64),
        Some(x) => serializer.serialize_f64(*x),
    }
}

/// Rounds a number to at most this many significant decimal digits (1 to 15), for figures that would otherwise be
/// written with 17.
pub(crate) fn significant(x: f64, digits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let places = digits - 1 - x.abs().log10().floor() as i32;
    // Powers of ten up to this one are exact, so that the quotient is the number next to the decimal one.
    if places.abs() > 22 {
        return format!("{x:.*e}", digits as usize - 1).parse().unwrap_or(x);
    }
    let power = 10f64.powi(places.abs());
    if places >= 0 { (x * power).round() / power } else { (x / power).round() * power }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list_of(json: &str) -> Result<[f64; 3], String> {
        list(&mut serde_json::Deserializer::from_str(json)).map_err(|error| error.to_string())
    }

    #[test]
    fn the_number_of_items_is_exact() {
        assert_eq!(list_of("[1, 2.5, -3]"), Ok([1.0, 2.5, -3.0]));
        for (json, count) in [("[]", 0), ("[1, 2]", 2), ("[1, 2, 3, 4, \"x\"]", 5)] {
            let error = list_of(json).unwrap_err();
            assert!(error.starts_with(&format!("invalid length {count}, expected a list of 3 numbers")), "{error}");
        }
    }

    #[test]
    fn matrices_name_their_rows() {
        let read = |json| optional_matrix::<_, 2, 2>(&mut serde_json::Deserializer::from_str(json));
        assert_eq!(read("[[1, 2], [3, 4]]").unwrap(), Some([[1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(read("null").unwrap(), None);
        let error = read("[[1, 2]]").unwrap_err().to_string();
        assert!(error.starts_with("invalid length 1, expected a list of 2 lists of 2 numbers"), "{error}");
    }

    #[test]
    fn whole_numbers_are_plain() {
        let text = |x| {
            let mut out = Vec::new();
            plain(&Some(x), &mut serde_json::Serializer::new(&mut out)).unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!(
            (text(640.0), text(-1.0), text(0.25), text(1e15)),
            ("640".into(), "-1".into(), "0.25".into(), "1000000000000000.0".into())
        );
    }

    proptest::proptest! {
        #[test]
        fn figures_have_so_many_digits(x in proptest::num::f64::NORMAL, digits in 1..15i32) {
            // Formatting to so many digits and reading is the independent way; halves may go either way.
            let expected: f64 = format!("{x:.*e}", digits as usize - 1).parse().unwrap();
            let found = significant(x, digits);
            let written = serde_json::to_string(&found).unwrap();
            let shown = written.split('e').next().unwrap().trim_start_matches(['-', '0', '.']).replace('.', "");
            proptest::prop_assert!(shown.trim_end_matches('0').len() <= digits as usize, "{x} {written}");
            let unit = 10f64.powi(1 - digits);
            proptest::prop_assert!(found == expected || (found - x).abs() <= 0.500001 * unit * x.abs() * 10.0, "{x} {written}");
            proptest::prop_assert!((found / x - 1.0).abs() <= 0.5000001 * unit, "{x} {written}");
        }
    }

    #[test]
    fn figures_that_are_short_stay() {
        for x in [0.0, -0.0, 1.5, -0.002, 1e300, 5e-324, f64::INFINITY, 123456.0] {
            assert_eq!(significant(x, 6), x);
        }
        assert_eq!(significant(0.4583859461658408, 6), 0.458386);
        assert_eq!(significant(-1234567.8, 3), -1.23e6);
        assert_eq!(significant(9.99999e-30, 3), 1e-29);
        assert!(significant(f64::NAN, 6).is_nan());
    }
}

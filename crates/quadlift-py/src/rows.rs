//! Rows of NumPy arrays: numbers where NaN means none, texts by their index.

use std::collections::HashMap;

use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// Texts by their index; none where it is negative.
#[derive(FromPyObject, Default)]
pub(crate) struct Names<'py>(Option<PyReadonlyArray1<'py, i64>>, Vec<String>);

/// Numbers of a row; none where all are NaN.
pub(crate) fn values<const N: usize>(array: &Option<PyReadonlyArray2<f64>>, row: usize) -> Option<[f64; N]> {
    let array = array.as_ref()?.as_array();
    let numbers: [f64; N] = std::array::from_fn(|k| array[[row, k]]);
    (!numbers.iter().all(|x| x.is_nan())).then_some(numbers)
}

/// The number of a row; none where it is NaN.
pub(crate) fn value(array: &Option<PyReadonlyArray1<f64>>, row: usize) -> Option<f64> {
    Some(array.as_ref()?.as_array()[row]).filter(|x| !x.is_nan())
}

impl Names<'_> {
    /// The name of a row.
    pub(crate) fn of_row(&self, row: usize) -> Option<&str> {
        let code = *self.0.as_ref()?.as_array().get(row)?;
        self.1.get(usize::try_from(code).ok()?).map(String::as_str)
    }

    /// For each row the index of its name in `known`, which is extended in the order of their first appearance. Names
    /// may repeat where none is known yet: they stand for different things then.
    pub(crate) fn indices(&self, known: &mut Vec<String>) -> Vec<Option<u32>> {
        let Names(Some(codes), names) = self else { return Vec::new() };
        let mut place = vec![None; names.len()];
        if !known.is_empty() {
            let places: HashMap<&str, u32> = known.iter().map(String::as_str).zip(0..).collect();
            place = names.iter().map(|name| places.get(name.as_str()).copied()).collect();
        }
        let of_code = |&code: &i64| {
            let code = usize::try_from(code).ok().filter(|code| *code < names.len())?;
            Some(*place[code].get_or_insert_with(|| {
                known.push(names[code].clone());
                known.len() as u32 - 1
            }))
        };
        codes.as_array().iter().map(of_code).collect()
    }
}

//! numpy's `.npy`: an array of N x 3 or more floats.

use std::path::Path;

use super::{Kind, number};
use crate::error::ReadError;

/// The first bytes of a file.
const MAGIC: &[u8] = b"\x93NUMPY";

/// The points in the bytes of a `.npy` file: the first three columns.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, ReadError> {
    let fail = |problem: String| ReadError::new(path, problem);
    let cut = || fail("this is no array of numpy: the header is cut off".to_owned());
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| fail("this is no array of numpy (.npy)".to_owned()))?;
    // Version 1 has a length of two bytes, later ones of four.
    let (length, start) = match rest.get(..6).ok_or_else(cut)? {
        [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([*a, *b])), 4),
        [_, _, a, b, c, d] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 6),
        _ => return Err(cut()),
    };
    let end = start + length;
    let header = rest.get(start..end).and_then(|header| std::str::from_utf8(header).ok()).ok_or_else(cut)?;
    let entry = |name: &str| Some(header.split_once(&format!("'{name}':"))?.1.trim_start());
    let (kind, big_endian) = match entry("descr").and_then(|text| text.split('\'').nth(1)) {
        Some("<f4") => (Kind::F32, false),
        Some("<f8") => (Kind::F64, false),
        Some(">f4") => (Kind::F32, true),
        Some(">f8") => (Kind::F64, true),
        found => {
            let found = found.unwrap_or("none");
            return Err(fail(format!("the array has the type {found}; expected <f4 or <f8 (32- or 64-bit floats)")));
        }
    };
    if entry("fortran_order").is_none_or(|text| !text.starts_with("False")) {
        return Err(fail("the array is stored by columns; expected rows (numpy.ascontiguousarray)".to_owned()));
    }
    let shape = entry("shape").and_then(|text| text.strip_prefix('(')?.split_once(')')).map(|(shape, _)| shape);
    let sizes: Option<Vec<usize>> = shape
        .and_then(|text| text.split(',').map(str::trim).filter(|s| !s.is_empty()).map(|s| s.parse().ok()).collect());
    let (rows, columns) = match sizes.as_deref() {
        Some(&[rows, columns]) if columns >= 3 => (rows, columns),
        _ => {
            let found = shape.unwrap_or_default();
            return Err(fail(format!("the array has the shape ({found}); expected (N, 3) or more columns")));
        }
    };
    let data = &rest[end..];
    let row = columns.checked_mul(kind.size());
    let size = row.and_then(|row| row.checked_mul(rows)).filter(|size| *size <= data.len());
    let (Some(row), Some(size)) = (row, size) else {
        return Err(fail(format!(
            "the file ends {} bytes after its header; expected {rows} x {columns} numbers",
            data.len()
        )));
    };
    let point = |bytes: &[u8]| [0, 1, 2].map(|k| number(&bytes[k * kind.size()..], kind, big_endian));
    Ok(data[..size].chunks_exact(row).map(point).collect())
}

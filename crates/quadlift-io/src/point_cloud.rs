//! Point clouds: the positions in PLY files, KITTI's and nuScenes' sweeps (`.bin`), numpy's arrays (`.npy`) and tables of text.

mod npy;
mod ply;

use std::path::Path;

use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::text::lines;

/// Reads the points of a file from its bytes.
type Parse = fn(&Path, &[u8]) -> Result<Vec<[f64; 3]>, ReadError>;

/// The endings of the files, for messages.
const KNOWN: &str = ".ply, .bin (KITTI's x, y, z, reflectance; nuScenes' .pcd.bin), .npy, .csv, .txt or .xyz";

/// The points of a file, whose format is known by its ending. Points that are not finite, as sensors write them where nothing is
/// measured, are left out.
///
/// # Errors
/// [`ReadError`] with the place, what was found and what was expected.
pub(crate) fn read_point_cloud(path: &Path) -> Result<Vec<[f64; 3]>, ReadError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let parse: Parse = match name.rsplit_once('.') {
        Some((_, "ply")) => ply::parse,
        Some((rest, "bin")) if rest.ends_with(".pcd") => |path, bytes| floats(path, bytes, 5),
        Some((_, "bin")) => |path, bytes| floats(path, bytes, 4),
        Some((_, "npy")) => npy::parse,
        Some((_, "csv" | "txt" | "xyz")) => table,
        _ => return Err(ReadError::new(path, format!("this is no point cloud: expected {KNOWN}"))),
    };
    let mut points = parse(path, &read_bytes(path)?)?;
    points.retain(|point| point.iter().all(|x| x.is_finite()));
    Ok(points)
}

/// Records of so many little-endian 32-bit floats, of which x, y, z are the first ones.
fn floats(path: &Path, bytes: &[u8], columns: usize) -> Result<Vec<[f64; 3]>, ReadError> {
    let record = 4 * columns;
    if !bytes.len().is_multiple_of(record) {
        let problem = format!(
            "the file has {} bytes; expected a multiple of {record}, {columns} 32-bit floats a point",
            bytes.len()
        );
        return Err(ReadError::new(path, problem));
    }
    Ok(bytes.chunks_exact(record).map(|point| [0, 1, 2].map(|k| number(&point[4 * k..], Kind::F32, false))).collect())
}

/// Lines that begin with x, y, z; the first one may have names.
fn table(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, ReadError> {
    let mut points = Vec::new();
    let mut is_first = true;
    for line in lines(path, as_utf8(path, bytes)?).filter(|line| !line.is_blank_or_comment()) {
        if std::mem::take(&mut is_first) && line.text.starts_with(|c: char| c.is_alphabetic() || c == '"') {
            continue;
        }
        let numbers = line.numbers_between_commas()?;
        let [x, y, z, ..] = numbers[..] else {
            return Err(line.error(format!("found {} numbers; expected x, y, z", numbers.len())));
        };
        points.push([x, y, z]);
    }
    Ok(points)
}

/// How a number is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    /// Number of bytes.
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// The number at the start of these bytes, of which there are enough.
fn number(bytes: &[u8], kind: Kind, big_endian: bool) -> f64 {
    fn array<const N: usize>(bytes: &[u8], reverse: bool) -> [u8; N] {
        let mut array = [0; N];
        array.copy_from_slice(&bytes[..N]);
        if reverse {
            array.reverse();
        }
        array
    }
    match kind {
        Kind::I8 => f64::from(i8::from_le_bytes(array(bytes, false))),
        Kind::U8 => f64::from(bytes[0]),
        Kind::I16 => f64::from(i16::from_le_bytes(array(bytes, big_endian))),
        Kind::U16 => f64::from(u16::from_le_bytes(array(bytes, big_endian))),
        Kind::I32 => f64::from(i32::from_le_bytes(array(bytes, big_endian))),
        Kind::U32 => f64::from(u32::from_le_bytes(array(bytes, big_endian))),
        Kind::F32 => f64::from(f32::from_le_bytes(array(bytes, big_endian))),
        Kind::F64 => f64::from_le_bytes(array(bytes, big_endian)),
    }
}

#[cfg(test)]
mod tests;

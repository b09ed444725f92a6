//! PLY files, as text or binary: x, y, z of the vertices. Other properties and elements are passed over.

use std::path::Path;

use super::{Kind, number};
use crate::error::ReadError;
use crate::text::lines;

/// What the header says of the vertices.
struct Header<'a> {
    format: &'a str,
    count: usize,
    /// Names and kinds of the properties of a vertex.
    properties: Vec<(&'a str, Kind)>,
    /// The bytes behind the header, and the number of its lines.
    rest: &'a [u8],
    lines: usize,
}

/// The points in the bytes of a PLY file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<[f64; 3]>, ReadError> {
    let header = header(path, bytes)?;
    let position = |name: &str| header.properties.iter().position(|(property, _)| *property == name);
    let (Some(x), Some(y), Some(z)) = (position("x"), position("y"), position("z")) else {
        let found: Vec<&str> = header.properties.iter().map(|(name, _)| *name).collect();
        let problem = format!("the vertices have the properties {}; expected x, y, z", found.join(", "));
        return Err(ReadError::new(path, problem));
    };
    let columns = [x, y, z];
    if header.format == "ascii" {
        return text(path, &header, columns);
    }
    let starts = columns.map(|column| header.properties[..column].iter().map(|(_, kind)| kind.size()).sum::<usize>());
    let size: usize = header.properties.iter().map(|(_, kind)| kind.size()).sum();
    let expected = header.count.checked_mul(size).filter(|length| *length <= header.rest.len());
    let Some(length) = expected else {
        let problem = format!(
            "the file ends {} bytes after its header; expected {} vertices of {size} bytes",
            header.rest.len(),
            header.count
        );
        return Err(ReadError::new(path, problem));
    };
    let big_endian = header.format == "binary_big_endian";
    let at = |vertex: &[u8], k: usize| number(&vertex[starts[k]..], header.properties[columns[k]].1, big_endian);
    Ok(header.rest[..length].chunks_exact(size).map(|vertex| [0, 1, 2].map(|k| at(vertex, k))).collect())
}

/// The vertices as lines of numbers.
fn text(path: &Path, header: &Header, columns: [usize; 3]) -> Result<Vec<[f64; 3]>, ReadError> {
    let text = std::str::from_utf8(header.rest)
        .map_err(|_| ReadError::new(path, "the vertices are not text, but the header says \"format ascii\""))?;
    let mut points = Vec::new();
    for line in lines(path, text).filter(|line| !line.text.is_empty()).take(header.count) {
        // The place in the file, not behind the header.
        let fail = |problem: String| ReadError::new(path, problem).at(line.number + header.lines, 0);
        let words: Vec<&str> = line.text.split_whitespace().collect();
        if words.len() < header.properties.len() {
            return Err(fail(format!(
                "found {} numbers; expected {} of a vertex",
                words.len(),
                header.properties.len()
            )));
        }
        let mut point = [0.0; 3];
        for (value, column) in point.iter_mut().zip(columns) {
            let word = words[column];
            let shown: String = word.chars().take(40).collect();
            *value = word.parse().map_err(|_| fail(format!("found \"{shown}\"; expected a number")))?;
        }
        points.push(point);
    }
    if points.len() < header.count {
        let problem = format!("the file ends after {} vertices; expected {}", points.len(), header.count);
        return Err(ReadError::new(path, problem));
    }
    Ok(points)
}

/// The header, up to `end_header`.
fn header<'a>(path: &Path, bytes: &'a [u8]) -> Result<Header<'a>, ReadError> {
    let mut header = Header { format: "", count: 0, properties: Vec::new(), rest: bytes, lines: 0 };
    // Whether there are vertices, and whether properties are theirs.
    let (mut any, mut of_vertices) = (false, false);
    loop {
        let end = header.rest.iter().position(|&byte| byte == b'\n');
        let line = end.and_then(|end| std::str::from_utf8(&header.rest[..end]).ok()).map(str::trim);
        let fail = |problem: String| Err(ReadError::new(path, problem).at(header.lines + 1, 0));
        let (Some(end), Some(line)) = (end, line) else {
            return fail("this is no PLY file: the header has no line \"end_header\"".to_owned());
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if header.lines == 0 => {}
            _ if header.lines == 0 => return fail("this is no PLY file: expected \"ply\"".to_owned()),
            ["format", format @ ("ascii" | "binary_little_endian" | "binary_big_endian"), "1.0"] => {
                header.format = format
            }
            ["format", ..] => {
                let expected = "ascii, binary_little_endian or binary_big_endian, version 1.0";
                return fail(format!("found \"{line}\"; expected the format {expected}"));
            }
            ["element", "vertex", count] => {
                let Ok(count) = count.parse() else {
                    return fail(format!("found \"{line}\"; expected a number of vertices"));
                };
                (header.count, any, of_vertices) = (count, true, true);
            }
            ["element", ..] if !any => return fail(format!("found \"{line}\"; expected the vertices first")),
            ["element", ..] => of_vertices = false,
            ["property", kind, name] if of_vertices => match kind_of(kind) {
                Some(kind) => header.properties.push((name, kind)),
                None => return fail(format!("found \"{line}\"; expected a number, such as \"property float {name}\"")),
            },
            ["property", ..] if of_vertices => {
                return fail(format!("found \"{line}\"; expected a number, not a list, for each vertex"));
            }
            ["end_header"] => {
                header.rest = &header.rest[end + 1..];
                header.lines += 1;
                break;
            }
            _ => {}
        }
        header.rest = &header.rest[end + 1..];
        header.lines += 1;
    }
    match (header.format, any) {
        ("", _) => Err(ReadError::new(path, "the header has no line \"format\"")),
        (_, false) => Err(ReadError::new(path, "the header has no \"element vertex\"")),
        _ => Ok(header),
    }
}

fn kind_of(name: &str) -> Option<Kind> {
    Some(match name {
        "char" | "int8" => Kind::I8,
        "uchar" | "uint8" => Kind::U8,
        "short" | "int16" => Kind::I16,
        "ushort" | "uint16" => Kind::U16,
        "int" | "int32" => Kind::I32,
        "uint" | "uint32" => Kind::U32,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

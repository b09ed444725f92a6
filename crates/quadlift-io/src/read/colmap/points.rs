//! The sparse points of a COLMAP model (`points3D`), as text or binary: the best of them, evenly spread.

use super::super::bytes::Bytes;
use super::File;
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::numbers::significant;
use crate::text::lines;

/// Default maximum number of points. They take 150 kB in a scene file.
pub(crate) const DEFAULT_POINTS: usize = 5000;

/// Significant digits of a point, relative to the extent of all points. COLMAP writes 17; triangulated points are not
/// known to more than four or five.
const DIGITS: i32 = 7;

/// A point with figures of its quality.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Point {
    pub id: u64,
    pub position: [f64; 3],
    /// Mean reprojection error in pixels; negative where COLMAP has not computed it.
    error: f64,
    /// Its observations: ids of images, and the places of its pixels in their lists of points.
    pub track: Box<[(u32, u32)]>,
}

impl Point {
    /// A point of which nothing else is known.
    pub(super) fn new(id: u64, position: [f64; 3]) -> Self {
        Self { id, position, error: -1.0, track: Box::default() }
    }

    /// Whether it is better known than another one: seen more often, then with the smaller error. Ids break ties.
    fn is_better(&self, other: &Self) -> bool {
        let error = |point: &Self| if point.error >= 0.0 { point.error } else { f64::INFINITY };
        (other.track.len().cmp(&self.track.len()))
            .then(error(self).total_cmp(&error(other)))
            .then(self.id.cmp(&other.id))
            .is_lt()
    }
}

/// The points in the bytes of `points3D.txt`. An empty file has none.
pub(super) fn parse_text(file: File) -> Result<Vec<Point>, ReadError> {
    let mut points = Vec::new();
    if file.1.is_empty() {
        return Ok(points);
    }
    for line in lines(file.0, as_utf8(file.0, file.1)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let id = fields.whole("a point id, a whole number")?;
        let position = fields.numbers("a position X Y Z")?;
        fields.numbers::<3>("a color R G B")?;
        let error = fields.number("an error, in pixels")?;
        let length = fields.rest().split_whitespace().count();
        if !length.is_multiple_of(2) {
            return Err(
                line.error(format!("the track has {length} numbers; expected pairs of IMAGE_ID and POINT2D_IDX"))
            );
        }
        let mut track = Vec::with_capacity(length / 2);
        while !fields.is_empty() {
            let image = fields.whole("an image id of the track, a whole number")?;
            track.push((image, fields.whole("the index of a point in the image, a whole number")?));
        }
        points.push(Point { id, position, error, track: track.into() });
    }
    Ok(points)
}

/// The points in the bytes of `points3D.bin`. An empty file has none.
pub(super) fn parse_binary(file: File) -> Result<Vec<Point>, ReadError> {
    let mut points = Vec::new();
    if file.1.is_empty() {
        return Ok(points);
    }
    let mut bytes = Bytes::new(file.0, file.1);
    // The count is not trusted: nothing is allocated for it.
    for _ in 0..bytes.u64("the number of points")? {
        let id = bytes.u64("a point id")?;
        let position = bytes.f64s("a position x, y, z")?;
        bytes.skip(1, 3, "color")?;
        let error = bytes.f64("an error, in pixels")?;
        let length = bytes.u64("the length of a track")?;
        let mut track = Vec::new();
        for _ in 0..length {
            track.push((bytes.u32("the image of an observation")?, bytes.u32("the index of a point in an image")?));
        }
        let track = track.into();
        points.push(Point { id, position, error, track });
    }
    bytes.end()?;
    Ok(points)
}

/// At most so many of the points, in the order of their ids, rounded. COLMAP numbers points as it triangulates them,
/// image by image: consecutive ids are divided into as many runs as requested points, and the best point of each run is
/// kept. The order in the file does not matter.
pub(super) fn chosen(mut points: Vec<Point>, most: usize) -> Vec<Point> {
    // Ids are unique in a model; if not, the positions decide.
    points.sort_by(|a, b| {
        let by_position =
            || a.position.iter().zip(&b.position).map(|(x, y)| x.total_cmp(y)).find(|order| order.is_ne());
        a.id.cmp(&b.id).then_with(|| by_position().unwrap_or(std::cmp::Ordering::Equal))
    });
    let (count, runs) = (points.len(), most.min(points.len()));
    let best = (0..runs).filter_map(|run| {
        let run = &points[run * count / runs..(run + 1) * count / runs];
        run.iter().reduce(|best, point| if point.is_better(best) { point } else { best })
    });
    let mut best: Vec<Point> = best.cloned().collect();
    let places = rounded(best.iter().map(|point| point.position).collect());
    best.iter_mut().zip(places).for_each(|(point, position)| point.position = position);
    best
}

/// The points with coordinates rounded to the decimal place that gives the extent of the points [`DIGITS`] digits. The extent
/// is that of the middle nine tenths in each coordinate: stray points do not count.
fn rounded(mut points: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let extent = (0..3).map(|axis| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_by(f64::total_cmp);
        let at = |tenths: usize| values.get(tenths * values.len().saturating_sub(1) / 20).copied().unwrap_or_default();
        at(19) - at(1)
    });
    let extent = extent.fold(0.0, f64::max);
    if extent > 0.0 && extent.is_finite() {
        let places = DIGITS - 1 - extent.log10().floor() as i32;
        for x in points.iter_mut().flatten() {
            // Digits of this number that reach the same decimal place.
            let digits = if *x == 0.0 { 1 } else { x.abs().log10().floor() as i32 + 1 + places };
            *x = if digits < 1 { 0.0 } else { significant(*x, digits.min(17)) };
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn point(id: u64, x: f64, error: f64, track: usize) -> Point {
        Point { id, position: [x, 0.0, 0.0], error, track: vec![(1, 0); track].into() }
    }

    #[test]
    fn the_best_point_of_each_run_of_ids_is_taken_in_any_order() {
        // Two runs of three: long tracks first, then small errors; an error that was not computed is the worst.
        let mut points = vec![
            point(1, 0.0, 0.1, 2),
            point(2, 1.0, 0.9, 5),
            point(3, 2.0, 0.5, 5),
            point(7, 3.0, -1.0, 4),
            point(8, 4.0, 2.0, 4),
            point(9, 5.0, 0.0, 3),
        ];
        let chosen = |points: Vec<Point>, most: usize| -> Vec<[f64; 3]> {
            super::chosen(points, most).iter().map(|point| point.position).collect()
        };
        let expected = vec![[2.0, 0.0, 0.0], [4.0, 0.0, 0.0]];
        assert_eq!(chosen(points.clone(), 2), expected);
        points.reverse();
        points.swap(1, 3);
        assert_eq!(chosen(points.clone(), 2), expected);
        assert_eq!(chosen(points.clone(), 100).len(), 6);
        assert_eq!(chosen(points.clone(), 4).len(), 4);
        assert_eq!(chosen(points, 0), Vec::<[f64; 3]>::new());
        assert_eq!(chosen(Vec::new(), 10), Vec::<[f64; 3]>::new());
    }

    #[test]
    fn coordinates_are_rounded_to_the_extent_of_the_points() {
        let points = |offset: f64, scale: f64| -> Vec<[f64; 3]> {
            (0..40).map(|k| [offset + scale * f64::from(k) / 7.0, 0.0, scale * 1e-12]).collect()
        };
        // 5 units wide: seven digits are six decimals, also far from the origin.
        let near = rounded(points(0.0, 1.0));
        assert_eq!((near[1], near[2][0]), ([0.142857, 0.0, 0.0], 0.285714));
        assert_eq!(rounded(points(1e5, 1.0))[1][0], 100000.142857);
        // Small and large units alike.
        assert_eq!(rounded(points(0.0, 1e-6))[1][0], 1.42857e-7);
        assert_eq!(rounded(points(0.0, 1e9))[1][0], 142857000.0);
        let one = vec![[0.1234567890123, 1.0, 2.0]];
        assert_eq!(rounded(one.clone()), one);
    }

    #[test]
    fn wrong_entries_are_refused_with_their_place() {
        let text = |content: &str| parse_text((Path::new("points3D.txt"), content.as_bytes())).unwrap_err().to_string();
        for (content, message) in [
            ("# x\nx 1 2 3\n", "points3D.txt:2: field 1 is \"x\"; expected a point id, a whole number"),
            ("1 0 nan 0 9 9 9 0.5\n", "points3D.txt:1: field 3 is \"nan\"; expected a position X Y Z"),
            ("1 0 0 0 9 9\n", "points3D.txt:1: the line ends after 6 fields; expected a color R G B"),
            (
                "1 0 0 0 9 9 9 0.5 1 2 3\n",
                "points3D.txt:1: the track has 3 numbers; expected pairs of IMAGE_ID and POINT2D_IDX",
            ),
        ] {
            assert_eq!(text(content), message);
        }
        let mut bytes = Vec::new();
        bytes.extend(2u64.to_le_bytes());
        bytes.extend(5u64.to_le_bytes());
        [0.5, -1.0, 2.0].iter().for_each(|x: &f64| bytes.extend(x.to_le_bytes()));
        bytes.extend([1, 2, 3]);
        bytes.extend(0.25f64.to_le_bytes());
        bytes.extend(2u64.to_le_bytes());
        bytes.extend([0; 16]);
        let binary = |bytes: &[u8]| parse_binary((Path::new("points3D.bin"), bytes));
        assert_eq!(
            binary(&bytes).unwrap_err().to_string(),
            "points3D.bin: byte 75: the file ends 0 bytes after this; expected a point id, 8 bytes"
        );
        bytes[0] = 1;
        let expected = Point { id: 5, position: [0.5, -1.0, 2.0], error: 0.25, track: [(0, 0), (0, 0)].into() };
        assert_eq!(binary(&bytes), Ok(vec![expected.clone()]));
        assert_eq!(parse_text((Path::new("a"), b"5 0.5 -1 2 1 2 3 0.25 0 0 0 0\n")), Ok(vec![expected]));
        assert_eq!((binary(b""), parse_text((Path::new("a"), b"# none\n"))), (Ok(Vec::new()), Ok(Vec::new())));
        // A track that is longer than the file.
        bytes[51] = 255;
        assert!(binary(&bytes).unwrap_err().problem.contains("expected the image of an observation"));
        bytes.push(0);
        bytes[51] = 2;
        assert!(binary(&bytes).unwrap_err().problem.contains("expected the end of the file; found 1 more bytes"));
    }
}

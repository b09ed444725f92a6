//! Boxer's CSV of oriented 3D boxes per frame (`boxer_3dbbs.csv`), also written by WildDet3D and Meta's Aria tools.
//!
//! Positions and full extents in meters, quaternions of `world_from_object` with w first. Images are matched by time. There are
//! no boxes in pixels: the detections are 3D boxes alone.

use std::collections::BTreeMap;
use std::path::Path;

use super::csv::table;
use super::files::{Detected, DetectedImage, DetectionFiles, DetectionFormat, ImageKey};
use super::table::Row;
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::read::format::Format;
use crate::scene_file::Box3dRecord;

/// The columns that are needed, in the order of the file.
const NUMBERS: [&str; 11] = [
    "time_ns",
    "tx_world_object",
    "ty_world_object",
    "tz_world_object",
    "qw_world_object",
    "qx_world_object",
    "qy_world_object",
    "qz_world_object",
    "scale_x",
    "scale_y",
    "scale_z",
];

/// Largest difference of a quaternion's norm from 1 that is rounding.
const ROUNDING: f64 = 1e-3;

/// Whether the first line of a table is that of Boxer.
fn is_header(columns: &[String]) -> bool {
    NUMBERS.iter().all(|name| columns.iter().any(|column| column.trim() == *name))
}

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "boxer",
    title: "Boxer's 3D boxes",
    about: "Boxer's and WildDet3D's CSV of 3D boxes per frame, matched by time",
    looks: "Boxer (a column time_ns and 3D boxes)",
    options: &[],
    finds: |probe| probe.when(probe.line()?.is_some_and(|line| line.commas && is_header(&line.words))),
    read: |path, _| parse_boxer(path, &read_bytes(path)?),
};

/// The detections in the bytes of a file; the path serves for messages.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
pub(super) fn parse_boxer(path: &Path, bytes: &[u8]) -> Result<DetectionFiles, ReadError> {
    let table = table(path, as_utf8(path, bytes)?)?;
    let column = |name: &str| table.columns.iter().position(|column| column == name);
    let mut columns = [0; 11];
    for (place, name) in columns.iter_mut().zip(NUMBERS) {
        *place = column(name).ok_or_else(|| {
            ReadError::new(path, format!("there is no column {name}; expected {} ...", NUMBERS.join(", "))).at(1, 0)
        })?;
    }
    let (name, instance, prob) = (column("name"), column("instance"), column("prob"));
    let mut images: BTreeMap<i64, Vec<Detected>> = BTreeMap::new();
    for row in &table.rows {
        let error = |problem: String| ReadError::new(path, problem).at(row.line.unwrap_or(0), 0);
        let cell = |column: Option<usize>| column.and_then(|k| row.cells.get(k)).filter(|cell| !cell.is_empty());
        let (time, box3d) = measured(row, &columns).map_err(error)?;
        let score = match cell(prob) {
            Some(text) => Some(
                text.parse::<f64>()
                    .ok()
                    .filter(|x| x.is_finite())
                    .ok_or_else(|| error(format!("the column prob has \"{text}\"; expected a number")))?,
            ),
            None => None,
        };
        // Negative instances are boxes without an object.
        let track = cell(instance).filter(|id| !id.starts_with('-')).cloned();
        let box3d = Some(Box::new(box3d));
        let detected = Detected { track, category: cell(name).cloned(), score, box3d, ..Default::default() };
        images.entry(time).or_default().push(detected);
    }
    let mut notes = Vec::new();
    if counts_per_image(&images) {
        notes.push("in every image instance counts the boxes from 0: it names no objects, and is not used".to_owned());
        images.values_mut().flatten().for_each(|detected| detected.track = None);
    }
    let image = |(time, detections): (i64, Vec<Detected>)| DetectedImage {
        key: ImageKey { time: Some(time as f64 * 1e-9), ..Default::default() },
        detections,
    };
    Ok(DetectionFiles {
        path: path.to_owned(),
        images: images.into_iter().map(image).collect(),
        notes,
        ..Default::default()
    })
}

/// Time in nanoseconds and box of a row.
fn measured(row: &Row, columns: &[usize; 11]) -> Result<(i64, Box3dRecord), String> {
    let cell = |k: usize| row.cells.get(columns[k]).map_or("", String::as_str);
    let wrong = |k: usize, what: &str| format!("the column {} has \"{}\"; expected {what}", NUMBERS[k], cell(k));
    let time = cell(0).parse().map_err(|_| wrong(0, "a whole number of nanoseconds"))?;
    let mut numbers = [0.0; 10];
    for (k, number) in numbers.iter_mut().enumerate() {
        let parsed = cell(k + 1).parse::<f64>().ok().filter(|x: &f64| x.is_finite());
        *number = parsed.ok_or_else(|| wrong(k + 1, "a number"))?;
    }
    let [x, y, z, qw, qx, qy, qz, sx, sy, sz] = numbers;
    let norm = (qw * qw + qx * qx + qy * qy + qz * qz).sqrt();
    if (norm - 1.0).abs() > ROUNDING {
        return Err(format!("the quaternion {:?} has the norm {norm:.3}; expected 1", [qw, qx, qy, qz]));
    }
    if [sx, sy, sz].iter().any(|size| *size <= 0.0) {
        return Err(format!("the scale is {sx}, {sy}, {sz}; expected three positive numbers"));
    }
    let record = Box3dRecord {
        center: Some([x, y, z]),
        half_extents: Some([sx, sy, sz].map(|size| 0.5 * size)),
        rotation: Some([qw, qx, qy, qz].map(|q| q / norm)),
        frame: Some("world".into()),
        source: Some("boxer".into()),
        ..Default::default()
    };
    Ok((time, record))
}

/// Whether instances count the boxes of each image, as detectors of single images write them. One image tells nothing.
fn counts_per_image(images: &BTreeMap<i64, Vec<Detected>>) -> bool {
    let counts = |detections: &Vec<Detected>| {
        detections.iter().enumerate().all(|(k, detected)| detected.track.as_deref() == Some(k.to_string().as_str()))
    };
    // Where all images have the same boxes they may also be the same objects.
    let mut lengths: Vec<usize> = images.values().map(Vec::len).collect();
    lengths.sort_unstable();
    lengths.dedup();
    lengths.len() > 1 && images.values().all(counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,\
                          qy_world_object,qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob\n";

    fn parse(rows: &str) -> Result<DetectionFiles, ReadError> {
        parse_boxer(Path::new("boxer_3dbbs.csv"), format!("{HEADER}{rows}").as_bytes())
    }

    #[test]
    fn rows_are_boxes_of_images_by_time() {
        let rows = "2500000000,1,2,3,0.5,0.5,0.5,0.5,4,2,1,car,7,0,0.9\n1250000000,1,2,3,1,0,0,0,4,2,1,,-1,0,\n\
                    2500000000,5,2,3,1,0,0,0,1,1,1,cup,8,0,0.25\n";
        let read = parse(rows).unwrap();
        let times: Vec<_> = read.images.iter().map(|image| (image.key.time.unwrap(), image.detections.len())).collect();
        assert_eq!(times, [(1.25, 1), (2.5, 2)]);
        let [first, ..] = &read.images[1].detections[..] else { panic!() };
        assert_eq!(
            (first.track.as_deref(), first.category.as_deref(), first.score),
            (Some("7"), Some("car"), Some(0.9))
        );
        let box3d = first.box3d.as_deref().unwrap();
        assert_eq!((box3d.center, box3d.half_extents), (Some([1.0, 2.0, 3.0]), Some([2.0, 1.0, 0.5])));
        assert_eq!((box3d.rotation, box3d.frame.as_deref()), (Some([0.5; 4]), Some("world")));
        let nameless = &read.images[0].detections[0];
        assert_eq!((&nameless.track, &nameless.category, nameless.score), (&None, &None, None));
        assert!(read.notes.is_empty());
    }

    #[test]
    fn instances_that_count_the_boxes_of_each_image_name_no_objects() {
        let row = |time: u32, instance: u32| format!("{time},1,2,3,1,0,0,0,4,2,1,car,{instance},0,1\n");
        let read = parse(&(row(1, 0) + &row(1, 1) + &row(2, 0))).unwrap();
        assert!(read.images.iter().flat_map(|image| &image.detections).all(|d| d.track.is_none()));
        assert!(read.notes[0].contains("names no objects"), "{:?}", read.notes);
        assert!(parse(&(row(1, 0) + &row(1, 1) + &row(2, 1))).unwrap().notes.is_empty());
    }

    #[test]
    fn wrong_rows_are_named() {
        let problem = |rows: &str| parse(rows).unwrap_err().to_string();
        assert!(problem("a,1,2,3,1,0,0,0,4,2,1,car,0,0,1\n").contains("time_ns has \"a\""));
        assert!(problem("1,1,2,x,1,0,0,0,4,2,1,car,0,0,1\n").contains("tz_world_object has \"x\""));
        assert!(problem("1,1,2,3,2,0,0,0,4,2,1,car,0,0,1\n").contains("the norm 2.000"));
        assert!(problem("1,1,2,3,1,0,0,0,4,0,1,car,0,0,1\n").contains("the scale is 4, 0, 1"));
        let missing = parse_boxer(Path::new("a.csv"), b"time_ns,name\n").unwrap_err().to_string();
        assert!(missing.contains("there is no column tx_world_object"), "{missing}");
    }
}

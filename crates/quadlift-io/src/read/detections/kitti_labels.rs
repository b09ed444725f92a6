//! KITTI's labels and results: a file of the tracking benchmark for a sequence, or files of the object benchmark, one
//! for each image.
//!
//! Boxes are left, top, right, bottom. Format: the `readme.txt` of the devkits.

use std::path::Path;

use super::files::{
    ByImage, Detected, DetectionFiles, DetectionFormat, ImageKey, LabelFile, Numbering, checked_edges, label_files,
};
use crate::error::ReadError;
use crate::input::as_utf8;
use crate::read::format::Format;
use crate::read::kitti_labels::{Benchmark, KittiLabel, parse_labels_of};
use crate::text::lines;
use crate::wording::count;

/// The row of this format.
pub(super) const FORMAT: DetectionFormat = Format {
    name: "kitti-labels",
    title: "KITTI labels",
    about: "KITTI labels or results of the tracking or object benchmark",
    looks: "KITTI labels (15 to 18 fields)",
    options: &["pixel_centers"],
    finds: |probe| {
        let Some(first) = probe.labels("txt")? else { return Ok(None) };
        let Some(line) = first.line()?.filter(|line| !line.commas) else { return Ok(None) };
        let is_number = |index: usize| line.numbers().get(index).is_some_and(Option::is_some);
        probe.when(match line.words.len() {
            15 | 16 => !is_number(0),
            17 | 18 => is_number(0) && !is_number(2),
            _ => false,
        })
    },
    read: |path, _| parse_kitti_labels(path, &label_files(path, "txt")?),
};

/// The detections in label files; the path is that of their folder and serves for messages.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
pub(super) fn parse_kitti_labels(path: &Path, files: &[LabelFile]) -> Result<DetectionFiles, ReadError> {
    let mut found = ByImage::default();
    let (mut with_tracks, mut unlabeled) = (false, 0);
    for file in files {
        let benchmark = benchmark(file)?;
        with_tracks |= benchmark == Benchmark::Tracking;
        if with_tracks && files.len() > 1 {
            let problem = "this is a file of the tracking benchmark, which holds a whole sequence; pass only this file";
            return Err(ReadError::new(&file.path, problem));
        }
        let key = |number| match benchmark {
            Benchmark::Tracking => ImageKey { number: Some(number), ..ImageKey::default() },
            Benchmark::Object => ImageKey { name: Some(file.name.clone()), ..ImageKey::default() },
        };
        if file.bytes.trim_ascii().is_empty() {
            // An image without objects.
            found.image(key(0));
            continue;
        }
        for label in parse_labels_of(&file.path, &file.bytes, benchmark)? {
            let image = found.image(key(label.frame as i64));
            if label.kind == "DontCare" {
                unlabeled += 1;
                continue;
            }
            let line = label.line;
            let in_line = |problem: String| ReadError::new(&file.path, problem).at(line, 0);
            image.detections.push(detected(label).map_err(in_line)?);
        }
    }
    let kind = match with_tracks {
        true => "labels of the tracking benchmark, frames numbered from 0",
        false => "labels of the object benchmark, one file for each image",
    };
    let mut notes = vec![kind.to_owned()];
    if unlabeled > 0 {
        notes.push(format!("skipped: {}", count(unlabeled, "DontCare region")));
    }
    Ok(DetectionFiles {
        path: path.to_owned(),
        images: found.images,
        numbering: Numbering::OfNames,
        notes,
        ..DetectionFiles::default()
    })
}

/// The benchmark of a file by its first line.
fn benchmark(file: &LabelFile) -> Result<Benchmark, ReadError> {
    if file.bytes.trim_ascii().is_empty() {
        return Ok(Benchmark::Object);
    }
    let text = as_utf8(&file.path, &file.bytes)?;
    let Some(first) = lines(&file.path, text).find(|line| !line.is_blank_or_comment()) else {
        return Ok(Benchmark::Object);
    };
    match first.text.split_whitespace().count() {
        15 | 16 => Ok(Benchmark::Object),
        17 | 18 => Ok(Benchmark::Tracking),
        count => Err(first.error(format!(
            "found {count} fields; expected 17 or 18 (tracking: frame, id, type, ...) or 15 or 16 (objects: type, ...)"
        ))),
    }
}

fn detected(label: KittiLabel) -> Result<Detected, String> {
    let level = |level: f64| (level >= 0.0).then_some(level);
    Ok(Detected {
        track: (label.track >= 0).then(|| label.track.to_string()),
        category: Some(label.kind.to_lowercase()),
        score: label.score,
        bounding_box: Some(checked_edges(label.bounding_box)?),
        occluded: level(label.occluded),
        truncated: level(label.truncated),
        ..Detected::default()
    })
}

//! Four sequences of KITTI's tracking benchmark with detections: all boxes of RRC, of parked and moving cars, and poses
//! from GPS and IMU.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use quadlift::association::{AssociateOptions, IdPolicy};
use quadlift::geometry::BoundingBox;
use quadlift_io::formats::read_cameras;
use quadlift_io::read::ReadOptions;
use quadlift_io::scene_file::DetectionRecord;
use quadlift_io::{EntryError, ReadError, SceneFile};
use rayon::prelude::*;

use super::case::{Case, CaseScore, Marked};
use super::headline;
use crate::error::Error;
use crate::progress::Steps;
use crate::report::Report;
use crate::table::{Cell, Table};

/// A sequence: name, headline, the least F1 demanded; of the prototype F1, share of the centers found and false
/// objects.
const SEQUENCES: [(&str, &str, f64, [f64; 3]); 4] = [
    ("0000", "association_video_0000", 0.98, [0.997, 1.0, 6.0]),
    ("0001", "association_video_0001", 0.98, [0.989, 0.947, 16.0]),
    ("0007", "association_video_0007", 0.91, [0.918, 0.918, 8.0]),
    ("0009", "association_video_0009", 0.96, [0.969, 0.985, 5.0]),
];

/// Boxes with a lower score are skipped.
const MIN_SCORE: f64 = 0.5;

/// A box shows a labeled car when their intersection over union is greater.
const MIN_OVERLAP: f64 = 0.5;

/// For each detection the id of the label that it shows.
type Shown = Vec<Option<Box<str>>>;

/// Reads a sequence: a scene with the true cars and the boxes of the detector, without ids, and what they show.
fn read(data: &Path, sequence: &str) -> Result<(SceneFile, Shown), Error> {
    let folder = data.join("kitti_tracking");
    let options = ReadOptions { sequence: Some(sequence.to_owned()), ..ReadOptions::default() };
    let mut file = read_cameras(&folder, &options)?.scene;
    file.objects.retain(|object| is_car(object.category.as_deref()));
    let labels: Vec<DetectionRecord> =
        std::mem::take(&mut file.detections).into_iter().filter(|d| is_car(d.category.as_deref())).collect();
    file.detections = read_boxes(&boxes_path(data, sequence))?;
    let shown = labels_of(&file.detections, &labels);
    let objects = shown.into_iter().map(|label| labels[label?].object.clone()).collect();
    Ok((file, objects))
}

fn boxes_path(data: &Path, sequence: &str) -> PathBuf {
    data.join("kitti_tracking").join("det_rrc").join(format!("{sequence}.txt"))
}

/// Which standing car each detection shows.
fn case(data: &Path, sequence: &str) -> Result<Case, Error> {
    let (file, shown) = read(data, sequence)?;
    let path = boxes_path(data, sequence);
    let in_file = |error: EntryError| error.in_file(&path);
    let objects = file.to_objects().map_err(in_file)?;
    let bodies = objects.iter().filter_map(|o| Some((o.id.as_str(), o.ellipsoid()?)));
    let (ids, bodies): (Vec<&str>, Vec<_>) = bodies.unzip();
    let by_id: HashMap<&str, u32> = ids.into_iter().zip(0..).collect();
    let true_objects = shown.iter().map(|id| by_id.get(id.as_deref()?).copied()).collect();
    Ok(Case { scene: file.to_scene().map_err(in_file)?, true_objects, bodies })
}

/// Every sequence as a scene whose detections name the true cars that stand.
///
/// # Errors
/// [`Error::Read`].
pub(crate) fn with_true_ids(data: &Path) -> Result<Vec<(String, SceneFile)>, Error> {
    let of = |name: &str| -> Result<_, Error> {
        let (mut file, shown) = read(data, name)?;
        for (record, shown) in file.detections.iter_mut().zip(shown) {
            record.object = shown.filter(|id| file.objects.iter().any(|object| *object.id == **id));
        }
        Ok((name.to_owned(), file))
    };
    SEQUENCES.iter().map(|(name, ..)| of(name)).collect()
}

fn is_car(category: Option<&str>) -> bool {
    matches!(category, Some("car" | "van"))
}

/// The boxes of the detector: lines of frame, x0, y0, x1, y1, score.
fn read_boxes(path: &Path) -> Result<Vec<DetectionRecord>, ReadError> {
    let text = std::fs::read_to_string(path).map_err(|error| ReadError::new(path, error.to_string()))?;
    let mut detections = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let wrong = || ReadError::new(path, "expected frame,x0,y0,x1,y1,score").at(index + 1, 0);
        let fields: Vec<f64> = line.split(',').map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
        let [frame, x0, y0, x1, y1, score] = fields[..] else { return Err(wrong()) };
        if score >= MIN_SCORE {
            detections.push(DetectionRecord {
                frame: format!("{frame:06}").into(),
                score: Some(score),
                bounding_box: Some([x0, y0, x1, y1]),
                ..Default::default()
            });
        }
    }
    Ok(detections)
}

/// For each detection the label that it shows, each label once: those that overlap most first.
fn labels_of(detections: &[DetectionRecord], labels: &[DetectionRecord]) -> Vec<Option<usize>> {
    let bounds = |record: &DetectionRecord| BoundingBox::new(record.bounding_box?).ok();
    let mut in_frame: HashMap<&str, Vec<usize>> = HashMap::new();
    for (index, label) in labels.iter().enumerate() {
        in_frame.entry(&label.frame).or_default().push(index);
    }
    let mut pairs = Vec::new();
    for (index, detection) in detections.iter().enumerate() {
        for &label in in_frame.get(&*detection.frame).map_or(&[][..], Vec::as_slice) {
            if let (Some(a), Some(b)) = (bounds(detection), bounds(&labels[label])) {
                pairs.push((a.iou(&b), index, label));
            }
        }
    }
    pairs.retain(|pair| pair.0 > MIN_OVERLAP);
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let (mut shown, mut taken) = (vec![None; detections.len()], vec![false; labels.len()]);
    for (_, detection, label) in pairs {
        if shown[detection].is_none() && !taken[label] {
            shown[detection] = Some(label);
            taken[label] = true;
        }
    }
    shown
}

/// All sequences.
///
/// # Errors
/// [`Error::Read`].
pub(crate) fn cases(data: &Path) -> Result<Vec<Case>, Error> {
    SEQUENCES.par_iter().map(|(name, ..)| case(data, name)).collect()
}

/// Number of steps.
pub(crate) fn steps() -> usize {
    SEQUENCES.len()
}

/// Adds the table and its headlines.
///
/// # Errors
/// [`Error::Read`], [`Error::Associate`], [`Error::Localize`].
pub(crate) fn add(data: &Path, report: &mut Report, steps: &Steps) -> Result<(), Error> {
    let options = AssociateOptions { ids: IdPolicy::Ignore, ..Default::default() };
    let score = |(name, ..): &(&str, &str, f64, [f64; 3])| {
        let case = case(data, name)?;
        let score = case.score(&options)?;
        steps.done();
        Ok((case, score))
    };
    let scores: Vec<(Case, CaseScore)> = SEQUENCES.par_iter().map(score).collect::<Result<_, Error>>()?;
    let columns = [
        "sequence",
        "frames",
        "boxes",
        "F1, prototype",
        "aim",
        "F1",
        "standing cars",
        "centers found, prototype",
        "centers found",
        "false, prototype",
        "false objects",
        "uncertain ones",
        "true objects",
        "uncertain true ones",
        "O3D",
        "O3D, true ids",
    ];
    let mut table = Table::new("KITTI tracking, all RRC boxes", columns);
    let (mut of_false, mut of_true) = (Marked::default(), Marked::default());
    for ((name, id, aim, [f1, recall, false_objects]), (case, score)) in SEQUENCES.into_iter().zip(&scores) {
        let whole = |n: usize| Cell::number(n as f64, 0);
        table.push(vec![
            name.into(),
            whole(case.scene.frames.len()),
            whole(case.scene.detections.len()),
            Cell::number(f1, 3),
            Cell::number(aim, 3),
            Cell::number(score.division.f1, 3),
            whole(score.found.true_objects),
            Cell::number(recall, 3),
            score.centers_found.map_or(Cell::Empty, |x| Cell::number(x, 3)),
            Cell::number(false_objects, 0),
            whole(score.false_objects.objects),
            whole(score.false_objects.uncertain),
            whole(score.standing.objects),
            whole(score.standing.uncertain),
            Cell::number(score.o3d, 3),
            Cell::number(score.o3d_with_true_ids, 3),
        ]);
        report.headlines.extend(headline(
            id,
            format!("F1, KITTI tracking {name}, all RRC boxes"),
            Some(score.division.f1),
            "associate",
        ));
        (of_false, of_true) = (of_false.and(score.false_objects), of_true.and(score.standing));
    }
    table.note(format!(
        "Boxes with a score of {MIN_SCORE} or more; default settings. Poses from GPS and IMU. A true object is a \
         static car that is detected at least three times; its center is found if an object lies within its longest \
         semi-axis. A found object is false if most of its boxes show something else, usually a moving car. Aims for \
         all sequences together: at least half of the false ones uncertain, and at most 5 % of the true ones."
    ));
    report.table(table);
    for (id, what, marked) in [
        ("association_uncertain_false", "share of false objects marked as uncertain", of_false),
        ("association_uncertain_true", "share of true objects marked as uncertain", of_true),
    ] {
        report.headlines.extend(headline(id, format!("{what}, KITTI tracking"), marked.share(), "associate"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(frame: &str, edges: [f64; 4]) -> DetectionRecord {
        DetectionRecord { frame: frame.into(), bounding_box: Some(edges), ..Default::default() }
    }

    #[test]
    fn each_label_is_shown_once_by_the_box_that_fits_best() {
        let labels = [record("a", [0.0, 0.0, 10.0, 10.0]), record("b", [0.0, 0.0, 10.0, 10.0])];
        let detections = [
            record("a", [0.0, 0.0, 10.0, 8.0]),
            record("a", [0.0, 0.0, 10.0, 9.0]),
            record("a", [9.0, 0.0, 19.0, 10.0]),
            record("b", [1.0, 0.0, 10.0, 10.0]),
        ];
        assert_eq!(labels_of(&detections, &labels), [None, Some(0), None, Some(1)]);
    }
}

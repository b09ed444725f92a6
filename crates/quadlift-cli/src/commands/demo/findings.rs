//! Results on the desk, compared with the ground truth.

use std::collections::{BTreeMap, HashMap, HashSet};

use quadlift::geometry::{Body, ConvexBody};
use quadlift_io::SceneFile;
use quadlift_io::scene_file::{ObjectBodies, ObjectRecord};
use quadlift_report::Labels;
use serde_json::{Value, json};

use super::desk::Desk;
use crate::output::DIM;
use crate::table::{Cell, Table, number};

/// The result of localizing the desk.
pub(super) struct Findings<'a> {
    desk: &'a Desk,
    result: &'a SceneFile,
    /// For each object of the result, its body and the thing it shows.
    bodies: Vec<Option<Body>>,
    things: Vec<Option<usize>>,
}

/// Numbers of detections and of rejected ones.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Boxes {
    pub all: usize,
    /// Of nothing, or quite wrong.
    pub wrong: usize,
    /// Rejected wrong detections, and rejected correct ones.
    pub wrong_refused: usize,
    pub right_refused: usize,
}

impl<'a> Findings<'a> {
    /// Compares a result, which has the detections of the scene, with the ground truth. An object is matched to the
    /// true object with which it shares the most detections.
    pub(super) fn new(desk: &'a Desk, result: &'a SceneFile) -> anyhow::Result<Self> {
        let mut shared: HashMap<&str, BTreeMap<usize, usize>> = HashMap::new();
        for (record, thing) in result.detections.iter().zip(&desk.true_objects) {
            if let (Some(object), Some(thing)) = (&record.object, thing) {
                *shared.entry(object).or_default().entry(*thing).or_default() += 1;
            }
        }
        let most = |object: &ObjectRecord| {
            let counts = shared.get(object.id.as_str())?;
            // Of equally many the first.
            counts.iter().max_by_key(|(thing, count)| (**count, std::cmp::Reverse(**thing))).map(|(thing, _)| *thing)
        };
        let bodies = result.to_objects()?.iter().map(ObjectBodies::body).collect();
        Ok(Self { desk, result, bodies, things: result.objects.iter().map(most).collect() })
    }

    /// Objects that were localized.
    fn localized(&self) -> impl Iterator<Item = (&ObjectRecord, Option<Body>, Option<usize>)> {
        let rows = self.result.objects.iter().zip(&self.bodies).zip(&self.things);
        let rows = rows.map(|((object, body), thing)| (object, *body, *thing));
        rows.filter(|(object, ..)| object.status.as_deref() == Some("ok"))
    }

    /// Numbers of found and of true objects.
    pub(super) fn found(&self) -> [usize; 2] {
        let found: HashSet<usize> = self.localized().filter_map(|(.., thing)| thing).collect();
        [found.len(), self.desk.truth.len()]
    }

    /// Names of the things that were not found.
    pub(super) fn missing(&self) -> Vec<String> {
        let found: HashSet<usize> = self.localized().filter_map(|(.., thing)| thing).collect();
        let names = self.desk.truth.iter().enumerate().filter(|(thing, _)| !found.contains(thing));
        names.map(|(_, (name, _))| name.clone()).collect()
    }

    /// Counts of boxes.
    pub(super) fn boxes(&self) -> Boxes {
        let used: HashSet<(&str, &str)> = self
            .localized()
            .flat_map(|(object, ..)| {
                let used = object.view_residuals_px.iter().filter(|view| view.inlier);
                used.map(|view| (object.id.as_str(), view.frame.as_str()))
            })
            .collect();
        let mut boxes = Boxes::default();
        for (record, &wrong) in self.result.detections.iter().zip(&self.desk.outliers) {
            let is_used = record.object.as_deref().is_some_and(|object| used.contains(&(object, &*record.frame)));
            boxes.all += 1;
            boxes.wrong += usize::from(wrong);
            boxes.wrong_refused += usize::from(wrong && !is_used);
            boxes.right_refused += usize::from(!wrong && !is_used);
        }
        boxes
    }

    /// Distance of an object's center from that of its thing, meters.
    fn off(&self, object: &ObjectRecord, thing: Option<usize>) -> Option<f64> {
        let truth = self.desk.truth.get(thing?)?.1.as_ref()?.center();
        let center = object.center?;
        Some((0..3).map(|axis| (center[axis] - truth[axis]).powi(2)).sum::<f64>().sqrt())
    }

    /// One row per object: category, number of views, size, uncertainty and error.
    pub(super) fn table(&self) -> String {
        let mut table = Table::new(["<object", "views", "size [m]", "sd of center [m]", "error of center [m]"]);
        let labels = Labels::of_file(self.result);
        for (object, body, thing) in self.localized() {
            let views = object.views_used.unwrap_or(0);
            let sizes = body.map(|body| {
                let mut sizes: [f64; 3] = (body.half_extents * 2.0).into();
                sizes.sort_by(|a, b| b.total_cmp(a));
                sizes.map(|x| number(Some(x), 3)).join(" x ")
            });
            let off = self.off(object, thing);
            table.push(vec![
                Cell::from(labels.of(&object.id)),
                Cell::from(views.to_string()),
                Cell::from(sizes.unwrap_or_default()),
                Cell::from(number(object.center_sd, 3)),
                match off {
                    Some(_) => Cell::from(number(off, 3)),
                    None => Cell::styled("no true object", DIM),
                },
            ]);
        }
        table.render()
    }

    /// The same for programs.
    pub(super) fn to_json(&self) -> Value {
        let boxes = self.boxes();
        let objects: Vec<Value> = self
            .localized()
            .map(|(object, _, thing)| {
                json!({
                    "id": object.id,
                    "category": object.category,
                    "shows": thing.map(|thing| &self.desk.truth[thing].0),
                    "views": object.views_used,
                    "center_sd": object.center_sd,
                    "off": self.off(object, thing),
                })
            })
            .collect();
        let [found, things] = self.found();
        json!({
            "true_objects": things,
            "found": found,
            "objects": objects,
            "boxes": { "all": boxes.all, "wrong": boxes.wrong, "wrong_refused": boxes.wrong_refused,
                       "right_refused": boxes.right_refused },
        })
    }
}

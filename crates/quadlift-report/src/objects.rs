//! The objects of a report: estimated, true and detected ones, joined.

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3};
use quadlift::geometry::{Body, Ellipsoid};
use quadlift::scene::Detection;
use quadlift_io::EntryError;
use quadlift_io::scene_file::{ObjectBodies, ObjectRecord};

use crate::content::{Content, MAX_OBJECTS};
use crate::data::{ReportAlternative, ReportBody, ReportObject, ReportScores, ScoreRow};
use crate::scores::{Scores, TrueObjectScores};

/// The objects of a report and their indices.
#[derive(Debug, Default)]
pub(crate) struct Objects {
    /// The objects: estimates, then objects that are only in the ground truth, then objects that were only detected.
    pub list: Vec<ReportObject>,
    /// Names of the categories.
    pub categories: Vec<String>,
    /// By the ids that detections name: those of the estimates first, then those of the truth.
    pub by_id: HashMap<String, usize>,
    by_true_id: HashMap<String, usize>,
}

impl Objects {
    /// Estimates first, then objects that are only in the ground truth, then objects that were only detected. Regions of centers
    /// end at a squared distance of `limit`.
    pub(crate) fn gather(
        content: &Content,
        limit: f64,
        is_shown: impl Fn(&&Detection) -> bool,
    ) -> Result<Self, EntryError> {
        let scene = content.scene;
        let mut objects = Self::default();
        if let Some(file) = content.estimate {
            for (index, (record, bodies)) in file.objects.iter().zip(file.to_objects()?).enumerate() {
                let others = record.to_alternatives(&format!("objects[{index}]"))?;
                objects.estimate(record, bodies, &others, limit);
            }
        }
        if let Some(file) = content.truth {
            let rows = content.scores.map_or(&[][..], |scores| &scores.rows);
            let partners: HashMap<&str, Option<&str>> =
                rows.iter().map(|row| (&*row.id, row.estimate.as_deref())).collect();
            for bodies in file.to_objects()? {
                // Ids may be those of an association, which mean nothing to the truth: then the scores have the pairs.
                let id = bodies.id.clone();
                let partner = partners.get(&*id).copied().unwrap_or(Some(&id));
                objects.truth(bodies, partner);
            }
        }
        for detection in scene.detections.iter().filter(is_shown) {
            let category = detection.category_index.and_then(|index| scene.categories.get(index as usize));
            if let Some(id) = detection.object_index.and_then(|index| scene.object_ids.get(index as usize)) {
                objects.entry(id, category);
            }
        }
        Ok(objects)
    }

    /// The entry of an object, made if there is none.
    fn entry(&mut self, id: &str, category: Option<&String>) -> &mut ReportObject {
        let index = match self.by_id.get(id) {
            Some(&index) => index,
            None => self.add(id),
        };
        self.of_category(index, category)
    }

    /// A new entry; `by_id` leads to the first with its id.
    fn add(&mut self, id: &str) -> usize {
        let index = self.list.len();
        self.by_id.entry(id.to_owned()).or_insert(index);
        self.list.push(ReportObject { id: id.to_owned(), category: -1, ..Default::default() });
        index
    }

    /// An entry, with this category if it had none.
    fn of_category(&mut self, index: usize, category: Option<&String>) -> &mut ReportObject {
        let object = &mut self.list[index];
        if let (Some(name), -1) = (category, object.category) {
            let known = self.categories.iter().position(|known| known == name);
            let place = known.unwrap_or_else(|| {
                self.categories.push(name.clone());
                self.categories.len() - 1
            });
            object.category = place as i64;
        }
        object
    }

    /// An estimate with the other bodies that fit as well; `limit` is the squared distance at which the region of its center
    /// ends.
    fn estimate(&mut self, record: &ObjectRecord, bodies: ObjectBodies, others: &[(Body, f64)], limit: f64) {
        if record.status.is_none() {
            // An object without a status is not an estimate: in a scene that was never localized it is ground truth.
            return self.truth(bodies, Some(&record.id));
        }
        let shell = bodies.covariance.as_ref().zip(bodies.center).and_then(|(covariance, center)| {
            let shape: Matrix3<f64> = covariance.matrix.fixed_view::<3, 3>(0, 0) * limit;
            Ellipsoid::from_shape(center, &shape).ok()
        });
        let object = self.entry(&record.id, record.category.as_ref());
        object.status = record.status.clone();
        object.center = bodies.center.map(|center: Point3<f64>| center.coords.into());
        object.center_sd = record.center_sd;
        object.half_extents_sd = record.half_extents_sd;
        object.rotation_sd_deg = record.rotation_sd_deg;
        object.center_shell = shell.map(|shell| (&Body::from(shell)).into());
        object.body = bodies.body().as_ref().map(Into::into);
        object.bounds = bodies.bounds.as_ref().map(Into::into);
        object.bounds_sd = record.bounds.as_ref().and_then(|bounds| bounds.half_extents_sd);
        object.enclosing = bodies.enclosing.as_ref().map(Into::into);
        let alternative = |(body, log_odds): &(Body, f64)| ReportAlternative { body: body.into(), log_odds: *log_odds };
        object.alternatives = others.iter().map(alternative).collect();
        object.relative_residual = record.goodness_of_fit.as_ref().map(|fit| fit.relative_residual);
        object.normalized_residual = record.goodness_of_fit.as_ref().map(|fit| fit.normalized_residual);
        object.views_rejected = record.views_rejected.len();
        object.views_used = record.views_used.unwrap_or(0);
        object.residual = record.residual_px;
        object.predicted_iou = record.cross_validation.as_ref().map(|checked| checked.iou);
        object.suspect_view = record.cross_validation.as_ref().and_then(|checked| checked.suspect_view.clone());
        object.warnings = record.warnings.clone();
    }

    /// A true object, in the entry of the object with the id `partner` if there is one.
    fn truth(&mut self, bodies: ObjectBodies, partner: Option<&str>) {
        let paired = partner.and_then(|id| self.by_id.get(id).copied());
        let index = paired.unwrap_or_else(|| self.add(&bodies.id));
        self.by_true_id.insert(bodies.id.clone(), index);
        self.by_id.entry(bodies.id.clone()).or_insert(index);
        let object = self.of_category(index, bodies.category.as_ref());
        object.true_id = Some(bodies.id.clone()).filter(|id| *id != object.id);
        let like = object.body.as_ref().map(|body| body.kind);
        object.truth = body(&bodies, like);
        if object.status.is_none() {
            object.center = bodies.center.map(|center| center.coords.into());
        }
    }

    /// The scores, row by row with the object that they are of.
    pub(crate) fn scores(&self, scores: &Scores) -> ReportScores {
        let row = |row: &TrueObjectScores| {
            let object = self.by_true_id.get(&row.id).copied().filter(|&index| index < MAX_OBJECTS)?;
            Some(ScoreRow { object, status: row.status.clone(), values: row.values.clone() })
        };
        ReportScores {
            columns: scores.columns.clone(),
            rows: scores.rows.iter().filter_map(row).collect(),
            mean: scores.mean.clone(),
            failures: scores.failures.clone(),
        }
    }
}

/// The body of an object: of the kind `like` if it has one, otherwise cuboid, cylinder, superellipsoid or ellipsoid.
fn body(bodies: &ObjectBodies, like: Option<&str>) -> Option<ReportBody> {
    let ellipsoid = bodies.ellipsoid().filter(|_| like == Some("ellipsoid")).map(Body::from);
    ellipsoid.or(bodies.body()).as_ref().map(Into::into)
}

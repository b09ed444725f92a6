//! Real boxes without their ids: objects on tables (TUW, LINEMOD-Occluded), parked cars (KITTI).

use std::collections::HashMap;
use std::path::Path;

use quadlift::association::{AssociateOptions, IdPolicy};
use quadlift::scene::Scene;
use quadlift_io::read_scene_file;
use rayon::prelude::*;

use super::case::{Case, CaseScore};
use super::headline;
use crate::error::Error;
use crate::progress::Steps;
use crate::report::Report;
use crate::table::{Cell, Table};

/// A row: a scene, its boxes, whether categories are known, and the prototype's F1 where it is printed.
struct Row {
    file: &'static str,
    source: &'static str,
    categories: bool,
    prototype: Option<&'static str>,
    group: usize,
}

/// What is demanded: headline, what it is, the least F1.
const GROUPS: [(&str, &str, f64); 5] = [
    ("association_tuw", "F1, TUW", 1.0),
    ("association_lmo_model", "F1, LMO A and B, model boxes (the lower one)", 0.99),
    ("association_lmo_mask", "F1, LMO A and B, visible-mask boxes (the lower one)", 0.985),
    ("association_kitti", "F1, KITTI S05, S09, S36 and S22 aligned, rrc boxes (the lowest)", 0.97),
    ("association_kitti_drift", "F1, KITTI S22 with GPS/IMU poses, rrc boxes", 0.79),
];

fn rows() -> Vec<Row> {
    let row = |file, source, group, prototype| Row { file, source, categories: false, prototype, group };
    let mut rows = vec![row("tuw_demo", "authors", 0, Some("1.000"))];
    for (file, model, mask) in [("lmo_A", "0.995", "0.991"), ("lmo_B", "0.993", "0.991")] {
        for (source, group, prototype) in [("model", 1, model), ("visible-mask", 2, mask)] {
            rows.push(row(file, source, group, Some(prototype)));
            rows.push(Row { categories: true, ..row(file, source, group, None) });
        }
    }
    for file in [
        "kitti_S05_aligned",
        "kitti_S05_oxts",
        "kitti_S09_aligned",
        "kitti_S09_oxts",
        "kitti_S36_aligned",
        "kitti_S36_oxts",
    ] {
        rows.push(row(file, "rrc", 3, Some("0.97 to 1")));
    }
    rows.push(row("kitti_S22_aligned", "rrc", 3, Some("1.000")));
    rows.push(row("kitti_S22_oxts", "rrc", 4, Some("0.79")));
    rows
}

impl Row {
    /// The scene without ids; with the detections of one source only.
    fn case(&self, data: &Path) -> Result<Case, Error> {
        let path = data.join("scenes").join(format!("{}.json", self.file));
        let mut content = read_scene_file(&path)?;
        content.detections.retain(|detection| detection.source.as_deref() == Some(self.source));
        let in_file = |error: quadlift_io::EntryError| error.in_file(&path);
        let objects = content.to_objects().map_err(in_file)?;
        let bodies = objects.iter().filter_map(|o| {
            let body = o.ellipsoid().or(o.cuboid().map(|cuboid| cuboid.inscribed()))?;
            Some((o.id.as_str(), body))
        });
        let (ids, bodies): (Vec<&str>, Vec<_>) = bodies.unzip();
        let by_id: HashMap<&str, u32> = ids.into_iter().zip(0..).collect();
        let true_objects = content.detections.iter().map(|d| by_id.get(d.object.as_deref()?).copied()).collect();
        let mut scene = content.to_scene().map_err(in_file)?.into_parts();
        for detection in &mut scene.detections {
            detection.object_index = None;
            if !self.categories {
                detection.category_index = None;
            }
        }
        Ok(Case { scene: Scene::from_parts(scene)?, true_objects, bodies })
    }
}

/// All rows without categories, with their names.
///
/// # Errors
/// [`Error::Read`].
pub(crate) fn cases(data: &Path) -> Result<Vec<(String, Case)>, Error> {
    let named = |row: &Row| Ok((format!("{}, {}", row.file, row.source), row.case(data)?));
    rows().iter().filter(|row| !row.categories).map(named).collect()
}

/// Number of steps.
pub(crate) fn steps() -> usize {
    rows().len()
}

/// Adds the table and its headlines.
///
/// # Errors
/// [`Error::Read`], [`Error::Associate`], [`Error::Localize`].
pub(crate) fn add(data: &Path, report: &mut Report, steps: &Steps) -> Result<(), Error> {
    let rows = rows();
    let score = |row: &Row| {
        let case = row.case(data)?;
        let score = case.score(&AssociateOptions { ids: IdPolicy::Ignore, ..Default::default() });
        steps.done();
        score
    };
    let scores: Vec<CaseScore> = rows.par_iter().map(score).collect::<Result<_, _>>()?;
    let columns = [
        "scene",
        "boxes",
        "categories",
        "F1, prototype",
        "aim",
        "F1",
        "true objects",
        "found",
        "of them true",
        "O3D",
        "O3D, true ids",
    ];
    let mut table = Table::new("Real boxes without their ids", columns);
    let mut lowest = GROUPS.map(|_| f64::INFINITY);
    for (row, score) in rows.iter().zip(&scores) {
        let whole = |n: usize| Cell::number(n as f64, 0);
        lowest[row.group] = lowest[row.group].min(score.division.f1);
        table.push(vec![
            row.file.into(),
            row.source.into(),
            if row.categories { "known" } else { "" }.into(),
            row.prototype.unwrap_or_default().into(),
            Cell::number(GROUPS[row.group].2, 3),
            Cell::number(score.division.f1, 3),
            whole(score.found.true_objects),
            whole(score.found.found),
            whole(score.found.matched),
            Cell::number(score.o3d, 3),
            Cell::number(score.o3d_with_true_ids, 3),
        ]);
    }
    table.note(
        "Default settings. `aligned` poses are registered on the labels; `oxts` ones come from GPS and IMU and drift \
         by 1.4 m over S22.",
    );
    report.table(table);
    for ((id, what, _), f1) in GROUPS.into_iter().zip(lowest) {
        report.headlines.extend(headline(id, what.to_owned(), f1.is_finite().then_some(f1), "associate"));
    }
    Ok(())
}

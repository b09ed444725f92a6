//! Replays beside `associate` on all frames.

use std::path::Path;

use quadlift::association::{AssociateOptions, IdPolicy, associate};
use quadlift::metrics::pairwise_clustering_scores;
use quadlift::online::{ObjectMap, OnlineOptions};
use rayon::prelude::*;

use super::over_time;
use super::replay::replay;
use crate::association::case::Case;
use crate::association::{driving, synthetic, without_ids};
use crate::error::Error;
use crate::progress::Run;
use crate::report::{Headline, Report};
use crate::scores::median;
use crate::scores::{Figure, mean};
use crate::table::{Cell, Table};

/// Scenes of each synthetic condition.
const SEEDS: u64 = 3;

/// Parts of a replay after which scores are noted.
const QUARTERS: usize = 4;

/// What one scene gives.
struct Scores {
    batch: [f64; 2],
    online: [f64; 2],
    /// NEES of the bodies.
    nees: [Vec<f64>; 2],
    /// After each quarter; none in the short form.
    over_time: Vec<over_time::Scores>,
    objects: [f64; 2],
}

fn scores(case: &Case, run: &Run) -> Result<Scores, Error> {
    let bodies: Vec<_> = case.detected_bodies().into_iter().map(Some).collect();
    let association = associate(&case.scene, &AssociateOptions { ids: IdPolicy::Ignore, ..Default::default() })?;
    let f1 = |division: &[Option<u32>]| pairwise_clustering_scores(&case.true_objects, division).f1;
    let (batch_o3d, batch_nees) = over_time::judge(&association.applied_to(&case.scene, None), &bodies)?;
    let mut map = ObjectMap::new(OnlineOptions { ids: IdPolicy::Ignore, ..Default::default() })?;
    let frames = case.scene.frames.len();
    let mut over_time = Vec::new();
    let labels = replay(&mut map, &case.scene, |done, map, labels| {
        if !run.short && (1..=QUARTERS).any(|quarter| done == frames * quarter / QUARTERS) {
            over_time.push(over_time::scores(case, map, labels, done));
        }
    });
    let over_time = over_time.into_iter().collect::<Result<_, _>>()?;
    let (o3d, nees) = over_time::judge(&map.to_averaged_scene(), &bodies)?;
    let batch = [f1(&association.object_of_detection), batch_o3d];
    let online = [f1(&labels.division(&map)), o3d];
    let objects = [association.objects.len() as f64, map.objects().count() as f64];
    Ok(Scores { batch, online, nees: [batch_nees, nees], over_time, objects })
}

/// A row: its name, and its scenes.
type Row = (String, Vec<Case>);

fn rows(data: Option<&Path>, run: &Run) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    for condition in synthetic::conditions() {
        let cases = (0..run.scenes(SEEDS)).map(|k| condition.case(run.seed + k)).collect::<Result<_, _>>()?;
        rows.push((condition.name().to_owned(), cases));
    }
    if let Some(data) = data {
        let names = ["0000", "0001", "0007", "0009"];
        for (name, case) in names.iter().zip(driving::cases(data)?) {
            rows.push((format!("KITTI {name}, all rrc boxes"), vec![case]));
        }
        rows.extend(without_ids::cases(data)?.into_iter().map(|(name, case)| (name, vec![case])));
    }
    Ok(rows)
}

/// Adds the table and its headlines.
pub(super) fn add(data: Option<&Path>, report: &mut Report, run: &Run) -> Result<(), Error> {
    let rows = rows(data, run)?;
    let of_row = |(_, cases): &Row| cases.iter().map(|case| scores(case, run)).collect::<Result<Vec<Scores>, Error>>();
    let all: Vec<Vec<Scores>> = rows.par_iter().map(of_row).collect::<Result<_, _>>()?;
    let columns = [
        "scene",
        "F1, batch",
        "F1, online",
        "difference",
        "O3D, batch",
        "O3D, online",
        "difference",
        "objects, batch",
        "objects, online",
        "NEES, batch",
        "NEES, online",
    ];
    let mut table = Table::new("Replays beside batch", columns);
    let mut worst = [f64::INFINITY; 2];
    for ((name, _), scores) in rows.iter().zip(&all) {
        let of = |value: &dyn Fn(&Scores) -> f64| mean(&scores.iter().map(value).collect::<Vec<_>>()).unwrap_or(0.0);
        let mut row: Vec<Cell> = vec![name.as_str().into()];
        for (k, worst) in worst.iter_mut().enumerate() {
            let (batch, online) = (of(&|s| s.batch[k]), of(&|s| s.online[k]));
            *worst = worst.min(online - batch);
            row.extend([batch, online, online - batch].map(|x| Cell::number(x, 3)));
        }
        row.extend((0..2).map(|k| Cell::number(of(&|s| s.objects[k]), 0)));
        row.extend((0..2).map(|k| middle(scores.iter().flat_map(|s| &s.nees[k]))));
        table.push(row);
    }
    table.note(format!(
        "Synthetic rows: means over {} scenes. At the end the last 24 frames are assigned once more (`settle`). \
         NEES is the median over the bodies that overlap the truth (8.3 if covariances are right; a truth that is no ellipsoid, as on \
         KITTI, makes it larger).",
        run.scenes(SEEDS)
    ));
    report.table(table);
    if !run.short {
        report.table(over_time_table(&rows, &all));
    }
    for (id, what, value) in [
        ("online_worst_f1", "largest loss of F1 against batch, all rows", worst[0]),
        ("online_worst_o3d", "largest loss of O3D against batch, all rows", worst[1]),
    ] {
        report.headlines.push(Headline {
            id,
            what: what.to_owned(),
            paper: None,
            ours: Figure { value, standard_error: None },
            row: "online".to_owned(),
            decimals: 3,
        });
    }
    Ok(())
}

/// The median.
fn middle<'a>(values: impl Iterator<Item = &'a f64>) -> Cell {
    median(values.copied().collect()).map_or("".into(), |x| Cell::number(x, 1))
}

/// F1, O3D and NEES after each quarter.
fn over_time_table(rows: &[Row], all: &[Vec<Scores>]) -> Table {
    let after = ["1/4", "1/2", "3/4", "all"];
    let titles = ["F1", "O3D", "NEES"].iter().flat_map(|what| after.map(|part| format!("{what}, {part}")));
    let mut table = Table::new("Over time", std::iter::once("scene".to_owned()).chain(titles));
    for ((name, _), scores) in rows.iter().zip(all) {
        let mut row: Vec<Cell> = vec![name.as_str().into()];
        let of = |k: usize, value: fn(&over_time::Scores) -> f64| {
            mean(&scores.iter().filter_map(|s| s.over_time.get(k)).map(value).collect::<Vec<_>>()).unwrap_or(0.0)
        };
        row.extend((0..QUARTERS).map(|k| Cell::number(of(k, |s| s.f1), 3)));
        row.extend((0..QUARTERS).map(|k| Cell::number(of(k, |s| s.o3d), 3)));
        row.extend(
            (0..QUARTERS).map(|k| middle(scores.iter().filter_map(|s| s.over_time.get(k)).flat_map(|s| &s.nees))),
        );
        table.push(row);
    }
    table.note(
        "After each quarter of the frames, without `settle`: F1 of the boxes so far, O3D of the objects that were detected at least \
         three times so far, and the median NEES of the bodies.",
    );
    table
}

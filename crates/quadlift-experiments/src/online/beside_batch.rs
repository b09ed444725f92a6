//! Replays beside `associate` on all frames.

use std::path::Path;

use quadlift::association::{AssociateOptions, IdUse, associate};
use quadlift::metrics::pairwise_clustering_scores;
use quadlift::online::{ObjectMap, OnlineOptions};
use rayon::prelude::*;

use super::replay::replay;
use crate::association::case::{Case, o3d};
use crate::association::{driving, synthetic, without_ids};
use crate::error::Error;
use crate::report::{Headline, Report};
use crate::scores::{Figure, mean};
use crate::table::{Cell, Table};

/// Scenes of each synthetic condition.
const SEEDS: u64 = 3;

/// Quarters of a replay after which F1 is noted.
const QUARTERS: usize = 4;

/// What one scene gives.
struct Scores {
    batch: [f64; 2],
    online: [f64; 2],
    /// F1 over the frames so far, after each quarter.
    over_time: [f64; QUARTERS],
    objects: [f64; 2],
}

fn scores(case: &Case) -> Result<Scores, Error> {
    let bodies = case.detected_bodies();
    let association = associate(&case.scene, &AssociateOptions { ids: IdUse::Ignore, ..Default::default() })?;
    let f1 = |division: &[Option<u32>]| pairwise_clustering_scores(&case.true_objects, division).f1;
    let batch = [f1(&association.object_of_detection), o3d(&association.applied_to(&case.scene, None), &bodies)?];
    let mut map = ObjectMap::new(OnlineOptions { ids: IdUse::Ignore, ..Default::default() })?;
    let frames = case.scene.frames.len();
    let mut over_time = [0.0; QUARTERS];
    let labels = replay(&mut map, &case.scene, |done, map, labels| {
        for (quarter, value) in over_time.iter_mut().enumerate() {
            if done == frames * (quarter + 1) / QUARTERS {
                let so_far = |index: &usize| (case.scene.detections[*index].frame_index as usize) < done;
                let seen: Vec<usize> = (0..case.scene.detections.len()).filter(so_far).collect();
                let division = labels.division(map);
                let of = |all: &[Option<u32>]| seen.iter().map(|&k| all[k]).collect::<Vec<_>>();
                *value = pairwise_clustering_scores(&of(&case.true_objects), &of(&division)).f1;
            }
        }
    });
    let online = [f1(&labels.division(&map)), o3d(&map.to_scene(), &bodies)?];
    let objects = [association.objects.len() as f64, map.objects().count() as f64];
    Ok(Scores { batch, online, over_time, objects })
}

/// A row: its name, and its scenes.
type Row = (String, Vec<Case>);

fn rows(data: Option<&Path>, seed: u64) -> Result<Vec<Row>, Error> {
    let mut rows = Vec::new();
    for condition in synthetic::conditions() {
        let cases = (0..SEEDS).map(|k| condition.case(seed + k)).collect::<Result<_, _>>()?;
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
pub(super) fn add(data: Option<&Path>, report: &mut Report, seed: u64) -> Result<(), Error> {
    let rows = rows(data, seed)?;
    let of_row = |(_, cases): &Row| cases.iter().map(scores).collect::<Result<Vec<Scores>, Error>>();
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
        "F1 after 1/4",
        "1/2",
        "3/4",
        "the end",
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
        row.extend((0..QUARTERS).map(|k| Cell::number(of(&|s| s.over_time[k]), 3)));
        table.push(row);
    }
    table.note(format!(
        "Synthetic rows: means over {SEEDS} scenes. At the end the last 24 frames are assigned once more (`settle`); the columns on \
         the right are without that, over the frames so far."
    ));
    report.table(table);
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

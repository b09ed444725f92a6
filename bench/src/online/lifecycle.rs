//! Objects that are taken away half way, a detector that misses one in five, and false boxes.

use std::collections::BTreeMap;

use quadlift::association::IdPolicy;
use quadlift::geometry::{ConvexBody, project_bounding_box};
use quadlift::online::{Event, Frame, ObjectId, ObjectMap, OnlineOptions, Presence, Removal};
use quadlift::scene::{NewDetection, Scene};
use quadlift::synthetic::{
    Detector, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate,
};
use rayon::prelude::*;

use super::replay::{Labels, by_frame, observed};
use crate::error::Error;
use crate::progress::Run;
use crate::report::Report;
use crate::table::{Cell, Table};

/// Scenes of each row, objects of a scene, and how many of them are taken away.
const SEEDS: u64 = 8;
const OBJECTS: usize = 30;
const TAKEN: usize = 6;

/// Rows: name, side of the cube in which the objects lie, views.
const ROWS: [(&str, f64, usize); 3] =
    [("cube of 60, 200 views", 60.0, 200), ("cube of 40, 200 views", 40.0, 200), ("cube of 60, 600 views", 60.0, 600)];

/// What came of the objects of some scenes.
#[derive(Default)]
struct Lives {
    taken: usize,
    gone: usize,
    /// Clear views from when an object was taken to when the map knew.
    delays: Vec<usize>,
    staying: usize,
    falsely_gone: usize,
    ghosts: usize,
    /// Frames that confirmed ghosts lived.
    ghost_frames: Vec<usize>,
}

/// Whether an object would be seen clearly: by its true body, and those of the objects that are there.
fn is_clear(synthetic: &SyntheticScene, frame: usize, object: usize) -> bool {
    let frame = &synthetic.scene.frames[frame];
    let of = |k: usize| {
        let body = &synthetic.truth[k].1;
        let bounds = project_bounding_box(&frame.projection, body).ok()?;
        Some((bounds, frame.projection.depth(&body.center())))
    };
    let (Some((own, depth)), Some(size)) = (of(object), frame.image_size) else { return false };
    let area = own.size().product();
    let overlap = |x0: f64, y0: f64, x1: f64, y1: f64| {
        (own.x1().min(x1) - own.x0().max(x0)).max(0.0) * (own.y1().min(y1) - own.y0().max(y0)).max(0.0) / area
    };
    let covers = |k: usize| {
        let other = of(k).filter(|(_, other_depth)| k >= TAKEN && *other_depth < depth);
        other.is_some_and(|(b, _)| overlap(b.x0(), b.y0(), b.x1(), b.y1()) > 0.2)
    };
    overlap(0.0, 0.0, size.x, size.y) >= 0.7 && !(0..synthetic.truth.len()).any(covers)
}

fn live(options: &SyntheticOptions) -> Result<Lives, Error> {
    let synthetic = generate(options)?;
    let half = synthetic.scene.frames.len() / 2;
    let mut parts = synthetic.scene.clone().into_parts();
    let stays = |index: usize| {
        let frame = synthetic.scene.detections[index].frame_index as usize;
        frame < half || synthetic.true_objects[index].is_none_or(|object| object >= TAKEN)
    };
    let kept: Vec<usize> = (0..parts.detections.len()).filter(|&index| stays(index)).collect();
    parts.detections = kept.iter().map(|&index| synthetic.scene.detections[index].clone()).collect();
    let scene = Scene::from_parts(parts)?;
    let mut map = ObjectMap::new(OnlineOptions { ids: IdPolicy::Ignore, ..Default::default() })?;
    let mut labels = Labels::new(&scene);
    let mut gone_at: BTreeMap<ObjectId, Vec<usize>> = BTreeMap::new();
    let mut confirmed_at: BTreeMap<ObjectId, usize> = BTreeMap::new();
    let mut lives = Lives { taken: TAKEN, ..Default::default() };
    for (index, (frame, indices)) in scene.frames.iter().zip(by_frame(&scene)).enumerate() {
        let detections: Vec<NewDetection> = indices.iter().filter_map(|&d| observed(&scene, d)).collect();
        let Ok(update) = map.observe(&Frame::of_scene(&scene, frame, index as f64), &detections) else { continue };
        for event in &update.events {
            match event {
                Event::Confirmed { object } => {
                    confirmed_at.insert(*object, index);
                }
                Event::Removed { object, reason: Removal::Gone } => gone_at.entry(*object).or_default().push(index),
                Event::Removed { object, .. } => {
                    lives.ghost_frames.extend(confirmed_at.remove(object).map(|since| index - since));
                }
                _ => (),
            }
        }
        labels.apply(&frame.id, &indices, &update);
    }
    let objects: Vec<_> = map.objects().collect();
    let mut votes: Vec<BTreeMap<Option<usize>, usize>> = vec![BTreeMap::new(); objects.len()];
    for (object, &index) in labels.division(&map).iter().zip(&kept) {
        if let Some(object) = object {
            *votes[*object as usize].entry(synthetic.true_objects[index]).or_default() += 1;
        }
    }
    lives.staying = OBJECTS - TAKEN;
    for (object, votes) in objects.iter().zip(&votes) {
        let most = votes.iter().max_by_key(|(_, count)| **count).and_then(|(truth, _)| *truth);
        let events = gone_at.get(&object.id).map_or(&[][..], Vec::as_slice);
        match most {
            Some(truth) if truth < TAKEN => {
                lives.falsely_gone += events.iter().filter(|&&at| at < half).count();
                if object.presence == Presence::Gone
                    && let Some(at) = events.iter().find(|&&at| at >= half)
                {
                    lives.gone += 1;
                    lives.delays.push((half..=*at).filter(|&f| is_clear(&synthetic, f, truth)).count());
                }
            }
            Some(_) => lives.falsely_gone += events.len(),
            None => lives.ghosts += 1,
        }
    }
    Ok(lives)
}

/// Adds the table.
pub(super) fn add(report: &mut Report, run: &Run) -> Result<(), Error> {
    let columns = [
        "scene",
        "taken away",
        "of them gone at the end",
        "clear views until then, median",
        "90 %",
        "stay",
        "false removals",
        "ghosts at the end",
        "ghosts that were removed",
        "after frames, median",
        "largest",
    ];
    let mut table = Table::new("Objects that are taken away half way", columns);
    for &(name, cube_side, views) in run.first(&ROWS, 1) {
        let make = |k: u64| SyntheticOptions {
            seed: run.seed + k,
            objects: OBJECTS,
            views,
            cube_side,
            trajectory: Trajectory::Orbit,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.05)],
            detector: Detector { misses: 0.2, false_boxes: 0.15, ..Default::default() },
            ids: SyntheticIds::Absent,
            ..Default::default()
        };
        let scenes: Vec<Lives> =
            (0..run.scenes(SEEDS)).into_par_iter().map(|k| live(&make(k))).collect::<Result<_, _>>()?;
        let sum = |of: &dyn Fn(&Lives) -> usize| Cell::number(scenes.iter().map(of).sum::<usize>() as f64, 0);
        let quantile = |of: &dyn Fn(&Lives) -> &Vec<usize>, share: f64| {
            let mut all: Vec<usize> = scenes.iter().flat_map(|l| of(l).iter().copied()).collect();
            all.sort_unstable();
            let place = (share * all.len().saturating_sub(1) as f64).round() as usize;
            all.get(place).map_or(Cell::Empty, |&x| Cell::number(x as f64, 0))
        };
        table.push(vec![
            name.into(),
            sum(&|l| l.taken),
            sum(&|l| l.gone),
            quantile(&|l| &l.delays, 0.5),
            quantile(&|l| &l.delays, 0.9),
            sum(&|l| l.staying),
            sum(&|l| l.falsely_gone),
            sum(&|l| l.ghosts),
            Cell::number(scenes.iter().map(|l| l.ghost_frames.len()).sum::<usize>() as f64, 0),
            quantile(&|l| &l.ghost_frames, 0.5),
            quantile(&|l| &l.ghost_frames, 1.0),
        ]);
    }
    table.note(format!(
        "{} scenes of {OBJECTS} objects, once around; 20 % of the detections are missed, 15 % are false, edges are 5 % off. A \
         view is clear when at least 70 % of the true box is inside of the image and no nearer object that is there covers more \
         than 20 % of it. A ghost is a confirmed object most of whose detections are false.",
        run.scenes(SEEDS)
    ));
    report.table(table);
    Ok(())
}

//! Depths with a shift: measured = 1.1 times the true depth + a constant, where all objects are about as far and along a street.

use quadlift::geometry::BodyKind;
use quadlift::metrics::{iou3d_ellipsoids, nees};
use quadlift::scene::Detection;
use quadlift::solve::{PosteriorOptions, Status};
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate,
    simulate_cues,
};
use quadlift::{LocalizeOptions, localize};
use rayon::prelude::*;

use super::synthetic::{EDGE_NOISE, FIRST_SEED, SCENES, noisy_boxes};
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::scores::{median_figure, pooled};
use crate::table::{Cell, Table};

/// Shifts of the depths, world units: a column each.
const SHIFTS: [f64; 4] = [0.0, 0.3, 1.0, -1.0];

/// Scenes: label, views, whether a street.
const ROWS: [(&str, usize, bool); 5] = [
    ("cube, 2 views", 2, false),
    ("cube, 3 views", 3, false),
    ("cube, 20 views", 20, false),
    ("street, 15 views", 15, true),
    ("street, 60 views", 60, true),
];

/// A street of parked ellipsoids as large as cars, 3 to 45 away.
fn street(views: usize, seed: u64) -> Result<SyntheticScene, Error> {
    Ok(generate(&SyntheticOptions {
        seed,
        objects: views / 3 + 17,
        views,
        standing: true,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(EDGE_NOISE)],
        ..Default::default()
    })?)
}

/// O3D and NEES of the objects of a scene that are seen twice.
fn scores(made: &SyntheticScene, cues: &CueOptions, seed: u64) -> Result<Vec<(f64, Option<f64>)>, Error> {
    let body_of = |index: usize, _: &Detection| made.true_objects[index].map(|object| made.truth[object].1);
    let scene = simulate_cues(&made.scene, body_of, cues, seed)?;
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    let found = localize(&scene, &LocalizeOptions { seed, ..options.into() })?;
    let score = |(id, body): &(String, quadlift::geometry::Body)| {
        let truth = body.closest_ellipsoid();
        let index = scene.object_ids.iter().position(|name| name == id)?;
        let views = scene.detections.iter().filter(|d| d.object_index == Some(index as u32)).count();
        let estimate = found.estimates.iter().find(|estimate| estimate.object_index == index)?;
        let body = estimate.closest_ellipsoid().filter(|_| estimate.status == Status::Ok);
        let normalized = || nees(&body?, &truth, &estimate.covariance.as_ref()?.matrix);
        let o3d = body.map_or(0.0, |body| iou3d_ellipsoids(&body, &truth));
        (views >= 2).then(|| (o3d, normalized()))
    };
    Ok(made.truth.iter().filter_map(score).collect())
}

/// Adds the tables.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cues", ROWS.len(), run.progress);
    let count = run.scenes(SCENES);
    report.text(format!(
        "Depths with a shift: 1.1 times the true depth + 0.3, + 1 and - 1, other errors as above. In the cube all objects are 20 to 30 \
         away; along the street (parked ellipsoids as large as cars, a view each unit) they are 3 to 45 away. Objects in two views \
         and more; a mean of {count} scenes."
    ));
    let titles = |what: &str| {
        let of =
            |cues: &str| SHIFTS.map(|shift| if shift == 0.0 { cues.to_owned() } else { format!("{cues}, {shift:+}") });
        let all = ["scene".to_owned(), "boxes".to_owned()].into_iter().chain(of("depth")).chain(of("both"));
        Table::new(format!("Shifts of depths: {what}"), all.collect::<Vec<_>>())
    };
    let mut tables = [titles("O3D"), titles("NEES")];
    for (label, views, is_street) in ROWS {
        let of_column = |(shift, box3d): (Option<f64>, Option<Box3dNoise>)| {
            let depth = shift.map(|shift| DepthNoise { outliers: 0.05, shift, ..Default::default() });
            let of_scene = |scene: u64| {
                let seed = run.seed.wrapping_add(FIRST_SEED + scene);
                let made = if is_street { street(views, seed)? } else { noisy_boxes(views, seed)? };
                scores(&made, &CueOptions { depth, box3d }, seed)
            };
            (0..count).into_par_iter().map(of_scene).collect::<Result<Vec<_>, Error>>()
        };
        let columns = std::iter::once((None, None))
            .chain(SHIFTS.map(|shift| (Some(shift), None)))
            .chain(SHIFTS.map(|shift| (Some(shift), Some(Box3dNoise::default()))));
        let all: Vec<_> = columns.map(of_column).collect::<Result<_, _>>()?;
        let all: Vec<Vec<(f64, Option<f64>)>> = all.into_iter().map(|scenes| scenes.concat()).collect();
        let o3d = all.iter().map(|column| Cell::figure(pooled(&[column.iter().map(|s| s.0).collect()]), 3));
        tables[0].push(std::iter::once(Cell::from(label)).chain(o3d).collect());
        let normalized =
            all.iter().map(|column| Cell::figure(median_figure(column.iter().filter_map(|s| s.1).collect()), 1));
        tables[1].push(std::iter::once(Cell::from(label)).chain(normalized).collect());
        steps.done();
    }
    tables.into_iter().for_each(|table| report.table(table));
    Ok(())
}

//! Real images: LINEMOD Occlusion and TUW.

use std::path::Path;

use quadlift::{LocalizeError, LocalizeOptions};
use rayon::prelude::*;

use super::images::{Known, Split, TITLES, Tally, divide, located, located_by_centers};
use crate::data::TrueScene;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::Report;
use crate::table::{Cell, Table};

/// A scene: file, name, source of the boxes, bound of the position in meters.
type RealScene = (&'static str, &'static str, &'static str, f64);

const SCENES: [RealScene; 5] = [
    ("lmo_A", "LM-O A, boxes of models", "model", 0.05),
    ("lmo_B", "LM-O B, boxes of models", "model", 0.05),
    ("lmo_A", "LM-O A, boxes of masks", "visible-mask", 0.05),
    ("lmo_B", "LM-O B, boxes of masks", "visible-mask", 0.05),
    ("tuw_demo", "TUW", "authors", 0.1),
];

/// Objects of the map that an image shows at least.
const FEWEST: usize = 4;

/// Adds the table.
pub(super) fn run(data: &Path, run: &Run, report: &mut Report) -> Result<(), Error> {
    let steps = Steps::new("cameras", SCENES.len() * Split::ALL.len(), run.progress);
    report.text(format!(
        "The same with the boxes of real scenes. Right: within 5 cm (LM-O) or 10 cm (TUW) and 5 degrees; of images with {FEWEST} objects of the \
         map and more."
    ));
    let mut table =
        Table::new("Images located in real scenes", ["scene", "map from", "method"].into_iter().chain(TITLES));
    let rows: Vec<(usize, Split)> =
        (0..run.first(&SCENES, 1).len()).flat_map(|scene| Split::ALL.map(|split| (scene, split))).collect();
    let of_row = |&(scene, split): &(usize, Split)| -> Result<[Tally; 2], Error> {
        let (file, name, source, bound) = SCENES[scene];
        let mut scene = TrueScene::read(data, file, name)?.scene;
        let chosen = scene.source_index(Some(source)).map_err(LocalizeError::from)?;
        scene.edit(|parts| parts.detections.retain(|detection| detection.source_index == chosen))?;
        let all = divide(
            &scene,
            split,
            &LocalizeOptions { seed: run.seed, source: Some(source.to_owned()), ..Default::default() },
        )?;
        let tallies = [located(&all, Known::Nothing, FEWEST, bound), located_by_centers(&all, FEWEST, bound, run.seed)];
        steps.done();
        Ok(tallies)
    };
    let tallies = rows.par_iter().map(of_row).collect::<Result<Vec<_>, _>>()?;
    for (&(scene, split), tallies) in rows.iter().zip(&tallies) {
        for (method, tally) in ["relocalize", "centers"].into_iter().zip(tallies) {
            let labels = [SCENES[scene].1, split.name(), method].map(Cell::from);
            table.push(labels.into_iter().chain(tally.cells()).collect());
        }
    }
    report.table(table);
    Ok(())
}

//! The second scene: boxes only, a few of them quite wrong.

use std::path::Path;

use anyhow::Context;
use quadlift::Localization;
use quadlift::associate::Association;
use quadlift::solve::Estimate;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift_io::association::association_record;
use quadlift_io::evaluation::scores_record;
use quadlift_io::scene_file::count_localised;
use quadlift_io::{SceneFile, write_scene_file};
use serde_json::{Value, json};

use super::part::{apart, find_identities, identities_in_words, localize_and_compare, name_as_found, table};
use crate::estimate_table::summaries;
use crate::files::make_folder;
use crate::localization::Settings;
use crate::output::{HEADING, Output};
use crate::synthetic_file::scene_file;
use crate::words::count;

/// Objects of 15 to 60 cm within a metre, seen from ten metres on an arc of 60 degrees.
fn options() -> SyntheticOptions {
    SyntheticOptions {
        seed: 1,
        objects: 8,
        views: 20,
        trajectory: Trajectory::Arc { span: 60.0 },
        scale: 0.05,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        outlier_share: 0.05,
        ..Default::default()
    }
}

/// Runs this part in a folder, which is made if needed; gives what `--json` tells of it.
pub fn run(folder: &Path, out: &Output) -> anyhow::Result<Value> {
    make_folder(folder)?;
    let paths = ["scene.json", "estimate.json", "truth.json"].map(|name| folder.join(name));
    let [scene_path, estimate_path, truth_path] = &paths;
    let synthetic = generate(&options()).context("cannot make the scene")?;
    let whole =
        SceneFile { name: Some("demo".to_owned()), length_unit: Some("m".to_owned()), ..scene_file(&synthetic) };
    let (mut file, mut truth) = apart(whole);
    write_scene_file(scene_path, &file)?;

    let (scene, association) = find_identities(&mut file, out)?;
    name_as_found(&mut truth, &synthetic.true_objects, &association);
    let result = localize_and_compare((&file, &scene), Some(&association), &truth, &Settings::default(), out)?;
    write_scene_file(estimate_path, &result.file)?;
    write_scene_file(truth_path, &truth)?;

    let wrong = synthetic.outliers.iter().filter(|wrong| **wrong).count();
    let wrong_found = found_outliers(&synthetic, &association, &result.localization);
    let estimates = &result.localization.estimates;
    out.report(&format!(
        "{HEADING}2. Boxes alone{HEADING:#}\n{} of {} within a metre, and {} boxes: {wrong} are quite wrong, the others \
         have noise of 5 % of\ntheir half size. Again none says which object it shows.\n\n  associate  which boxes show \
         the same object?  {}\n  localize   where, how large, how turned?      {} of {}; {wrong_found} of the {wrong} \
         wrong boxes were left out\n\n{}\n",
        count(scene.frames.len(), "view"),
        count(synthetic.truth.len(), "object"),
        scene.detections.len(),
        identities_in_words(&association),
        count_localised(estimates),
        count(estimates.len(), "object"),
        table(&scene, &result),
    ))?;
    Ok(json!({
        "files": { "scene": scene_path, "estimate": estimate_path, "truth": truth_path },
        "association": association_record(&scene, &association),
        "wrong_boxes": { "number": wrong, "found": wrong_found },
        "objects": summaries(&scene, &result.localization),
        "evaluation": scores_record(&result.evaluation),
    }))
}

/// Number of wrong boxes that belong to no object or that the estimator has rejected.
fn found_outliers(synthetic: &SyntheticScene, association: &Association, localization: &Localization) -> usize {
    let found = |&detection: &usize| {
        let Some(object) = association.object_of_detection[detection] else { return true };
        let frame = synthetic.scene.detections[detection].frame_index as usize;
        let rejected = |e: &Estimate| {
            e.object_index == object as usize && e.views.iter().any(|v| v.frame_index == frame && !v.inlier)
        };
        localization.estimates.iter().any(rejected)
    };
    (0..synthetic.outliers.len()).filter(|&detection| synthetic.outliers[detection]).filter(found).count()
}

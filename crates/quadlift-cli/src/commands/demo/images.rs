//! The first scene: rendered images, and boxes as a detector gives them.

use std::path::Path;

use anyhow::{Context, bail};
use quadlift::{Options, UsedMeasurements};
use quadlift_io::association::association_record;
use quadlift_io::evaluation::scores_record;
use quadlift_io::scene_file::count_localised;
use quadlift_io::segmentation::{self, Method, Segmentation, add_to_scene};
use quadlift_io::{SceneFile, write_scene_file};
use quadlift_segment::SegmentMethod;
use quadlift_segment::render::{RenderOptions, RenderedScene, render};
use serde_json::{Value, json};

use super::part::{apart, find_identities, identities_in_words, localize_and_compare, name_as_found, table};
use crate::contact_sheet::write_sheets;
use crate::estimate_table::summaries;
use crate::files::make_folder;
use crate::localization::Settings;
use crate::output::{HEADING, Output};
use crate::rendered_scene::{check_folders, write_images};
use crate::segmentation::segment_scene;
use crate::table::number;
use crate::words::count;

/// A car, a chair and an egg that hide parts of each other. Box edges have noise of 5 % of their half size.
fn options() -> RenderOptions {
    RenderOptions { seed: 9, objects: 3, views: 9, box_noise: 0.05, ..Default::default() }
}

/// Runs this part in a folder that exists; gives what `--json` tells of it.
pub fn run(folder: &Path, out: &Output) -> anyhow::Result<Value> {
    let path = |name: &str| folder.join(name);
    let [scene_path, segmented_path] = [path("scene.json"), path("segmented.json")];
    let [estimate_path, truth_path] = [path("estimate.json"), path("truth.json")];
    let [masks, sheets] = [path("masks"), path("sheets")];
    check_folders(&scene_path)?;
    let rendered = render(&options()).context("cannot render the scene")?;
    let whole = SceneFile { name: Some("demo".to_owned()), ..write_images(&rendered, &scene_path)? };
    let (mut file, mut truth) = apart(whole);
    write_scene_file(&scene_path, &file)?;

    let (scene, association) = find_identities(&mut file, out)?;
    name_as_found(&mut truth, &rendered.synthetic.true_objects, &association);

    let method = Method::Image(SegmentMethod::default());
    let settings = segmentation::Settings { method, source: None, seed: 0, with_crops: true };
    let images = file.to_images(&scene_path).context("cannot use the scene")?;
    let segmentation = segment_scene("demo", &scene, &images, &settings, out)?;
    if let Some(problem) = segmentation.problems.list().first() {
        bail!(problem.in_words(&scene));
    }
    make_folder(&masks)?;
    make_folder(&sheets)?;
    write_sheets(&segmentation, &sheets)?;
    add_to_scene(&mut file, &scene, &segmentation, method, [folder, folder], Some(&masks))?;
    write_scene_file(&segmented_path, &file)?;

    let scene = file.to_scene().context("cannot use the scene")?;
    let result = localize_and_compare((&file, &scene), None, &truth, &Settings::default(), out)?;
    let boxes = Options { measurements: UsedMeasurements::Box, ..Default::default() };
    let boxes = Settings { options: boxes, ..Default::default() };
    let from_boxes = localize_and_compare((&file, &scene), None, &truth, &boxes, out)?;
    write_scene_file(&estimate_path, &result.file)?;
    write_scene_file(&truth_path, &truth)?;

    let masks_found = Masks::of(&segmentation, &rendered);
    let estimates = &result.localization.estimates;
    let mean = &from_boxes.evaluation.mean;
    out.report(&format!(
        "{HEADING}1. Images and boxes{HEADING:#}\n{} of {}, and {} boxes as a detector gives them: none says which \
         object it shows.\n\n  associate  which boxes show the same object?  {}\n  segment    which pixels are the \
         object's?     {}\n  localize   where, how large, how turned?      {} of {}\n\n{}\nIoU: volume that estimate and truth share, over that of both; the truth of car and chair \
         is the smallest\nellipsoid around them. From the boxes alone the mean IoU is {} and the axes are {} degrees \
         off.\n\n",
        count(rendered.images.len(), "rendered image"),
        count(rendered.kinds.len(), "object"),
        rendered.values.len(),
        identities_in_words(&association),
        masks_found.in_words(),
        count_localised(estimates),
        count(estimates.len(), "object"),
        table(&scene, &result),
        number(mean.iou3d.map(|mean| mean.value), 2),
        number(mean.theta_err.map(|mean| mean.value.to_degrees()), 1),
    ))?;
    Ok(json!({
        "files": {
            "scene": scene_path, "segmented": segmented_path, "estimate": estimate_path, "truth": truth_path,
            "masks": masks, "sheets": sheets,
        },
        "association": association_record(&scene, &association),
        "masks": {
            "found": masks_found.found, "fell_back": masks_found.fell_back, "mean_iou": masks_found.mean_iou,
        },
        "objects": summaries(&scene, &result.localization),
        "evaluation": scores_record(&result.evaluation),
        "evaluation_of_boxes": scores_record(&from_boxes.evaluation),
    }))
}

/// What came of the masks.
struct Masks {
    found: usize,
    fell_back: usize,
    /// Mean IoU of those that were found with the true masks.
    mean_iou: f64,
}

impl Masks {
    fn of(segmentation: &Segmentation, rendered: &RenderedScene) -> Self {
        let mut ious = Vec::new();
        let mut fell_back = 0;
        for (index, found) in segmentation.found.iter().enumerate() {
            match found {
                Some(found) if found.fell_back.is_none() => {
                    let frame = rendered.synthetic.scene.detections[index].frame_index as usize;
                    ious.push(found.mask.iou(&rendered.labels[frame].mask(rendered.values[index])));
                }
                Some(_) => fell_back += 1,
                // It belongs to no object.
                None => {}
            }
        }
        let found = ious.len();
        Self { found, fell_back, mean_iou: ious.iter().sum::<f64>() / found.max(1) as f64 }
    }

    fn in_words(&self) -> String {
        let mut text = format!("{}, mean IoU with the true ones {:.2}", count(self.found, "mask"), self.mean_iou);
        if self.fell_back > 0 {
            text.push_str(&format!("; {} not trusted", self.fell_back));
        }
        text
    }
}

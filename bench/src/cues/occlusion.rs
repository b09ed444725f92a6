//! What limits outlines with perfect masks: occlusion by other objects, or the class of bodies.
//!
//! On rendered scenes both are known: objects that are ellipsoids or not, alone or four together. On the real images of
//! LINEMOD-Occluded the masks are those of the visible pixels.

use std::path::Path;

use crate::render::{ObjectKind, RenderOptions, render};
use quadlift::geometry::{Body, OutlineEnd, TangentLines};
use quadlift::metrics::{ObjectScore, TruthObject};
use quadlift::nalgebra::Vector2;
use quadlift::scene::Scene;
use quadlift::solve::PosteriorOptions;
use quadlift::{LocalizeOptions, MeasurementKind};
use quadlift_io::read_scene_file;
use quadlift_segment::{FrameMasks, Mask};
use rayon::prelude::*;

use crate::data::TrueScene;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, Measure, pooled};
use crate::table::{Cell, Table};

/// Objects of each kind of scene.
const OBJECTS: u64 = 24;

/// Objects of a scene with occlusion, as many as rendered scenes have.
const TOGETHER: usize = 4;

/// Real images, and the source of their boxes and masks.
const REAL_SCENES: [&str; 2] = ["lmo_A", "lmo_B"];
const SOURCE: &str = "visible-mask";

const MEASURES: [Measure; 3] = [Measure::O3d, Measure::EnclosingO3d, Measure::ThetaErr];

/// How the lines of masks are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lines {
    /// The boxes of the masks instead.
    Boxes,
    /// Lines at other objects have two sides, like all others.
    TwoSided,
    /// As the program does it: lines at other objects bound the object from below.
    OneSided,
}

const ROWS: [(Lines, &str); 3] = [
    (Lines::Boxes, "boxes"),
    (Lines::TwoSided, "outlines, contacts ignored"),
    (Lines::OneSided, "outlines, one-sided at contacts"),
];

/// A scene with the masks of its detections.
struct MaskScene {
    scene: TrueScene,
    masks: Vec<Mask>,
}

impl MaskScene {
    fn rendered(seed: u64, objects: usize, kinds: &[ObjectKind]) -> Result<Self, Error> {
        let options = RenderOptions { seed, objects, kinds: kinds.to_vec(), ..Default::default() };
        let rendered = render(&options)?;
        let scene = rendered.synthetic.scene;
        let truth = |(id, body): &(String, Body)| TruthObject {
            id: id.clone(),
            ellipsoid: Some(body.closest_ellipsoid()),
            cuboid: None,
        };
        let mask = |(k, value): (usize, &u16)| rendered.labels[scene.detections[k].frame_index as usize].mask(*value);
        Ok(Self {
            masks: rendered.values.iter().enumerate().map(mask).collect(),
            scene: TrueScene {
                sequence: String::new(),
                truth: rendered.synthetic.truth.iter().map(truth).collect(),
                scene,
            },
        })
    }

    fn real(data: &Path, file: &str) -> Result<Self, Error> {
        let path = data.join("scenes").join(format!("{file}.json"));
        let mut content = read_scene_file(&path)?;
        content.detections.retain(|detection| detection.source.as_deref() == Some(SOURCE));
        let scene = TrueScene::of_file(&content, &path, file)?;
        let images = content.to_images(&path).map_err(|error| error.in_file(&path))?;
        let all: Vec<usize> = (0..scene.scene.detections.len()).collect();
        let masks = images.read_masks(&scene.scene, &all).into_iter();
        Ok(Self { scene, masks: masks.map(|mask| Ok(mask?.unwrap_or_default())).collect::<Result<_, Error>>()? })
    }

    fn scores(&self, lines: Lines, seed: u64) -> Result<Vec<ObjectScore>, Error> {
        let mut parts = self.scene.scene.clone().into_parts();
        for frame in 0..parts.frames.len() {
            let of_frame: Vec<usize> =
                (0..self.masks.len()).filter(|&k| parts.detections[k].frame_index as usize == frame).collect();
            let all = FrameMasks::new(of_frame.iter().map(|&k| &self.masks[k]));
            let size: Option<Vector2<f64>> = parts.frames[frame].image_size;
            for k in of_frame {
                let found = all.tangent_lines(&self.masks[k], size, None);
                let two_sided = |lines: TangentLines| lines.with_ends(|l| OutlineEnd { hidden: false, ..l.end });
                parts.detections[k].tangent_lines = match lines {
                    Lines::Boxes => None,
                    Lines::TwoSided => found.map(two_sided).map(Box::new),
                    Lines::OneSided => found.map(Box::new),
                };
            }
        }
        let scene = TrueScene { scene: Scene::from_parts(parts)?, ..self.scene.clone() };
        let measurements = if lines == Lines::Boxes { MeasurementKind::Box } else { MeasurementKind::Mask };
        scene.scores(&LocalizeOptions { measurements, seed, ..PosteriorOptions::default().into() })
    }
}

/// Scenes that are scored together.
type Set = (String, Vec<MaskScene>);

fn rendered_sets(run: &Run) -> Result<Vec<Set>, Error> {
    let others: Vec<ObjectKind> = ObjectKind::ALL.into_iter().filter(|kind| *kind != ObjectKind::Ellipsoid).collect();
    let mut sets = Vec::new();
    for (kinds, name) in [(&[ObjectKind::Ellipsoid][..], "ellipsoids"), (&others, "other bodies")] {
        for (objects, how) in [(1, "alone"), (TOGETHER, "four together")] {
            let scene = |k: u64| MaskScene::rendered(run.seed.wrapping_add(k), objects, kinds);
            let count = run.scenes(OBJECTS / objects as u64);
            let scenes = (0..count).into_par_iter().map(scene).collect::<Result<_, _>>()?;
            sets.push((format!("{name}, {how}"), scenes));
        }
    }
    Ok(sets)
}

/// Adds the table; `data` is the folder of the real data, without which its rows are left out.
pub(super) fn run(data: Option<&Path>, run: &Run, report: &mut Report) -> Result<(), Error> {
    let mut sets = rendered_sets(run)?;
    if let Some(data) = data {
        let real = REAL_SCENES.par_iter().map(|file| MaskScene::real(data, file)).collect::<Result<_, _>>()?;
        sets.push(("real images (LINEMOD-Occluded)".to_owned(), real));
    }
    let steps = Steps::new("cues", sets.len(), run.progress);
    let columns = ["scenes", "measured"].into_iter().map(str::to_owned).chain(MEASURES.map(Measure::name));
    let mut table = Table::new("Outlines: what limits them, with perfect masks", columns.collect::<Vec<_>>());
    for (name, scenes) in &sets {
        for (lines, label) in ROWS {
            let scores: Vec<Vec<ObjectScore>> =
                scenes.par_iter().map(|scene| scene.scores(lines, run.seed)).collect::<Result<_, Error>>()?;
            let figure = |measure: Measure| -> Option<Figure> {
                pooled(&scores.iter().map(|scores| measure.values(scores)).collect::<Vec<_>>())
            };
            let figures = MEASURES.map(|measure| Cell::figure(figure(measure), measure.decimals()));
            table.push([name.as_str().into(), label.into()].into_iter().chain(figures).collect());
            if name.starts_with("real")
                && lines == Lines::OneSided
                && let Some(ours) = figure(Measure::EnclosingO3d)
            {
                report.headlines.push(Headline {
                    id: "cues_outlines_enclosing",
                    what: "O3D, enclosing, real images, true masks".to_owned(),
                    paper: None,
                    ours,
                    row: label.to_owned(),
                    decimals: 3,
                });
            }
        }
        steps.done();
    }
    table.note(format!(
        "Masks are those of the visible pixels, boxes the boxes around them. Rendered: {OBJECTS} objects in 20 views of 480 x 360 \
         pixels, alone or {TOGETHER} in a scene, where they hide parts of each other. The truth of other bodies is the smallest \
         ellipsoid around them. Contacts are places where a mask lies within two pixels of another one."
    ));
    report.table(table);
    Ok(())
}

//! The real scenes, as they are and with mistakes.

use std::path::Path;

use quadlift::diagnosis::{Diagnosis, diagnose};
use quadlift::scene::{Scene, SceneError};
use rayon::prelude::*;

use super::Verdict;
use super::mistakes::{all, bodies, harm};
use crate::data::TrueScene;
use crate::error::Error;
use crate::paper::ACCV_SEQUENCES;

/// Fewest views and objects of a large scene.
const LARGE: (usize, usize) = (8, 5);

/// Results for the real scenes.
pub(super) struct RealVerdicts {
    /// Of right ones, by data set.
    pub right: Vec<(&'static str, Vec<Diagnosis>)>,
    /// Of those with a mistake.
    pub wrong: Vec<(String, Verdict)>,
}

/// Files by data set.
fn files() -> [(&'static str, Vec<String>); 5] {
    let kitti = |poses: &str, names: &[&str]| names.iter().map(|name| format!("kitti_{name}_{poses}")).collect();
    [
        ("LINEMOD", ACCV_SEQUENCES.iter().map(|name| format!("accv_{name}")).collect()),
        ("LMO", vec!["lmo_A".to_owned(), "lmo_B".to_owned()]),
        ("TUW", vec!["tuw_demo".to_owned()]),
        ("KITTI, aligned poses", kitti("aligned", &["S05", "S09", "S22", "S23", "S35", "S35ext", "S36"])),
        ("KITTI, GPS poses", kitti("oxts", &["S05", "S09", "S22", "S36"])),
    ]
}

/// A scene with the detections of one source only.
fn of_source(scene: &Scene, source: Option<u32>) -> Result<Scene, SceneError> {
    let mut one = scene.clone().into_parts();
    one.detections.retain(|detection| detection.source_index == source);
    one.detections.iter_mut().for_each(|detection| detection.source_index = None);
    one.sources.clear();
    Scene::from_parts(one)
}

/// Checks every source of every scene, as it is and with every `stride`th mistake.
pub(super) fn run(data: &Path, stride: usize) -> Result<RealVerdicts, Error> {
    let mut verdicts = RealVerdicts { right: Vec::new(), wrong: Vec::new() };
    for (set, files) in files() {
        let mut right = Vec::new();
        for file in files {
            let scene = TrueScene::read(data, &file, &file)?.scene;
            let sources = (0..scene.sources.len()).map(|index| Some(index as u32)).chain([None]);
            for source in sources {
                let one = of_source(&scene, source)?;
                if one.detections.is_empty() {
                    continue;
                }
                right.push(diagnose(&one, |_| true));
                // What is right is the estimate from the right scene: true bodies are of another kind.
                let estimates = bodies(&one);
                let truth: Vec<_> = estimates.clone().into_iter().collect();
                let large = one.frames.len() >= LARGE.0 && truth.len() >= LARGE.1;
                let verdict = |mistake: &super::mistakes::NamedMistake| {
                    let wrong = mistake.make(&one)?;
                    let diagnosis = diagnose(&wrong, |_| true);
                    let named = diagnosis.causes.first().is_some_and(|cause| cause.name == mistake.cause());
                    let verdict = Verdict {
                        called_wrong: !diagnosis.consistent,
                        named: !diagnosis.consistent && named,
                        harm: harm(&truth, &estimates, &wrong),
                        large,
                        hidden: false,
                    };
                    Some((mistake.name(), verdict))
                };
                let mistakes: Vec<_> = all().into_iter().step_by(stride.max(1)).collect();
                let found: Vec<_> = mistakes.par_iter().filter_map(verdict).collect();
                verdicts.wrong.extend(found);
            }
        }
        verdicts.right.push((set, right));
    }
    Ok(verdicts)
}

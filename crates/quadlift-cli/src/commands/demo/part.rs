//! What both scenes of the demo go through: identities, objects, comparison with the truth.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

use anyhow::Context;
use quadlift::Localization;
use quadlift::associate::{AssociateOptions, Association};
use quadlift::metrics::{Evaluation, Mean};
use quadlift::scene::Scene;
use quadlift::solve::Estimate;
use quadlift_io::SceneFile;
use quadlift_io::association::{add_to_result, write_objects};
use quadlift_io::evaluation::{Matching, evaluate_objects};

use crate::association::{associate_scene, associated_scene};
use crate::diagnosis::Check;
use crate::localization::{Settings, localize_scene, result_file};
use crate::output::{HEADING, Output};
use crate::table::{Cell, Table, number};
use crate::words::{count, with_unit};

/// What a user brings, and what is true about it: the detections know nothing of the objects.
pub fn apart(whole: SceneFile) -> (SceneFile, SceneFile) {
    let truth = SceneFile { detections: Vec::new(), ..whole.clone() };
    let mut scene = SceneFile { objects: Vec::new(), ..whole };
    for detection in &mut scene.detections {
        (detection.object, detection.visible_fraction) = (None, None);
    }
    (scene, truth)
}

/// Finds out which detections show the same object and writes it into them.
pub fn find_identities(file: &mut SceneFile, out: &Output) -> anyhow::Result<(Scene, Association)> {
    let scene = file.to_scene().context("cannot use the scene")?;
    let association = associate_scene("demo", &scene, &AssociateOptions::default(), &Check::default(), out)?;
    let associated = associated_scene(&scene, &association, None)?;
    write_objects(&mut file.detections, &associated);
    Ok((associated, association))
}

/// What was found out about identities.
pub fn identities_in_words(association: &Association) -> String {
    let members = association.object_of_detection.iter().flatten().count();
    let objects = count(association.objects.len(), "object");
    format!("{objects} in {members} of {} boxes", association.object_of_detection.len())
}

/// Gives the true objects the ids under which they were found, so that they can be compared: each that of the object
/// with which it shares the most detections. `true_objects` has the index of each detection's true object.
pub fn name_as_found(truth: &mut SceneFile, true_objects: &[Option<usize>], association: &Association) {
    let mut shared: BTreeMap<(usize, u32), usize> = BTreeMap::new();
    for (object, found) in true_objects.iter().zip(&association.object_of_detection) {
        if let (Some(object), Some(found)) = (object, found) {
            *shared.entry((*object, *found)).or_default() += 1;
        }
    }
    let mut pairs: Vec<((usize, u32), usize)> = shared.into_iter().collect();
    pairs.sort_by_key(|(_, count)| Reverse(*count));
    let (mut named, mut given) = (HashSet::new(), HashSet::new());
    for ((object, found), _) in pairs {
        if !named.contains(&object) && given.insert(found) {
            named.insert(object);
            truth.objects[object].id = association.objects[found as usize].id.clone();
        }
    }
}

/// The estimates of a scene, as a file, and how good they are.
pub struct Result {
    /// The estimates.
    pub localization: Localization,
    /// The same as `quadlift localize` writes it.
    pub file: SceneFile,
    /// How good they are.
    pub evaluation: Evaluation,
}

/// Localises the objects of a scene and compares them with the truth. With an association the result has what
/// `quadlift localize` writes of identities that it has found itself.
pub fn localize_and_compare(
    (file, scene): (&SceneFile, &Scene),
    association: Option<&Association>,
    truth: &SceneFile,
    settings: &Settings,
    out: &Output,
) -> anyhow::Result<Result> {
    let mut localization = localize_scene("demo", scene, settings, out)?;
    if association.is_some() {
        // They show no object, which is told with the identities.
        localization.left_out.without_object = 0;
    }
    let mut result = result_file(file, scene, &localization, settings);
    if let Some(association) = association {
        add_to_result(&mut result, file.detections.clone(), scene, None, association);
    }
    let (estimate, truth) = ((Path::new("estimate.json"), &result), (Path::new("truth.json"), truth));
    let (evaluation, _) = evaluate_objects(estimate, truth, Matching::Auto)?;
    Ok(Result { localization, file: result, evaluation })
}

/// One row for each object, estimated or true: what was found, and how far it is from the truth.
pub fn table(scene: &Scene, result: &Result) -> String {
    let unit = scene.length_unit.as_deref();
    let mut table = Table::new([
        "<object".to_owned(),
        "views".to_owned(),
        with_unit("size", unit),
        "IoU".to_owned(),
        with_unit("centre off", unit),
        "axis off [deg]".to_owned(),
    ]);
    let off = |iou: Option<f64>, center: Option<f64>, axis: Option<f64>| {
        [number(iou, 2), number(center, 3), number(axis.map(f64::to_degrees), 1)]
    };
    let estimates: Vec<(&str, &Estimate)> =
        result.localization.estimates.iter().map(|e| (scene.object_ids[e.object_index].as_str(), e)).collect();
    for &(id, estimate) in &estimates {
        let score = result.evaluation.objects.iter().find(|score| score.id == id);
        let off = score.map_or_else(Default::default, |s| off(s.iou3d, s.center_error, s.theta_err));
        let size = estimate.ellipsoid().map_or_else(String::new, |ellipsoid| {
            let mut lengths: [f64; 3] = (2.0 * ellipsoid.semi_axes).into();
            lengths.sort_by(|a, b| b.total_cmp(a));
            lengths.map(|x| number(Some(x), 2)).join(" x ")
        });
        let views = format!("{}/{}", estimate.views_used(), estimate.views.len());
        table.push([id.into(), views.into(), size.into()].into_iter().chain(off.map(Cell::from)).collect());
    }
    for score in &result.evaluation.objects {
        if !estimates.iter().any(|(id, _)| *id == score.id) {
            table.push(vec![Cell::from(&score.id), "not found".into()]);
        }
    }
    let mean = &result.evaluation.mean;
    let value = |mean: Option<Mean>| mean.map(|mean| mean.value);
    let off = off(value(mean.iou3d), value(mean.center_error), value(mean.theta_err));
    let means = off.map(|text| Cell::styled(text, HEADING));
    table.push([Cell::styled("mean", HEADING), "".into(), "".into()].into_iter().chain(means).collect());
    table.render()
}

#[cfg(test)]
mod tests {
    use quadlift::associate::AssociatedObject;
    use quadlift_io::scene_file::ObjectRecord;

    use super::*;

    #[test]
    fn true_objects_get_the_names_of_those_that_share_the_most_detections() {
        let object = |id: &str| ObjectRecord { id: id.to_owned(), ..Default::default() };
        let mut truth = SceneFile { objects: ["a", "b", "c"].map(object).to_vec(), ..Default::default() };
        let found = |id: &str| AssociatedObject {
            id: id.to_owned(),
            category_index: None,
            views: 0,
            expected_views: 0,
            evidence: None,
            ellipsoid: None,
            doubtful: None,
        };
        // One of a is taken for b, b was found twice, c not at all, and a wrong box belongs to the second b.
        let association = Association {
            object_of_detection: [0, 0, 1, 1, 1, 2, 2].map(Some).into_iter().chain([None]).collect(),
            objects: ["x", "y", "z"].map(found).to_vec(),
            ..Default::default()
        };
        let true_objects = [Some(0), Some(0), Some(0), Some(1), Some(1), Some(1), None, Some(2)];
        name_as_found(&mut truth, &true_objects, &association);
        let ids: Vec<&str> = truth.objects.iter().map(|object| object.id.as_str()).collect();
        assert_eq!(ids, ["x", "y", "c"]);
    }
}

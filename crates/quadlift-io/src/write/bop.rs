//! BOP's results: a row for each object in each frame with its pose `cam_from_object` in millimeters.
//!
//! The object's frame is that of its body (origin at the center, axes of the body), since models are not known. Format:
//! the BOP challenge's CSV, as `load_bop_results` of the bop_toolkit reads it.

use std::fmt::Write;

use super::format::{ExportFormat, Writer};
use super::views::SeenObject;
use super::{CheckedScene, Document, numbers_for};

/// Millimeters in a meter.
const MM: f64 = 1000.0;

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "bop",
    about: "BOP results: poses of the bodies in each frame, millimeters",
    options: &["only_detected", "scene_id", "length_unit"],
    write: Writer::Bodies(|scene, options| {
        Ok(bop_results(scene, options.scene_id.unwrap_or(0), options.only_detected))
    }),
};

/// The poses of all frames, in their order. `im_id` is the frame id if all frames have whole numbers, otherwise its
/// position; `obj_id` the number in the object's category or id (`obj_000005` or `5`) or its position from 1. The score
/// is 1 and the time -1 (not known).
pub(super) fn bop_results(scene: &CheckedScene, scene_id: u64, only_detected: bool) -> Document {
    let (images, by_position) = numbers_for(scene.scene.frames.iter().map(|frame| frame.id.as_str()), "");
    let model = |name: Option<&str>| name?.trim_start_matches("obj_").parse::<u64>().ok();
    let models: Option<Vec<u64>> =
        scene.objects.iter().map(|o| model(o.category.as_deref()).or_else(|| model(Some(&o.id)))).collect();
    let (meters, unit_note) = scene.meters();
    let mut text = "scene_id,im_id,obj_id,score,R,t,time\n".to_owned();
    let mut rows = 0;
    for SeenObject { frame_index, object_index, .. } in scene.seen_objects(only_detected) {
        let Some(pose) = scene.scene.frames[frame_index].projection.camera_pose() else { continue };
        let body = &scene.objects[object_index].body;
        let rotation = pose.matrix().fixed_columns::<3>(0) * body.rotation.matrix();
        let translation = pose.matrix() * body.center.to_homogeneous() * meters * MM;
        let object = models.as_ref().map_or(object_index as u64 + 1, |models| models[object_index]);
        // By rows; writing to text cannot fail.
        let _ = writeln!(
            text,
            "{scene_id},{},{object},1,{},{},-1",
            images[frame_index],
            numbers(rotation.transpose().iter()),
            numbers(translation.iter()),
        );
        rows += 1;
    }
    let mut notes =
        vec!["poses are those of the estimated bodies (center, axes): there are no object models".to_owned()];
    if by_position {
        notes.push("frame ids have no numbers: im_id counts from 0 in the order of the scene".to_owned());
    }
    if models.is_none() {
        notes.push("neither categories nor ids are numbers: obj_id counts the objects from 1".to_owned());
    }
    notes.extend(unit_note);
    Document { content: text.into_bytes(), counts: vec![("pose", rows)], notes }
}

fn numbers<'a>(numbers: impl Iterator<Item = &'a f64>) -> String {
    // No "-0".
    numbers.map(|x| (x + 0.0).to_string()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;

    #[test]
    fn poses_are_in_millimeters_by_rows() {
        let mut file = test_scene::three_bodies();
        // Half a turn, so that all numbers are exact.
        file.objects[1].cuboid.as_mut().unwrap().rotation = [0.0, 0.0, 0.0, 1.0];
        let results = |file: &_| bop_results(&CheckedScene::new(file, BodyChoice::Body).unwrap(), 7, false);
        let document = results(&file);
        insta::assert_snapshot!(String::from_utf8(document.content).unwrap());
        assert_eq!((document.counts, document.notes.len()), (vec![("pose", 6)], 2));
        // Models by their names.
        for (object, category) in file.objects.iter_mut().zip(["obj_000005", "obj_000009", "12"]) {
            object.category = Some(category.into());
        }
        let text = String::from_utf8(results(&file).content).unwrap();
        let ids: Vec<&str> = text.lines().skip(1).map(|line| line.split(',').nth(2).unwrap()).collect();
        assert_eq!(ids, ["5", "9", "12", "5", "9", "12"]);
    }
}

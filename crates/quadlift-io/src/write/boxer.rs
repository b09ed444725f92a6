//! CSV of oriented 3D boxes per frame, as Boxer writes and reads them (`boxer_3dbbs.csv`; header of Meta's `ObbCsvWriter2`).
//!
//! Positions and sizes (full extents) in meters, quaternions of `world_from_object` with w first.

use std::fmt::Write;

use quadlift::geometry::quaternion_from_rotation;

use super::format::{ExportFormat, Writer};
use super::scores::Scores;
use super::stamps::stamps;
use super::views::SeenObject;
use super::{CheckedScene, Document, numbers_for};

/// The columns.
const HEADER: &str = "time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,qy_world_object,\
                      qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob";

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "boxer",
    about: "CSV of oriented 3D boxes per frame, as Boxer writes them",
    options: &["enclosing", "only_detected"],
    write: Writer::Bodies(|scene, options| Ok(boxer(scene, options.only_detected))),
};

/// A row for each object in each frame, by time. `instance` is the number in the object's id or its position, `sem_id` the
/// position of the category, `prob` the score.
pub(super) fn boxer(scene: &CheckedScene, only_detected: bool) -> Document {
    let mut notes = vec!["the axes are those of the scene's world".to_owned()];
    let (meters, unit_note) = scene.meters();
    notes.extend(unit_note);
    let times = stamps(scene, &mut notes);
    let scores = Scores::of(scene, &mut notes);
    let (instances, by_position) = numbers_for(scene.objects.iter().map(|object| object.id.as_str()), "");
    if by_position {
        notes.push(
            "object ids are not all different numbers: instance counts from 0 in the order of the scene".to_owned(),
        );
    }
    let categories = scene.category_indices();
    let mut seen = scene.seen_objects(only_detected);
    seen.sort_by_key(|seen| times[seen.frame_index]);
    let mut text = format!("{HEADER}\n");
    for SeenObject { frame_index, object_index, .. } in &seen {
        let object = &scene.objects[*object_index];
        let body = &object.body;
        let position = body.center.coords * meters;
        let size = body.half_extents * (2.0 * meters);
        let rotation = quaternion_from_rotation(&body.rotation);
        let numbers = position.iter().chain(&rotation).chain(size.iter());
        // No "-0".
        let numbers: Vec<String> = numbers.map(|x| (x + 0.0).to_string()).collect();
        let score = scores.get(&object.id, Some(&scene.file.frames[*frame_index].id));
        // Writing to text cannot fail.
        let _ = writeln!(
            text,
            "{},{},{},{},{},{score}",
            times[*frame_index],
            numbers.join(","),
            name(object.category_name()),
            instances[*object_index],
            categories[object.category_name()],
        );
    }
    Document { content: text.into_bytes(), counts: vec![("box", seen.len())], notes }
}

/// A category as Boxer writes it: small letters, and blanks for what would end the field.
fn name(category: &str) -> String {
    let sign = |c: char| if c == ',' || c == '"' || c.is_control() { ' ' } else { c };
    category.chars().map(sign).collect::<String>().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::write::BodyChoice;
    use crate::write::test_scene::three_bodies;

    #[test]
    fn rows_have_their_fifteen_columns() {
        let mut file = three_bodies();
        file.frames[0].time = Some(2.5);
        file.frames[1].time = Some(1.25);
        file.detections[0].score = Some(0.75);
        file.objects[0].category = Some("Cup, large".into());
        let scene = CheckedScene::new(&file, BodyChoice::Tangent).unwrap();
        let document = boxer(&scene, false);
        assert_eq!(document.counts, [("box", 6)]);
        let text = String::from_utf8(document.content).unwrap();
        assert!(text.lines().all(|line| line.split(',').count() == 15), "{text}");
        insta::assert_snapshot!(format!("{}\n\n{text}", document.notes.join("\n")), @r"
    the axes are those of the scene's world
    2 objects without detections with scores in this file: score 1
    object ids are not all different numbers: instance counts from 0 in the order of the scene

    time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,qy_world_object,qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob
    1250000000,1,0.5,0,1,0,0,0,1,0.5,1.5,cup  large,0,0,1
    1250000000,-1,0,0.5,0.9689124217106448,0,0,0.2474039592545229,2,1,0.5,box,1,1,0.75
    1250000000,0,1,-1,1,0,0,0,1,1,0.5,cup,2,2,1
    2500000000,1,0.5,0,1,0,0,0,1,0.5,1.5,cup  large,0,0,1
    2500000000,-1,0,0.5,0.9689124217106448,0,0,0.2474039592545229,2,1,0.5,box,1,1,0.75
    2500000000,0,1,-1,1,0,0,0,1,1,0.5,cup,2,2,1
    ");
        // Detected: object 2 in one frame, object 1 in both (residuals).
        assert_eq!(boxer(&scene, true).counts, [("box", 3)]);
        // Millimeters become meters.
        let meters = String::from_utf8(boxer(&scene, false).content).unwrap();
        file.length_unit = Some("km".into());
        let scene = CheckedScene::new(&file, BodyChoice::Tangent).unwrap();
        let kilometers = String::from_utf8(boxer(&scene, false).content).unwrap();
        let number = |text: &str, column: usize| {
            text.lines().nth(1).unwrap().split(',').nth(column).unwrap().parse::<f64>().unwrap()
        };
        for column in [1, 2, 8, 9, 10] {
            assert_eq!(number(&kilometers, column), 1000.0 * number(&meters, column));
        }
    }
}

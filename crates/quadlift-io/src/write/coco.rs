//! COCO: images, categories, and the box of each object in each frame, as annotations `[x, y, width, height]`.
//!
//! Boxes are measured from the corner of the image as in scene files, in the image as it is (with its lens distortion),
//! and end at its border. `track_id` identifies the objects.

use serde_json::{Value, json};

use super::format::{ExportFormat, Writer};
use super::{CheckedScene, Document};

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "coco",
    about: "COCO annotations: the boxes of the bodies in each frame",
    options: &["enclosing", "only_detected"],
    write: Writer::Bodies(|scene, options| Ok(coco(scene, options.only_detected))),
};

/// The boxes of the bodies in the images. Ids count from 1: images by the frames, tracks by the objects, categories by
/// their first appearance.
pub(super) fn coco(scene: &CheckedScene, only_detected: bool) -> Document {
    let images: Vec<Value> = scene
        .scene
        .frames
        .iter()
        .zip(&scene.file.frames)
        .enumerate()
        .map(|(index, (frame, record))| {
            let name = record.image.as_ref().unwrap_or(&record.id);
            let mut image = json!({ "id": index + 1, "file_name": name, "frame": record.id });
            if let Some(size) = frame.image_size {
                image["width"] = json!(size.x.round() as u64);
                image["height"] = json!(size.y.round() as u64);
            }
            image
        })
        .collect();
    let category_indices = scene.category_indices();
    let categories: Vec<Value> = scene
        .categories()
        .iter()
        .enumerate()
        .map(|(index, name)| json!({ "id": index + 1, "name": name, "supercategory": "" }))
        .collect();
    let annotations: Vec<Value> = scene
        .seen_objects(only_detected)
        .iter()
        .enumerate()
        .map(|(index, seen)| {
            let object = &scene.objects[seen.object_index];
            let (corner, size) = (seen.bounding_box, seen.bounding_box.size());
            json!({
                "id": index + 1,
                "image_id": seen.frame_index + 1,
                "category_id": category_indices[object.category_name()] + 1,
                "bbox": [corner.x0(), corner.y0(), size.x, size.y],
                "area": size.x * size.y,
                "iscrowd": 0,
                "segmentation": [],
                "track_id": seen.object_index + 1,
                "object": object.id,
            })
        })
        .collect();
    let mut notes = Vec::new();
    if scene.scene.frames.iter().any(|frame| frame.image_size.is_none()) {
        notes.push("images without a size have no width and height, and their boxes may reach beyond them".to_owned());
    }
    let counts = vec![("image", images.len()), ("box", annotations.len())];
    let document = json!({
        "info": { "description": scene.file.name.as_deref().unwrap_or_default() },
        "images": images,
        "categories": categories,
        "annotations": annotations,
    });
    Document { content: format!("{document:#}\n").into_bytes(), counts, notes }
}

#[cfg(test)]
mod tests {
    use super::super::{BodyChoice, test_scene};
    use super::*;
    use quadlift::geometry::project_bounding_box;

    #[test]
    fn boxes_are_those_of_the_projected_bodies() {
        let mut file = test_scene::three_bodies();
        file.objects[2].category = None;
        let scene = CheckedScene::new(&file, BodyChoice::Body).unwrap();
        let document = coco(&scene, false);
        let json: Value = serde_json::from_slice(&document.content).unwrap();
        assert_eq!(document.counts, [("image", 2), ("box", 6)]);
        assert_eq!(
            json["images"][1],
            json!({"id": 2, "file_name": "images/000091.png", "frame": "000091", "width": 640, "height": 480})
        );
        let names: Vec<_> = json["categories"].as_array().unwrap().iter().map(|c| &c["name"]).collect();
        assert_eq!(names, ["cup", "box", "object"]);
        let last = &json["annotations"][5];
        assert_eq!((&last["image_id"], &last["category_id"], &last["track_id"]), (&json!(2), &json!(3), &json!(3)));
        let expected = project_bounding_box(&scene.scene.frames[1].projection, &scene.objects[2].body).unwrap();
        let bbox: [f64; 4] = serde_json::from_value(last["bbox"].clone()).unwrap();
        assert!((bbox[0] + bbox[2] - expected.x1()).abs() < 1e-9 && (bbox[1] - expected.y0()).abs() < 1e-9);
        assert_eq!(last["area"].as_f64().unwrap(), bbox[2] * bbox[3]);
        assert_eq!(coco(&scene, true).counts[1], ("box", 3));
    }
}

//! Files in formats whose feature is off: the message names it. `.ci/run` runs this without default features.
#![cfg(not(any(feature = "images", feature = "xml", feature = "yaml")))]

use std::path::Path;

use quadlift_io::ReadError;
use quadlift_io::read::detections::names::parse_names;
use quadlift_io::read::kitti_raw::parse_tracklets;
use quadlift_io::scene_file::parse_scene_file;

fn message<T>(result: Result<T, ReadError>) -> String {
    result.err().unwrap().to_string()
}

#[test]
fn the_feature_is_named() {
    let scene = br#"{"format": "quadlift.scene", "version": 1, "frames": [{"id": "a", "image": "a.png",
        "projection": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]}"#;
    let file = parse_scene_file(Path::new("scene.json"), scene).unwrap();
    let (scene, images) = (file.to_scene().unwrap(), file.to_images(Path::new("scene.json")).unwrap());
    assert_eq!(
        message(images.read_image(&scene, 0)),
        "a.png: PNG and JPEG images are left out of this build; the feature \"images\" of quadlift-io has them"
    );
    assert_eq!(
        message(parse_tracklets(Path::new("tracklet_labels.xml"), b"<a/>")),
        "tracklet_labels.xml: XML files are left out of this build; the feature \"xml\" of quadlift-io has them"
    );
    assert_eq!(
        message(parse_names(Path::new("data.yaml"), b"names: [cup]")),
        "data.yaml: YAML files are left out of this build; the feature \"yaml\" of quadlift-io has them"
    );
}

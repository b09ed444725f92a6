//! Files in formats whose feature is off: the message names it. `.ci/run` runs this without default features.
#![cfg(not(any(feature = "images", feature = "xml", feature = "yaml")))]

use std::path::Path;

use quadlift_io::ReadError;
use quadlift_io::formats::read_detections;
use quadlift_io::read::ReadOptions;
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
    let folder = tempfile::tempdir().unwrap();
    let [xml, labels, yaml] = ["a.xml", "a.txt", "data.yaml"].map(|name| folder.path().join(name));
    for (path, text) in [(&xml, "<annotation/>"), (&labels, "0 0.5 0.5 0.1 0.1\n"), (&yaml, "names: [cup]")] {
        std::fs::write(path, text).unwrap();
    }
    let error = message(read_detections(&xml, &ReadOptions::default()));
    assert!(
        error.ends_with("a.xml: XML files are left out of this build; the feature \"xml\" of quadlift-io has them")
    );
    let options = ReadOptions { names: Some(yaml), ..ReadOptions::default() };
    let error = message(read_detections(&labels, &options));
    assert!(
        error.ends_with(
            "data.yaml: YAML files are left out of this build; the feature \"yaml\" of quadlift-io has them"
        )
    );
}

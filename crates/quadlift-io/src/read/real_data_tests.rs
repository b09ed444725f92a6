//! Imports of real data, where they are at hand: the same cameras as in the ready scenes.

use std::path::Path;

use super::{ReadOptions, bop, kitti};
use crate::scene_file::{SceneFile, read_scene_file};
use crate::test_data::real_data as data;

/// Compares the cameras of the frames of a ready scene, 1e-6 relative; gives the largest difference.
fn compare(found: &SceneFile, ready: &SceneFile) -> f64 {
    let mut largest: f64 = 0.0;
    for expected in &ready.frames {
        let frame =
            found.frames.iter().find(|frame| frame.id == expected.id).unwrap_or_else(|| panic!("{}", expected.id));
        let camera = |scene: &SceneFile, id: &Option<String>| {
            scene.cameras.iter().find(|camera| Some(&camera.id) == id.as_ref()).unwrap().clone()
        };
        let (a, b) = (camera(found, &frame.camera), camera(ready, &expected.camera));
        assert_eq!((&a.model, a.width, a.height), (&b.model, b.width, b.height));
        for (p, q) in a.params.iter().zip(&b.params) {
            largest = largest.max((p - q).abs() / q.abs());
        }
        let (a, b) = (frame.cam_from_world.unwrap(), expected.cam_from_world.unwrap());
        // Rotations have entries of size one; translations are compared with the distance.
        let distance = (0..3).map(|i| b[i][3].powi(2)).sum::<f64>().sqrt().max(1.0);
        for i in 0..3 {
            for j in 0..4 {
                largest = largest.max((a[i][j] - b[i][j]).abs() / if j == 3 { distance } else { 1.0 });
            }
        }
    }
    largest
}

#[test]
fn kitti_sequences_have_the_cameras_of_the_ready_scenes() {
    let Some(folder) = data("kitti_tracking") else { return };
    for (scene, sequence, frames) in
        [("S05", "0000", 142..=153), ("S09", "0001", 90..=106), ("S22", "0007", 49..=86), ("S36", "0009", 44..=57)]
    {
        let Some(ready) = data(&format!("scenes/kitti_{scene}_oxts.json")) else { return };
        let ready = read_scene_file(&ready).unwrap();
        let options =
            ReadOptions { sequence: Some(sequence.to_owned()), frames: Some(frames), ..ReadOptions::default() };
        let found = (kitti::FORMAT.read)(&folder, &options).unwrap();
        let difference = compare(&found.scene, &ready);
        println!("kitti {scene}: {difference:.1e}; {:?}", found.notes);
        assert!(difference < 1e-6, "{scene}: {difference:e}");
        // The labeled boxes and the true objects are those of the ready scene, which has a part of them.
        for expected in ready.detections.iter().filter(|d| d.source.as_deref() == Some("label")) {
            let same =
                |d: &&crate::scene_file::DetectionRecord| d.frame == expected.frame && d.object == expected.object;
            let detection = found.scene.detections.iter().find(same).unwrap();
            let (a, b) = (detection.bounding_box.unwrap(), expected.bounding_box.unwrap());
            // The ready scenes have two decimals.
            assert!(a.iter().zip(&b).all(|(p, q)| (p - q).abs() < 0.006), "{a:?} {b:?}");
            assert_eq!((detection.occluded, detection.truncated), (expected.occluded, expected.truncated));
        }
        for expected in &ready.objects {
            let object = found.scene.objects.iter().find(|o| o.id == expected.id).unwrap();
            let (a, b) = (object.cuboid.as_ref().unwrap(), expected.cuboid.as_ref().unwrap());
            // The ready scenes average over other frames of the sequence.
            assert!((0..3).all(|i| (a.half_extents[i] - b.half_extents[i]).abs() < 1e-3), "{a:?} {b:?}");
            assert!((0..3).all(|i| (a.center[i] - b.center[i]).abs() < 0.3), "{a:?} {b:?}");
        }
    }
}

#[test]
fn bop_scenes_have_the_cameras_of_the_ready_scenes() {
    let Some(folder) = data("linemod/bop/test") else { return };
    let names =
        [(1, "ape"), (2, "vise"), (5, "can"), (6, "cat"), (8, "driller"), (9, "duck"), (11, "glue"), (13, "iron")];
    for (id, name) in names {
        let Some(ready) = data(&format!("scenes/accv_{name}.json")) else { return };
        let ready = read_scene_file(&ready).unwrap();
        let options = ReadOptions { world_object: Some(id), ..ReadOptions::default() };
        let found = (bop::FORMAT.read)(&folder.join(format!("{id:06}")), &options).unwrap();
        let difference = compare(&found.scene, &ready);
        println!("bop {name}: {difference:.1e}; {:?}", found.notes);
        assert!(difference < 1e-6, "{name}: {difference:e}");
        assert_eq!(found.scene.frames.len(), ready.frames.len());
        let (a, b) = (found.scene.objects[0].cuboid.as_ref().unwrap(), ready.objects[0].cuboid.as_ref().unwrap());
        assert!((0..3).all(|i| (a.half_extents[i] - b.half_extents[i]).abs() < 1e-5), "{a:?} {b:?}");
        assert!(found.scene.detections.iter().all(|d| d.object.as_deref() == Some(&format!("obj_{id:06}"))));
    }
    let error = (bop::FORMAT.read)(&folder.join("000001"), &ReadOptions::default()).unwrap_err();
    assert!(error.problem.contains("--world-object ID): 1"), "{error}");
    let error = (bop::FORMAT.read)(Path::new("nowhere"), &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("there is no such file"), "{error}");
}

//! `quadlift synth --pedestrians`: a hall with fixed cameras in which people walk.

use quadlift::synthetic::{HallOptions, Noise, generate_hall};
use quadlift_io::scene_file::{CameraRecord, DetectionRecord, FrameRecord, RIG_FRAME};
use quadlift_io::{SceneFile, write_scene_file};
use serde_json::json;

use super::Args;
use crate::error::{Outcome, usage};
use crate::files::check_file;
use crate::next::Next;
use crate::output::Output;
use crate::words::count;

/// Time between two time steps, seconds.
const INTERVAL: f64 = 0.5;

/// Cameras, where their number is not given.
const CAMERAS: usize = 4;

/// Writes the hall.
pub(super) fn run(args: &Args, pedestrians: usize, out: &Output) -> anyhow::Result<Outcome> {
    check_file(&args.output)?;
    let edge_noise = match args.noise.as_slice() {
        [] => 0.0,
        [Noise::BoxEdges(amount)] if *amount >= 0.0 => *amount,
        _ => return usage("with --pedestrians only the boxes have noise, of one amount: --noise box:X"),
    };
    let detector = &args.detector;
    if !(0.0..=1.0).contains(&detector.misses) || detector.false_positives < 0.0 {
        return usage("expected --misses from 0 to 1 and --false-positives of 0 or more");
    }
    let options = HallOptions {
        seed: args.seed,
        cameras: args.cameras.unwrap_or(CAMERAS),
        pedestrians,
        time_steps: args.time_steps,
        interval: INTERVAL,
        edge_noise,
        misses: detector.misses,
        false_boxes: detector.false_positives,
        ids: !args.ids.no_ids,
        ..HallOptions::default()
    };
    let hall = generate_hall(&options)?;
    let [width, height] = hall.image_size.map(f64::from);
    let k = &hall.intrinsics;
    let camera_id = |camera: usize| format!("cam{camera}");
    let frame_id = |camera: usize, time_step: usize| format!("cam{camera}/{time_step:06}");
    let mut file = SceneFile {
        name: Some("hall".to_owned()),
        length_unit: Some("m".to_owned()),
        up: Some([0.0, 0.0, 1.0]),
        ..SceneFile::default()
    };
    for (camera, pose) in hall.cameras.iter().enumerate() {
        file.cameras.push(CameraRecord {
            id: camera_id(camera),
            model: "PINHOLE".to_owned(),
            width: Some(width),
            height: Some(height),
            params: vec![k.fx, k.fy, k.cx, k.cy],
            ..CameraRecord::default()
        });
        file.frames.extend((0..options.time_steps).map(|time_step| FrameRecord {
            id: frame_id(camera, time_step),
            camera: Some(camera_id(camera)),
            cam_from_world: Some(std::array::from_fn(|i| std::array::from_fn(|j| pose.matrix()[(i, j)]))),
            time: Some(INTERVAL * time_step as f64),
            extra: [(RIG_FRAME.to_owned(), time_step.into())].into_iter().collect(),
            ..FrameRecord::default()
        }));
    }
    // One source detects an object once in a frame, so that false boxes have no ids.
    file.detections.extend(hall.boxes.iter().map(|b| DetectionRecord {
        frame: frame_id(b.camera, b.time_step).into(),
        object: b.object.map(|object| format!("walker_{object}").into()),
        category: Some("person".into()),
        bounding_box: Some(b.bounding_box.edges()),
        ..DetectionRecord::default()
    }));
    write_scene_file(&args.output, &file)?;
    out.report(&format!(
        "wrote {}: {}, {} at {}, {} boxes\n",
        args.output.display(),
        count(hall.cameras.len(), "camera"),
        count(pedestrians, "walker"),
        count(options.time_steps, "time step"),
        hall.boxes.len(),
    ))?;
    let path = args.output.as_path();
    Next::default()
        .command(
            ["calibrate-rig".into(), path.into(), "--include-posed -o rig.json".into()],
            "find its cameras from the boxes alone",
        )
        .tell(out)?;
    out.document(&json!({
        "output": args.output.display().to_string(),
        "cameras": hall.cameras.len(),
        "pedestrians": pedestrians,
        "time_steps": options.time_steps,
        "detections": hall.boxes.len(),
    }))?;
    Ok(Outcome::Fine)
}

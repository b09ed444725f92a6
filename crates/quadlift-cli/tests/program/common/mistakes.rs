//! The usual mistakes, made in a right scene.

use serde_json::{Value, json};

use super::Folder;

/// A mistake: what is wrong, how it comes about, what the message and JSON say.
pub(crate) struct Mistake {
    /// Heading of the manual.
    pub title: &'static str,
    /// How it comes about, for the manual.
    pub story: &'static str,
    /// Words that the message holds.
    pub words: &'static str,
    /// Name of the cause.
    pub name: &'static str,
    /// The scene.
    pub scene: Value,
}

/// A right scene with ids: 8 objects in 12 frames, named by numbers without leading zeros.
pub(crate) fn right_scene(folder: &Folder) -> Value {
    folder.succeed("synth -o right.json --objects 8 --views 12 --seed 3 --noise box:0.02 --trajectory orbit");
    let mut right = folder.json("right.json");
    let new_id = |old: &Value| json!(format!("{}.jpg", old.as_str().unwrap().parse::<u32>().unwrap() + 1));
    for frame in right["frames"].as_array_mut().unwrap() {
        frame["id"] = new_id(&frame["id"]);
    }
    for detection in right["detections"].as_array_mut().unwrap() {
        detection["frame"] = new_id(&detection["frame"]);
    }
    folder.write_json("right.json", &right);
    right
}

/// `[R | t]` by rows.
pub(crate) type Pose = [[f64; 4]; 3];

/// The scene with other poses, `[R | t]` by rows.
pub(crate) fn with_poses(scene: &Value, change: impl Fn(Pose) -> Pose) -> Value {
    let mut scene = scene.clone();
    for frame in scene["frames"].as_array_mut().unwrap() {
        frame["cam_from_world"] = json!(change(serde_json::from_value(frame["cam_from_world"].clone()).unwrap()));
    }
    scene
}

/// The scene with other boxes.
pub(crate) fn with_boxes(scene: &Value, change: impl Fn([f64; 4]) -> [f64; 4]) -> Value {
    let mut scene = scene.clone();
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["box"] = json!(change(serde_json::from_value(detection["box"].clone()).unwrap()));
    }
    scene
}

/// The scene with other intrinsics fx, fy, cx, cy.
pub(crate) fn with_intrinsics(scene: &Value, change: impl Fn([f64; 4]) -> [f64; 4]) -> Value {
    let mut scene = scene.clone();
    scene["cameras"][0]["params"] =
        json!(change(serde_json::from_value(scene["cameras"][0]["params"].clone()).unwrap()));
    scene
}

/// The scene with detections in other frames: from the place of a frame to that of another one.
pub(crate) fn with_frames(scene: &Value, place: impl Fn(usize) -> Option<usize>) -> Value {
    let mut scene = scene.clone();
    let ids: Vec<Value> = scene["frames"].as_array().unwrap().iter().map(|frame| frame["id"].clone()).collect();
    scene["detections"].as_array_mut().unwrap().retain_mut(|detection| {
        let from = ids.iter().position(|id| *id == detection["frame"]).unwrap();
        let to = place(from).and_then(|to| ids.get(to));
        detection["frame"] = to.cloned().unwrap_or_default();
        to.is_some()
    });
    scene
}

/// Poses that map the other way.
pub(crate) fn inverse(m: Pose) -> Pose {
    [0, 1, 2].map(|i| {
        let t = -(0..3).map(|k| m[k][i] * m[k][3]).sum::<f64>();
        [m[0][i], m[1][i], m[2][i], t]
    })
}

/// Poses with OpenGL's camera axes.
pub(crate) fn opengl(m: Pose) -> Pose {
    [m[0], m[1].map(|x| -x), m[2].map(|x| -x)]
}

/// The mistakes that the consistency check is known to name in [`right_scene`].
pub(crate) fn mistakes(right: &Value) -> Vec<Mistake> {
    let [w, h] = ["width", "height"].map(|name| right["cameras"][0][name].as_f64().unwrap());
    let gain = 640.0 / w.max(h);
    let [px, py] = [w, h].map(|x| 0.5 * (640.0 - gain * x));
    let frames = right["frames"].as_array().unwrap().len();
    let mut names: Vec<(String, usize)> = (0..frames).map(|k| (format!("{}.jpg", k + 1), k)).collect();
    names.sort();
    let of = |title, story, words, name, scene| Mistake { title, story, words, name, scene };
    vec![
        of(
            "Camera-to-world poses",
            "`cam_from_world` maps world points to camera points, as in COLMAP. SLAM systems, ARKit and most data sets store \
             the inverse.",
            "camera-to-world",
            "camera_to_world",
            with_poses(right, inverse),
        ),
        of(
            "OpenGL camera axes",
            "quadlift uses OpenCV camera axes: y points down and z forwards. In OpenGL, y points up and z backwards.",
            "OpenGL axes",
            "opengl_axes",
            with_poses(right, opengl),
        ),
        of(
            "Camera-to-world poses with OpenGL axes",
            "nerfstudio, instant-ngp and Blender store camera-to-world poses with OpenGL axes. `quadlift import nerfstudio` \
             converts them; your own scripts must do the same.",
            "camera-to-world with OpenGL axes",
            "opengl_camera_to_world",
            with_poses(right, |m| inverse(opengl(m))),
        ),
        of(
            "Boxes of resized images",
            "The detector ran on resized images, or the cameras were calibrated on images of another size.",
            "image size",
            "image_size",
            with_boxes(right, |b| b.map(|x| x * 0.5)),
        ),
        of(
            "Boxes of letterboxed images",
            "Many networks take square images: a photo is scaled to fit and padded. The raw boxes of the network are in \
             pixels of that square. (For other shapes give the padded size, such as `--assume letterbox=640x384`.)",
            "letterboxed image of 640 x 640",
            "letterbox",
            with_boxes(right, |b| [b[0] * gain + px, b[1] * gain + py, b[2] * gain + px, b[3] * gain + py]),
        ),
        of(
            "Normalized boxes",
            "YOLO label files contain coordinates from 0 to 1, which `quadlift import yolo` converts; scene files \
             use pixels.",
            "boxes are normalized",
            "normalized_boxes",
            with_boxes(right, |b| [b[0] / w, b[1] / h, b[2] / w, b[3] / h]),
        ),
        of(
            "Pictures turned by their EXIF orientation",
            "Phones store pictures as the sensor sees them and say in EXIF how to turn them. Detectors turn them, many \
             reconstructions do not. YOLO's labels are fractions of the turned picture.",
            "turned by 90 degrees clockwise",
            "picture_orientation",
            with_boxes(right, |b| [w - b[3] * w / h, b[0] * h / w, w - b[1] * w / h, b[2] * h / w]),
        ),
        of(
            "Corners instead of center and size",
            "YOLO's label files have the center and the size of each box; here they have two corners.",
            "two corners were read as a center and a size",
            "box_format",
            with_boxes(right, |b| [b[0] - 0.5 * b[2], b[1] - 0.5 * b[3], b[0] + 0.5 * b[2], b[1] + 0.5 * b[3]]),
        ),
        of(
            "Swapped x and y of boxes",
            "Some programs (TensorFlow, NumPy code with rows first) write y before x.",
            "x and y of the boxes are swapped",
            "swapped_xy",
            with_boxes(right, |b| [b[1], b[0], b[3], b[2]]),
        ),
        of(
            "A wrong focal length",
            "Here the focal length is half of the correct one: the images were resized after the calibration, or the \
             value comes from the metadata of a photo.",
            "focal length",
            "focal_length",
            with_intrinsics(right, |k| [0.5 * k[0], 0.5 * k[1], k[2], k[3]]),
        ),
        of(
            "Normalized intrinsics",
            "Some programs divide focal lengths and principal point by the width and height of the image.",
            "intrinsics are normalized",
            "normalized_intrinsics",
            with_intrinsics(right, |k| [k[0] / w, k[1] / h, k[2] / w, k[3] / h]),
        ),
        of(
            "Detections off by one frame",
            "The detector counts frames from 1 and the poses from 0, or a video lost its first frame.",
            "frame order is off by 1 frame",
            "frame_offset",
            with_frames(right, |k| Some(k + 1)),
        ),
        of(
            "Different frame orders",
            "A program that sorts file names puts `10.jpg` before `2.jpg`; the poses are in numerical order.",
            "frame order",
            "frame_order",
            with_frames(right, |k| Some(names[k].1)),
        ),
    ]
}

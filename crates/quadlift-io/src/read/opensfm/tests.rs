use nalgebra::Point3;
use serde_json::json;

use super::*;

fn parse(document: &Value) -> Result<Import, ReadError> {
    parse_opensfm(Path::new("reconstruction.json"), document.to_string().as_bytes(), None, 100)
}

const ROTATION: [f64; 3] = [0.3, -1.1, 0.7];
const TRANSLATION: [f64; 3] = [0.2, -0.4, 6.0];

fn document(camera: &Value) -> Value {
    json!([{
        "cameras": {"v2 a": camera, "unused": {"projection_type": "dual"}},
        "shots": {"b.jpg": {"rotation": ROTATION, "translation": TRANSLATION, "camera": "v2 a", "orientation": 6,
                            "capture_time": 1.5e9},
                  "a.jpg": {"rotation": [0, 0, 0], "translation": [0, 0, 0], "camera": "v2 a", "capture_time": 0.0}},
        "points": {"7": {"color": [0, 0, 0], "coordinates": [1.0, 2.0, 3.0]}},
    }])
}

/// A world point in the camera, by the formula of Rodrigues.
fn in_camera(world: [f64; 3]) -> [f64; 3] {
    let (r, x) = (Vector3::from(ROTATION), Vector3::from(world));
    let (angle, axis) = (r.norm(), r.normalize());
    let turned = x * angle.cos() + axis.cross(&x) * angle.sin() + axis * axis.dot(&x) * (1.0 - angle.cos());
    (turned + Vector3::from(TRANSLATION)).into()
}

/// The pixel by the formulae of OpenSfM's documentation for points of distortion 1: `u, v` are shares of the larger side;
/// its pixel (0, 0) is the center of the first one.
fn pixel(camera: &Value, [x, y, z]: [f64; 3]) -> [f64; 2] {
    let number = |key: &str| camera[key].as_f64().unwrap_or(0.0);
    let [k1, k2, k3, k4, p1, p2] = ["k1", "k2", "k3", "k4", "p1", "p2"].map(number);
    let [fx, fy] = ["focal_x", "focal_y"].map(|key| camera[key].as_f64().unwrap_or_else(|| number("focal")));
    let (w, h) = (number("width"), number("height"));
    let [u, v] = match camera["projection_type"].as_str().unwrap_or("perspective") {
        "fisheye" | "fisheye_opencv" => {
            let r = x.hypot(y);
            let t = (r / z).atan();
            let d = t * (1.0 + k1 * t.powi(2) + k2 * t.powi(4) + k3 * t.powi(6) + k4 * t.powi(8));
            [fx * d * x / r, fy * d * y / r]
        }
        "spherical" => {
            let (longitude, latitude) = (x.atan2(z), (-y).atan2(x.hypot(z)));
            [longitude / std::f64::consts::TAU, -latitude / std::f64::consts::TAU]
        }
        _ => {
            let (x, y) = (x / z, y / z);
            let r2 = x * x + y * y;
            let d = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
            [
                fx * (d * x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)),
                fy * (d * y + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y)),
            ]
        }
    };
    let side = w.max(h);
    let opencv = [side * (u + number("c_x")) + 0.5 * (w - 1.0), side * (v + number("c_y")) + 0.5 * (h - 1.0)];
    opencv.map(|x| x + 0.5)
}

#[test]
fn points_are_projected_as_by_opensfm() {
    let brown = json!({"projection_type": "brown", "width": 1368, "height": 912, "focal_x": 0.67, "focal_y": 0.66,
        "c_x": -0.0015, "c_y": 0.0047, "k1": -0.26, "k2": 0.1, "p1": 7e-4, "p2": 3e-4, "k3": -0.026});
    for (camera, model) in [
        (json!({"width": 640, "height": 480, "focal": 0.9}), "PINHOLE"),
        (
            json!({"projection_type": "perspective", "width": 480, "height": 640, "focal": 0.9, "k1": -0.1, "k2": 0.02}),
            "OPENCV",
        ),
        (
            json!({"projection_type": "simple_radial", "width": 640, "height": 480, "focal_x": 0.9, "focal_y": 0.8, "c_x": 0.01,
            "c_y": -0.02, "k1": -0.1}),
            "OPENCV",
        ),
        (brown, "FULL_OPENCV"),
        (
            json!({"projection_type": "fisheye", "width": 640, "height": 480, "focal": 0.5, "k1": -0.05, "k2": 0.01}),
            "OPENCV_FISHEYE",
        ),
        (
            json!({"projection_type": "fisheye_opencv", "width": 640, "height": 480, "focal_x": 0.5, "focal_y": 0.55, "c_x": 0.01,
            "c_y": 0.0, "k1": -0.05, "k2": 0.01, "k3": 0.002, "k4": -0.001}),
            "OPENCV_FISHEYE",
        ),
        (json!({"projection_type": "spherical", "width": 1000, "height": 500}), "EQUIRECTANGULAR"),
    ] {
        let import = parse(&document(&camera)).unwrap();
        assert_eq!((import.scene.cameras.len(), import.scene.cameras[0].model.as_str()), (1, model));
        let ours = Camera::new(CameraModel::from_name(model).unwrap(), &import.scene.cameras[0].params).unwrap();
        let pose = import.scene.frames[1].cam_from_world.unwrap();
        for world in [[0.0, 0.0, 0.0], [0.8, -0.4, 0.3], [-1.2, 0.9, -0.6]] {
            let expected = pixel(&camera, in_camera(world));
            let point = pose.map(|r| r[0] * world[0] + r[1] * world[1] + r[2] * world[2] + r[3]);
            let found = ours.project_point(&Point3::from(point)).unwrap();
            let difference = (found.x - expected[0]).hypot(found.y - expected[1]);
            assert!(difference < 1e-9, "{camera} {world:?}: {found} {expected:?}");
        }
    }
}

#[test]
fn shots_points_and_times_are_read() {
    let import = parse(&document(&json!({"width": 640, "height": 480, "focal": 0.9}))).unwrap();
    let scene = &import.scene;
    let ids: Vec<&str> = scene.frames.iter().map(|frame| frame.id.as_str()).collect();
    assert_eq!(ids, ["a.jpg", "b.jpg"]);
    assert_eq!(scene.frames[0].time, None);
    assert_eq!((scene.frames[1].time, scene.frames[1].image.as_deref()), (Some(1.5e9), Some("b.jpg")));
    assert_eq!(scene.frames[1].camera.as_deref(), Some("v2 a"));
    assert_eq!(scene.points, [[1.0, 2.0, 3.0]]);
    assert_eq!((scene.up, &scene.length_unit), (None, &None));
    insta::assert_snapshot!(import.notes.join("\n"), @r"
    OpenSfM: poses need no conversion; focal lengths and principal points became pixels
    there is no reference_lla: the length unit and the direction of gravity are unknown
    1 shot with an EXIF orientation: boxes must be in the pixels as they are stored, not as viewers turn them
    1 point of the reconstruction
    ");
}

#[test]
fn the_largest_reconstruction_is_read() {
    let mut two = document(&json!({"width": 640, "height": 480, "focal": 0.9}));
    let mut small = two[0].clone();
    small["shots"].as_object_mut().unwrap().remove("a.jpg");
    let largest = two[0].clone();
    two = json!([small, largest, largest]);
    let import = parse(&two).unwrap();
    assert_eq!(import.scene.frames.len(), 2);
    insta::assert_snapshot!(import.notes[1], @"the largest of 3 reconstructions was read, number 2 with 2 shots; each has a world frame of its own");
}

#[test]
fn a_reference_gives_meters_and_up() {
    let camera = json!({"width": 640, "height": 480, "focal": 0.9});
    let mut document = document(&camera);
    let reference = json!({"latitude": 48.2, "longitude": 16.37, "altitude": 0.0});
    let path = Path::new("reconstruction.json");
    let bytes = document.to_string();
    let beside = reference.to_string();
    let beside = Some((Path::new("reference_lla.json"), beside.as_bytes()));
    let import = parse_opensfm(path, bytes.as_bytes(), beside, 100).unwrap();
    assert_eq!((import.scene.up, import.scene.length_unit.as_deref()), (Some([0.0, 0.0, 1.0]), Some("m")));
    assert_eq!(import.scene.extra["reference_lla"], reference);
    assert_eq!(import.scene.with_results(Vec::new(), Value::Null).extra["reference_lla"], reference);
    // The reconstruction's own comes first; zeros stand for none.
    document[0]["reference_lla"] = json!({"latitude": 0.0, "longitude": 0.0, "altitude": 0.0});
    let import = parse_opensfm(path, document.to_string().as_bytes(), beside, 100).unwrap();
    assert_eq!(import.scene.up, None);
    document[0]["reference_lla"] = json!({"latitude": 91.0, "longitude": 0.0, "altitude": 0.0});
    insta::assert_snapshot!(parse(&document).unwrap_err(), @"reconstruction.json: [0].reference_lla.latitude: found 91, expected degrees from -90 to 90");
}

#[test]
fn messages_name_the_entry() {
    let good = document(&json!({"width": 640, "height": 480, "focal": 0.9}));
    let message = |change: &dyn Fn(&mut Value)| {
        let mut document = good.clone();
        change(&mut document);
        parse(&document).unwrap_err().to_string()
    };
    let messages = [
        message(&|all| *all = json!([])),
        message(&|all| *all = json!({"shots": {}})),
        message(&|all| all[0]["shots"]["a.jpg"]["camera"] = json!("c")),
        message(&|all| all[0]["shots"]["a.jpg"]["rotation"] = json!([1, 2])),
        message(&|all| drop(all[0]["shots"]["a.jpg"].as_object_mut().unwrap().remove("translation"))),
        message(&|all| all[0]["cameras"]["v2 a"]["projection_type"] = json!("fisheye62")),
        message(&|all| all[0]["cameras"]["v2 a"]["projection_type"] = json!("spherical")),
        message(&|all| drop(all[0]["cameras"]["v2 a"].as_object_mut().unwrap().remove("focal"))),
        message(&|all| all[0]["cameras"]["v2 a"]["width"] = json!(0)),
        message(&|all| all[0]["cameras"]["v2 a"]["focal"] = json!(-1)),
        message(&|all| all[0]["points"]["7"]["coordinates"] = json!("x")),
    ];
    insta::assert_snapshot!(messages.join("\n"), @r#"
    reconstruction.json: found an empty list, expected a reconstruction
    reconstruction.json: found an object {...}, expected a list
    reconstruction.json: [0].shots.a.jpg.camera: "cameras" has no "c"
    reconstruction.json: [0].shots.a.jpg.rotation: found a list of 2, expected a list of 3 numbers
    reconstruction.json: [0].shots.a.jpg: there is no "translation"
    reconstruction.json: [0].cameras.v2 a: the projection_type "fisheye62" is not supported; expected perspective, simple_radial, radial, brown, fisheye, fisheye_opencv, spherical or equirectangular
    reconstruction.json: [0].cameras.v2 a: a spherical image of 640x480; expected twice as wide as high
    reconstruction.json: [0].cameras.v2 a: there is no "focal"
    reconstruction.json: [0].cameras.v2 a.width: found 0, expected a positive number of pixels
    reconstruction.json: [0].cameras.v2 a: focal lengths are (-640, -640); expected two positive numbers (the intrinsics are singular)
    reconstruction.json: [0].points.7.coordinates: found the text "x", expected a list of 3 numbers
    "#);
}

use super::*;
use nalgebra::{Rotation3, Vector4};
use serde_json::{Value, json};

fn parse(document: &Value) -> Result<Import, ReadError> {
    let nothing = |_: &str| false;
    let no_size = |_: &str| None;
    parse_nerfstudio(
        Path::new("transforms.json"),
        document.to_string().as_bytes(),
        PixelCenters::Half,
        &nothing,
        &no_size,
    )
}

/// `cam_from_world` of a COLMAP image.
fn colmap_pose() -> Matrix4<f64> {
    super::super::poses::matrix4(Rotation3::from_euler_angles(0.3, -0.8, 1.2).matrix(), &Vector3::new(0.4, -0.7, 2.5))
}

fn as_json(matrix: &Matrix4<f64>) -> Value {
    json!([0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)])))
}

fn document(transform: &Matrix4<f64>) -> Value {
    json!({
        "camera_model": "OPENCV", "fl_x": 600.0, "fl_y": 610.0, "cx": 320.0, "cy": 241.0, "w": 640, "h": 480,
        "k1": -0.1, "k2": 0.01, "p1": 0.001, "p2": 0.002,
        "frames": [{"file_path": "./images/frame_00001.png", "transform_matrix": as_json(transform)}],
    })
}

/// The steps of `colmap_to_json` in nerfstudio 1.1.5 (`process_data/colmap_utils.py`), one after the other.
fn saved_by_nerfstudio(cam_from_world: &Matrix4<f64>) -> Matrix4<f64> {
    let mut c2w = cam_from_world.try_inverse().unwrap();
    // c2w[0:3, 1:3] *= -1
    for i in 0..3 {
        c2w[(i, 1)] *= -1.0;
        c2w[(i, 2)] *= -1.0;
    }
    // c2w = c2w[np.array([0, 2, 1, 3]), :]
    c2w.swap_rows(1, 2);
    // c2w[2, :] *= -1
    c2w.row_mut(2).neg_mut();
    c2w
}

#[test]
fn poses_of_colmap_come_back() {
    let mut document = document(&saved_by_nerfstudio(&colmap_pose()));
    document["applied_transform"] = json!([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]]);
    let import = parse(&document).unwrap();
    let (frame, camera) = (&import.scene.frames[0], &import.scene.cameras[0]);
    let found = from_rows(&frame.cam_from_world.unwrap());
    assert!((found - colmap_pose()).amax() < 1e-12, "{found}");
    assert_eq!(
        (frame.id.as_str(), frame.image.as_deref()),
        ("./images/frame_00001.png", Some("images/frame_00001.png"))
    );
    assert_eq!((camera.model.as_str(), camera.width, camera.height), ("OPENCV", Some(640.0), Some(480.0)));
    assert_eq!(camera.params, [600.0, 610.0, 320.0, 241.0, -0.1, 0.01, 0.001, 0.002]);
}

#[test]
fn depth_images_are_kept_if_they_are_images() {
    let mut document = document(&Matrix4::identity());
    let depth = |document: &Value| parse(document).unwrap().scene.frames.remove(0).depth;
    assert_eq!(depth(&document), None);
    document["frames"][0]["depth_file_path"] = json!("./depths/frame_00001.png");
    let found = depth(&document).unwrap();
    assert_eq!((found.path.as_str(), found.scale), ("depths/frame_00001.png", 0.001));
    document["frames"][0]["depth_file_path"] = json!("depths/frame_00001.npy");
    assert_eq!(depth(&document), None);
}

#[test]
fn a_scaled_and_shifted_world_is_undone() {
    let turn = Rotation3::from_euler_angles(0.1, 0.2, 0.3);
    let (shift, scale) = (Vector3::new(1.0, 2.0, 3.0), 0.25);
    let world_from_cam = inverse(&(colmap_pose())).unwrap();
    let gl = Matrix4::from_diagonal(&Vector4::new(1.0, -1.0, -1.0, 1.0));
    let mut saved = super::super::poses::matrix4(turn.matrix(), &shift) * world_from_cam * gl;
    for i in 0..3 {
        saved[(i, 3)] *= scale;
    }
    let mut document = document(&saved);
    let applied = super::super::poses::matrix4(turn.matrix(), &shift);
    document["applied_transform"] = json!(rows(&applied));
    document["applied_scale"] = json!(scale);
    let found = from_rows(&parse(&document).unwrap().scene.frames[0].cam_from_world.unwrap());
    assert!((found - colmap_pose()).amax() < 1e-12, "{found}");
}

#[test]
fn a_camera_above_looks_down_in_opengl_axes() {
    // Blender's camera without rotation looks along -z, its y is up in the image.
    let mut transform = Matrix4::identity();
    transform[(2, 3)] = 5.0;
    let scene = parse(&document(&transform)).unwrap().scene;
    let cam_from_world = from_rows(&scene.frames[0].cam_from_world.unwrap());
    let below = cam_from_world * Vector4::new(0.0, 1.0, 0.0, 1.0);
    assert_eq!([below.x, below.y, below.z], [0.0, -1.0, 5.0], "in front, and above the middle of the image");
}

#[test]
fn intrinsics_come_from_frames_angles_and_images() {
    let mut document = document(&Matrix4::identity());
    let own = document["frames"][0].clone();
    document["frames"] = json!([own, own, own, own]);
    for (index, name) in ["a", "b", "c", "d"].into_iter().enumerate() {
        document["frames"][index]["file_path"] = json!(name);
    }
    document["frames"][1]["fl_x"] = json!(700.0);
    document["frames"][2]["camera_model"] = json!("OPENCV_FISHEYE");
    document["frames"][2]["k3"] = json!(0.5);
    let scene = parse(&document).unwrap().scene;
    assert_eq!(scene.frames.iter().map(|f| f.camera.as_deref().unwrap()).collect::<Vec<_>>(), ["0", "1", "2", "0"]);
    assert_eq!((scene.cameras[1].params[0], scene.cameras[0].params[0]), (700.0, 600.0));
    assert_eq!((scene.cameras[2].model.as_str(), scene.cameras[2].params[6]), ("OPENCV_FISHEYE", 0.5));
    // Blender's synthetic scenes: an angle, no extension and no size.
    let blender = json!({
        "camera_angle_x": std::f64::consts::FRAC_PI_2,
        "frames": [{"file_path": "./train/r_0", "transform_matrix": as_json(&Matrix4::identity())}],
    });
    let import = parse_nerfstudio(
        Path::new("t.json"),
        blender.to_string().as_bytes(),
        PixelCenters::Integer,
        &|name| name == "train/r_0.png",
        &|name| (name == "train/r_0.png").then_some([800.0, 600.0]),
    )
    .unwrap();
    assert_eq!(import.scene.frames[0].image.as_deref(), Some("train/r_0.png"));
    let camera = &import.scene.cameras[0];
    assert_eq!(camera.model, "PINHOLE");
    let expected = [400.0, 400.0, 400.0, 300.0];
    assert!(camera.params.iter().zip(expected).all(|(p, q)| (p - q).abs() < 1e-9), "{camera:?}");
}

#[test]
fn each_axis_has_its_own_angle() {
    let document = json!({
        "w": 800, "h": 600,
        "camera_angle_x": std::f64::consts::FRAC_PI_2,
        "camera_angle_y": 2.0 * 0.5f64.atan(),
        "frames": [{"file_path": "a.png", "transform_matrix": as_json(&Matrix4::identity())}],
    });
    let camera = parse(&document).unwrap().scene.cameras[0].clone();
    // Half the width over the tangent of 45 degrees; half the height over 1/2.
    assert!((camera.params[0] - 400.0).abs() < 1e-9 && (camera.params[1] - 600.0).abs() < 1e-9, "{camera:?}");
}

#[test]
fn what_is_wrong_is_named_with_its_entry() {
    let message = |change: &dyn Fn(&mut Value)| {
        let mut document = document(&Matrix4::identity());
        change(&mut document);
        parse(&document).unwrap_err().to_string()
    };
    insta::assert_snapshot!(message(&|d| d["frames"] = json!(3)), @"transforms.json: frames: found 3, expected a list");
    insta::assert_snapshot!(message(&|d| d["frames"][0]["file_path"] = json!(null)), @r#"transforms.json: frames[0]: there is no "file_path""#);
    insta::assert_snapshot!(message(&|d| d["frames"][0]["transform_matrix"][1][2] = json!("x")), @r#"transforms.json: frames[0].transform_matrix[1][2]: found the text "x", expected a number"#);
    insta::assert_snapshot!(message(&|d| d["frames"][0]["transform_matrix"][0][0] = json!(2)), @"transforms.json: frames[0].transform_matrix: the 3x3 part of it is not a rotation (|R R^T - I| is 3.000e0, at most 1e-3 is accepted)");
    insta::assert_snapshot!(message(&|d| d["fl_x"] = json!(-1)), @"transforms.json: frames[0]: focal lengths are (-1, 610); expected two positive numbers (the intrinsics are singular)");
    insta::assert_snapshot!(message(&|d| d["k4"] = json!(0.1)), @"transforms.json: frames[0]: k4 is 0.1: a perspective camera with four radial coefficients is not supported");
    insta::assert_snapshot!(message(&|d| d["camera_model"] = json!("ORTHOPHOTO")), @r#"transforms.json: frames[0]: the camera model "ORTHOPHOTO" is not supported; expected OPENCV, OPENCV_FISHEYE, PINHOLE or EQUIRECTANGULAR"#);
    insta::assert_snapshot!(message(&|d| { d["fl_x"].take(); d["fl_y"].take(); }), @r#"transforms.json: frames[0]: there is no focal length: expected "fl_x" or "camera_angle_x""#);
    insta::assert_snapshot!(message(&|d| d["applied_transform"] = json!([[1, 0, 0, 0]])), @"transforms.json: applied_transform: found a list of 1, expected three or four rows of four numbers");
    let twice = |d: &mut Value| {
        let frame = d["frames"][0].clone();
        d["frames"] = json!([frame, frame]);
    };
    insta::assert_snapshot!(message(&twice), @r#"transforms.json: the scene made of this file is not valid: frames[1]: the frame id "./images/frame_00001.png" is used twice"#);
}

#[test]
fn test_frames_are_frames() {
    let mut document = document(&saved_by_nerfstudio(&colmap_pose()));
    let mut frame = document["frames"][0].clone();
    frame["file_path"] = "./images/frame_00002.png".into();
    document["test_frames"] = json!([frame]);
    let import = parse(&document).unwrap();
    let ids: Vec<&str> = import.scene.frames.iter().map(|frame| frame.id.as_str()).collect();
    assert_eq!(ids, ["./images/frame_00001.png", "./images/frame_00002.png"]);
    assert!(import.notes.contains(&"1 frame of test_frames were read, too".to_owned()), "{:?}", import.notes);
}

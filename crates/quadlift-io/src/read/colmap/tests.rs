use std::path::Path;

use nalgebra::{Point3, Vector2, Vector4};
use quadlift::geometry::{Camera, CameraModel};
use serde_json::Value;

use super::*;
use std::path::PathBuf;

/// The file of the points of a model without points.
fn no_points() -> File<'static> {
    (Path::new("points3D"), b"")
}

/// A model with every camera model, written by pycolmap.
fn fixture(form: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap").join(form)
}

#[test]
fn every_camera_model_projects_as_in_pycolmap() {
    let expected: Value = serde_json::from_slice(&std::fs::read(fixture("expected.json")).unwrap()).unwrap();
    let list = |value: &Value| -> Vec<f64> { value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect() };
    for form in ["text", "binary"] {
        let scene = read_colmap(&fixture(form), DEFAULT_POINTS).unwrap().scene;
        assert_eq!((scene.cameras.len(), scene.frames.len()), (18, 18));
        let mut largest: f64 = 0.0;
        for view in expected["views"].as_array().unwrap() {
            let frame = scene.frames.iter().find(|frame| frame.id == view["image"].as_str().unwrap()).unwrap();
            let record = scene.cameras.iter().find(|camera| Some(&camera.id) == frame.camera.as_ref()).unwrap();
            assert_eq!(record.model, view["model"].as_str().unwrap());
            let camera = Camera::new(CameraModel::from_name(&record.model).unwrap(), &record.params).unwrap();
            let pose = super::super::poses::from_rows(&frame.cam_from_world.unwrap());
            for (point, pixel) in expected["points"].as_array().unwrap().iter().zip(view["pixels"].as_array().unwrap())
            {
                let (point, pixel) = (list(point), list(pixel));
                let in_camera = (pose * Vector4::new(point[0], point[1], point[2], 1.0)).xyz();
                let found = camera.project_point(&Point3::from(in_camera)).unwrap();
                let error = (found - Vector2::new(pixel[0], pixel[1])).norm();
                assert!(error < 1e-6, "{}: {found} {pixel:?}", record.model);
                largest = largest.max(error);
                // And back: the pinhole camera of the scene sees the point where the pixel is undistorted to.
                let k = camera.pinhole();
                let ideal =
                    Vector2::new(k.fx * in_camera.x / in_camera.z + k.cx, k.fy * in_camera.y / in_camera.z + k.cy);
                assert!((camera.undistort_point(&found).unwrap() - ideal).norm() < 1e-6, "{}", record.model);
            }
        }
        println!("{form}: largest difference {largest:.1e} px");
    }
}

#[test]
fn text_and_binary_say_the_same() {
    let (text, binary) = (
        read_colmap(&fixture("text"), DEFAULT_POINTS).unwrap(),
        read_colmap(&fixture("binary"), DEFAULT_POINTS).unwrap(),
    );
    assert_eq!(text.scene.cameras, binary.scene.cameras);
    for (a, b) in text.scene.frames.iter().zip(&binary.scene.frames) {
        assert_eq!((&a.id, &a.camera, &a.image), (&b.id, &b.camera, &b.image));
        let (p, q) = (a.cam_from_world.unwrap(), b.cam_from_world.unwrap());
        assert!(p.iter().flatten().zip(q.iter().flatten()).all(|(x, y)| (x - y).abs() < 1e-14));
    }
    assert!(text.scene.frames.is_sorted_by_key(|frame| &frame.id));
}

#[test]
fn the_binary_form_is_preferred_and_the_usual_folders_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(folder.path().join("images")).unwrap();
    for (form, extension) in [("text", "txt"), ("binary", "bin")] {
        for name in ["cameras", "images"] {
            let file = format!("{name}.{extension}");
            std::fs::copy(fixture(form).join(&file), model.join(&file)).unwrap();
        }
        let import = read_colmap(folder.path(), DEFAULT_POINTS).unwrap();
        assert!(import.notes[0].contains(form), "{:?}", import.notes);
        assert!(import.image_folder.unwrap().ends_with("images"));
    }
    assert!(read_colmap(Path::new("nowhere"), 0).unwrap_err().problem.contains("cameras.bin"));
}

/// The mapper writes a model for each part that it cannot join: the first need not be the one that matters.
#[test]
fn of_several_models_the_largest_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let make = |place: &str, images: usize| {
        let model = folder.path().join(place);
        std::fs::create_dir_all(&model).unwrap();
        std::fs::write(model.join("cameras.txt"), "1 PINHOLE 640 480 500 500 320 240\n").unwrap();
        let lines: String = (0..images).map(|k| format!("{k} 1 0 0 0 {k} 2 3 1 {k}.png\n\n")).collect();
        std::fs::write(model.join("images.txt"), lines).unwrap();
    };
    for (place, images) in [("sparse/0", 2), ("sparse/10", 5), ("sparse/2", 5), ("sparse/x", 9)] {
        make(place, images);
    }
    let import = read_colmap(folder.path(), 0).unwrap();
    let place = |name: &str| Path::new("sparse").join(name).display().to_string();
    let [first, second, third] = ["0", "2", "10"].map(place);
    assert_eq!(import.scene.frames.len(), 5);
    assert_eq!(
        import.notes.last().unwrap(),
        &format!(
            "the folder has 3 models: {first} (2 images), {second} (5 images), {third} (5 images); {second} was read"
        )
    );
    // A model that is named is read, whatever lies beside it.
    assert_eq!(read_colmap(&folder.path().join("sparse/0"), 0).unwrap().scene.frames.len(), 2);
}

#[test]
fn lines_of_images_without_points_may_be_missing() {
    let cameras = b"1 PINHOLE 640 480 500 500 320 240\n";
    let image = |n: u32| format!("{n} 1 0 0 0 {n} 2 3 1 {n}.png\n");
    let read = |images: &str| {
        let files =
            [(Path::new("cameras.txt"), &cameras[..]), (Path::new("images.txt"), images.as_bytes()), no_points()];
        parse_text(files, None, 0).map(|import| import.scene.frames.len())
    };
    let points = "1.5 2.5 -1 3.5 4.5 7\n";
    let whole = "100 200 -1 100 200 8 100 200 9 100 200 3\n";
    for between in ["", "\n", points, whole, "# a comment\n", "\n\n"] {
        let images: String = (1..5).map(|n| image(n) + between).collect();
        assert_eq!(read(&images), Ok(4), "{between:?}");
    }
    assert_eq!(read(&(image(1) + &image(2) + points + &image(3) + "\n" + &image(4))), Ok(4));
    for wrong in ["1.5 2.5\n", "1.5 2.5 x\n", "1 2 0 0 0 1 2 3\n"] {
        let error = read(&(image(1) + wrong + &image(2))).unwrap_err();
        assert_eq!(error.line, Some(2), "{error}");
        assert!(error.problem.contains("expected the points of the image before"), "{error}");
    }
    assert_eq!(read(&(image(1) + points + points)).unwrap_err().line, Some(3));
}

/// The message for texts of the two files.
fn message(cameras: &str, images: &str) -> String {
    let files =
        [(Path::new("cameras.txt"), cameras.as_bytes()), (Path::new("images.txt"), images.as_bytes()), no_points()];
    parse_text(files, None, 0).unwrap_err().to_string()
}

#[test]
fn what_is_wrong_in_text_is_named_with_its_line() {
    let cameras = "# c\n1 PINHOLE 640 480 500 500 320 240\n";
    let image = "1 1 0 0 0 0 0 2 1 a.png\n\n";
    let files = [(Path::new("c"), cameras.as_bytes()), (Path::new("i"), image.as_bytes()), no_points()];
    let fine = parse_text(files, None, 0).unwrap();
    assert_eq!(fine.scene.frames[0].cam_from_world.unwrap()[2], [0.0, 0.0, 1.0, 2.0]);
    insta::assert_snapshot!(message("1 PINHOL 640 480", image), @r#"cameras.txt:1: found the camera model "PINHOL"; known are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE, RAD_TAN_THIN_PRISM_FISHEYE, SIMPLE_DIVISION, DIVISION, SIMPLE_FISHEYE, FISHEYE, EUCM, EQUIRECTANGULAR"#);
    insta::assert_snapshot!(message("1 PINHOLE 640 480 500 500 320", image), @"cameras.txt:1: the line ends after 7 fields; expected cy of a PINHOLE camera");
    insta::assert_snapshot!(message("1 PINHOLE 640 480 500 500 320 240 1", image), @"cameras.txt:1: a PINHOLE camera has 4 parameters; found more: 1");
    insta::assert_snapshot!(message("1 PINHOLE 640 480 -500 500 320 240", image), @"cameras.txt:1: camera 1: focal lengths are (-500, 500); expected two positive numbers (the intrinsics are singular)");
    insta::assert_snapshot!(message(&cameras.repeat(2), image), @"cameras.txt:4: the camera id 1 is used twice");
    insta::assert_snapshot!(message(cameras, "1 1 0 0 zero 0 0 2 1 a.png\n\n"), @r#"images.txt:1: field 5 is "zero"; expected a quaternion QW QX QY QZ"#);
    insta::assert_snapshot!(message(cameras, "1 0 0 0 0 0 0 2 1 a.png\n\n"), @r#"images.txt:1: image "a.png" has the quaternion [0.0, 0.0, 0.0, 0.0], which is not a rotation"#);
    insta::assert_snapshot!(message(cameras, "1 1 0 0 0 0 0 2 7 a.png\n\n"), @r#"images.txt:1: image "a.png" has the camera 7, which is not in the file of the cameras"#);
    insta::assert_snapshot!(message(cameras, &image.repeat(2)), @r#"images.txt:3: the image name "a.png" is used twice"#);
}

#[test]
fn what_is_wrong_in_bytes_is_named_with_its_place() {
    let read = |name: &str| std::fs::read(fixture("binary").join(name)).unwrap();
    let (cameras, images) = (read("cameras.bin"), read("images.bin"));
    let paths = (Path::new("cameras.bin"), Path::new("images.bin"));
    let parse =
        |cameras: &[u8], images: &[u8]| parse_binary([(paths.0, cameras), (paths.1, images), no_points()], None, 0);
    let message = |cameras: &[u8], images: &[u8]| parse(cameras, images).unwrap_err().to_string();
    insta::assert_snapshot!(message(&cameras[..4], &images), @"cameras.bin: byte 0: the file ends 4 bytes after this; expected the number of cameras, 8 bytes");
    insta::assert_snapshot!(message(&cameras[..100], &images), @"cameras.bin: byte 96: the file ends 4 bytes after this; expected cx, 8 bytes");
    insta::assert_snapshot!(message(&[cameras.as_slice(), b"xyz"].concat(), &images), @"cameras.bin: byte 1320: expected the end of the file; found 3 more bytes");
    let mut wrong = cameras.clone();
    wrong[12] = 99;
    insta::assert_snapshot!(message(&wrong, &images), @"cameras.bin: byte 16: the camera model before this has the number 99; expected 0 to 17");
    // Counts that nothing can hold.
    let mut wrong = images.clone();
    wrong[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    insta::assert_snapshot!(message(&cameras, &wrong), @"images.bin: byte 2987: the file ends 0 bytes after this; expected an image id, 4 bytes");
    let name_end = images.iter().skip(80).position(|&b| b == 0).unwrap() + 80;
    let mut wrong = images.clone();
    wrong[name_end + 1..name_end + 9].copy_from_slice(&u64::MAX.to_le_bytes());
    insta::assert_snapshot!(message(&cameras, &wrong), @"images.bin: byte 107: expected 18446744073709551615 points of 24 bytes; the file has 2880 more bytes");
    for length in 0..images.len() {
        assert!(parse(&cameras, &images[..length]).is_err());
    }
}

/// `points3D` as COLMAP writes it: text with a header, and the points in no order.
const POINTS: &str = "\
# 3D point list with one line of data per point:
#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)
# Number of points: 3, mean track length: 2.667
7 1.25 -0.5 3 120 100 80 0.75 1 0 2 4
2 0.12345678901234567 0.25 2 10 20 30 0.5 1 3 2 5 3 6
4 1 1 1 0 0 0 1.5 1 9 3 2 4 4
";

#[test]
fn points_of_a_model_are_kept_and_told() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["cameras.txt", "images.txt"] {
        std::fs::copy(fixture("text").join(name), folder.path().join(name)).unwrap();
    }
    let read = |most| read_colmap(folder.path(), most);
    assert_eq!(read(5).unwrap().scene.points, Vec::<[f64; 3]>::new());
    std::fs::write(folder.path().join("points3D.txt"), POINTS).unwrap();
    let all = read(DEFAULT_POINTS).unwrap();
    // In the order of their ids; the model is about a unit wide.
    assert_eq!(all.scene.points, [[0.123457, 0.25, 2.0], [1.0, 1.0, 1.0], [1.25, -0.5, 3.0]]);
    let told = |import: &Import| import.notes.iter().find(|note| note.contains("sparse point")).unwrap().clone();
    assert_eq!(told(&all), "3 sparse points of the model");
    // By the ids of the images, which are no places in the list: frames are sorted by their names.
    let of_image = |import: &Import, id: usize| {
        let name = &import.scene.cameras[id - 1].model.to_lowercase();
        let frame = import.scene.frames.iter().find(|frame| frame.id == format!("views/{name} {id}.png")).unwrap();
        frame.observed_points.clone().unwrap_or_default().to_vec()
    };
    let expected = [vec![0, 1, 2], vec![0, 2], vec![0, 1], vec![1], vec![], vec![]];
    for (k, points) in expected.iter().enumerate() {
        assert_eq!(of_image(&all, k + 1), *points, "image {}", k + 1);
    }
    let one = read(1).unwrap();
    assert_eq!((one.scene.points.len(), told(&one).as_str()), (1, "1 of 3 sparse points, evenly spread"));
    // The same points in binary, in another order.
    let mut bytes = 3u64.to_le_bytes().to_vec();
    for (id, position, error, track) in [
        (4u64, [1.0, 1.0, 1.0], 1.5, vec![1u32, 3, 4]),
        (7, [1.25, -0.5, 3.0], 0.75, vec![2, 1]),
        (2, [0.12345678901234567, 0.25, 2.0], 0.5, vec![1, 2, 3, 99, 3]),
    ] {
        bytes.extend(id.to_le_bytes());
        position.iter().for_each(|x: &f64| bytes.extend(x.to_le_bytes()));
        bytes.extend([1, 2, 3]);
        bytes.extend(f64::to_le_bytes(error));
        bytes.extend((track.len() as u64).to_le_bytes());
        track.iter().for_each(|image| bytes.extend([image.to_le_bytes(), [7; 4]].concat()));
    }
    let files = ["cameras.bin", "images.bin"].map(|name| std::fs::read(fixture("binary").join(name)).unwrap());
    let path = Path::new("a.bin");
    let binary = parse_binary([(path, &files[0]), (path, &files[1]), (path, &bytes)], None, DEFAULT_POINTS).unwrap();
    assert_eq!(binary.scene.points, all.scene.points);
    for (k, points) in expected.iter().enumerate() {
        assert_eq!(of_image(&binary, k + 1), *points, "image {}", k + 1);
    }
    // Wrong points are an error, unless none are asked for.
    std::fs::write(folder.path().join("points3D.txt"), "1 2 3\n").unwrap();
    assert_eq!(read(0).unwrap().scene.points, Vec::<[f64; 3]>::new());
    let error = read(1).unwrap_err().to_string();
    assert!(error.ends_with("points3D.txt:1: the line ends after 3 fields; expected a position X Y Z"), "{error}");
}

/// Two images of one camera, with points whose order in the lists of the images is not that of the tracks; the second image sees the
/// point 8 twice.
const TWO_IMAGES: [&str; 3] = [
    "1 PINHOLE 640 480 500 500 320 240\n",
    "1 1 0 0 0 0 0 0 1 a.png\n10.5 20.25 -1 100.123 200.987 8 300 40 3\n2 1 0 0 0 -1 0 0 1 b.png\n1 2 3 5.5 6.5 8 7 8 -1 9 9 8\n",
    "8 0.5 1 5 0 0 0 0.3 2 1 1 1 2 3\n3 1 0 6 0 0 0 0.4 1 2 2 0\n",
];

/// The same in binary.
fn two_images_binary() -> [Vec<u8>; 3] {
    let number = |x: f64| x.to_le_bytes().to_vec();
    let mut cameras = [1u64.to_le_bytes().as_slice(), &1u32.to_le_bytes(), &1u32.to_le_bytes()].concat();
    cameras.extend([640u64.to_le_bytes(), 480u64.to_le_bytes()].concat());
    [500.0, 500.0, 320.0, 240.0].iter().for_each(|x| cameras.extend(number(*x)));
    let mut images = 2u64.to_le_bytes().to_vec();
    let seen: [&[(f64, f64, i64)]; 2] = [
        &[(10.5, 20.25, -1), (100.123, 200.987, 8), (300.0, 40.0, 3)],
        &[(1.0, 2.0, 3), (5.5, 6.5, 8), (7.0, 8.0, -1), (9.0, 9.0, 8)],
    ];
    for (k, (name, seen)) in ["a.png", "b.png"].iter().zip(seen).enumerate() {
        images.extend((k as u32 + 1).to_le_bytes());
        [1.0, 0.0, 0.0, 0.0, -(k as f64), 0.0, 0.0].iter().for_each(|x| images.extend(number(*x)));
        images.extend(1u32.to_le_bytes());
        images.extend([name.as_bytes(), &[0]].concat());
        images.extend((seen.len() as u64).to_le_bytes());
        seen.iter().for_each(|(x, y, id)| images.extend([number(*x), number(*y), id.to_le_bytes().to_vec()].concat()));
    }
    let mut points = 2u64.to_le_bytes().to_vec();
    let tracks =
        [(8u64, [0.5f64, 1.0, 5.0], vec![(2u32, 1u32), (1, 1), (2, 3)]), (3, [1.0, 0.0, 6.0], vec![(1, 2), (2, 0)])];
    for (id, position, track) in tracks {
        points.extend(id.to_le_bytes());
        position.iter().for_each(|x| points.extend(number(*x)));
        points.extend([0, 0, 0]);
        points.extend(number(0.3));
        points.extend((track.len() as u64).to_le_bytes());
        track.iter().for_each(|(image, place)| points.extend([image.to_le_bytes(), place.to_le_bytes()].concat()));
    }
    [cameras, images, points]
}

#[test]
fn frames_have_the_pixels_of_their_points() {
    let text = |files: [&str; 3], most| {
        parse_text(files.map(|file| (Path::new("a.txt"), file.as_bytes())), None, most).unwrap()
    };
    let seen = |import: &Import| {
        let of = |frame: &FrameRecord| {
            (frame.observed_points.clone().unwrap().to_vec(), frame.observed_pixels.clone().unwrap().to_vec())
        };
        import.scene.frames.iter().map(of).collect::<Vec<_>>()
    };
    // In the order of the ids of the points: 3, 8. A point that was seen twice has its first pixel.
    let expected =
        vec![(vec![0, 1], vec![[300.0, 40.0], [100.12, 200.99]]), (vec![0, 1], vec![[1.0, 2.0], [5.5, 6.5]])];
    let found = text(TWO_IMAGES, 10);
    assert_eq!(seen(&found), expected);
    assert!(found.notes.contains(&"frames have the points that were observed in them, with their pixels".to_owned()));
    let binary = two_images_binary();
    let path = Path::new("a.bin");
    let binary = parse_binary([0, 1, 2].map(|k| (path, binary[k].as_slice())), None, 10).unwrap();
    assert_eq!(seen(&binary), expected);
    // Only those of the points that are kept.
    assert_eq!(seen(&text(TWO_IMAGES, 1))[0], (vec![0], vec![[100.12, 200.99]]));
    // The scene has them as tracks.
    let scene = found.scene.to_scene().unwrap();
    assert_eq!(scene.points.len(), 2);
    assert_eq!(scene.points[1].position, Point3::new(0.5, 1.0, 5.0));
    let pixels: Vec<(u32, Vector2<f64>)> =
        scene.points[1].observations.iter().map(|seen| (seen.frame_index, seen.pixel)).collect();
    assert_eq!(pixels, [(0, Vector2::new(100.12, 200.99)), (1, Vector2::new(5.5, 6.5))]);
}

#[test]
fn pixels_of_other_points_are_not_used() {
    let parse = |images: &str, points: &str| {
        let files = [TWO_IMAGES[0], images, points];
        parse_text(files.map(|file| (Path::new("a.txt"), file.as_bytes())), None, 10)
    };
    let note = "the pixels of 1 image were not used: their points are not those of the tracks".to_owned();
    for (images, points) in [
        // Another point is at the place, or none.
        (TWO_IMAGES[1].replace("300 40 3", "300 40 4"), TWO_IMAGES[2].to_owned()),
        (TWO_IMAGES[1].to_owned(), TWO_IMAGES[2].replace("1 2 2 0", "1 7 2 0")),
    ] {
        let found = parse(&images, &points).unwrap();
        let pixels: Vec<bool> = found.scene.frames.iter().map(|frame| frame.observed_pixels.is_some()).collect();
        assert_eq!(pixels, [false, true]);
        assert!(found.scene.frames.iter().all(|frame| frame.observed_points.is_some()));
        assert!(found.notes.contains(&note), "{:?}", found.notes);
    }
    // Programs that keep no pixels write an empty line.
    let found = parse("1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -1 0 0 1 b.png\n\n", TWO_IMAGES[2]).unwrap();
    assert!(found.scene.frames.iter().all(|frame| frame.observed_pixels.is_none()));
    assert!(found.notes.contains(&"frames have the points that were observed in them".to_owned()));
    let error = parse(&TWO_IMAGES[1].replace("300 40 3", "300 x 3"), TWO_IMAGES[2]).unwrap_err();
    assert_eq!(error.to_string(), "a.txt:2: found \"x\"; expected a pixel X Y of point 2");
}

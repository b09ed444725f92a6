//! Bad inputs: each one has a message, a non-zero exit code and leaves nothing half-written.
//!
//! `snapshots/bad_inputs.txt` is written from this list, and `docs/troubleshooting.md` shows some of its rows. With
//! QUADLIFT_UPDATE_DOCS=1 the test rewrites it.

use std::fmt::Write;
use std::path::Path;

use crate::common::{Folder, Run};
use serde_json::{Value, json};

/// A bad input.
struct Case {
    /// What is wrong.
    title: &'static str,
    /// Arguments of the program, separated by blanks.
    arguments: &'static str,
    /// Exit code.
    code: i32,
    /// Makes the files.
    make: Box<dyn Fn(&Folder)>,
}

impl Case {
    fn with(self, arguments: &'static str) -> Self {
        Self { arguments, ..self }
    }
}

const LOCALIZE: &str = "localize scene.json -o out.json";

/// A case whose scene is a good one after a change.
fn changed(title: &'static str, change: impl Fn(&mut Value) + 'static) -> Case {
    let make = move |folder: &Folder| {
        let mut scene = folder.small_scene();
        change(&mut scene);
        folder.write_json("scene.json", &scene);
    };
    Case { title, arguments: LOCALIZE, code: 1, make: Box::new(make) }
}

/// A case whose scene is this text.
fn text(title: &'static str, content: impl AsRef<[u8]> + 'static) -> Case {
    let make = move |folder: &Folder| folder.write("scene.json", &content);
    Case { title, arguments: LOCALIZE, code: 1, make: Box::new(make) }
}

/// A case with a good scene and other arguments.
fn called(title: &'static str, code: i32, arguments: &'static str) -> Case {
    Case { arguments, code, ..changed(title, |_| {}) }
}

/// A folder of the tutorial's data.
fn tutorial(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/data/tutorial-colmap-yolo").join(name)
}

/// A case that ends with exit code 3: the scene is inconsistent.
fn code_3(case: Case) -> Case {
    Case { code: 3, ..case }
}

/// A good scene, as text, after a change of the text.
fn replaced(title: &'static str, from: &'static str, to: &'static str) -> Case {
    let make = move |folder: &Folder| {
        let text = serde_json::to_string_pretty(&folder.small_scene()).unwrap();
        assert!(text.contains(from));
        folder.write("scene.json", text.replacen(from, to, 1));
    };
    Case { title, arguments: LOCALIZE, code: 1, make: Box::new(make) }
}

fn files() -> Vec<Case> {
    let mut truncated = changed("a file that is cut off", |_| {});
    truncated.make = Box::new(|folder| {
        let text = folder.small_scene().to_string();
        folder.write("scene.json", &text[..text.len() / 2]);
    });
    let header = "{\"format\": \"quadlift.scene\", \"version\": 1";
    vec![
        Case { arguments: "localize no.json -o out.json", ..text("a file that does not exist", "") },
        text("an empty file", ""),
        text("a file that is no text", b"\x89PNG\r\n\x1a\n\xff\xd8"),
        text("text that is no JSON object", "frame,x0,y0,x1,y1\n"),
        truncated,
        text("invalid JSON", format!("{header},\n \"frames\": [{{\"id\": \"a\"}},]}}")),
        text("deep nesting", format!("{header}, \"mine\": {}{}}}", "[".repeat(100_000), "]".repeat(100_000))),
        changed("no \"format\"", |scene| drop(scene.as_object_mut().unwrap().remove("format"))),
        changed("another format", |scene| scene["format"] = json!("coco")),
        changed("another version", |scene| scene["version"] = json!(2)),
    ]
}

fn entries() -> Vec<Case> {
    let pose = "cam_from_world";
    vec![
        changed("a list where a record is expected", |scene| scene["frames"][2] = json!([])),
        changed("a frame id that is used twice", |scene| scene["frames"][1]["id"] = json!("000000")),
        changed("an unknown frame", |scene| scene["detections"][3]["frame"] = json!("00003")),
        changed("an unknown camera", |scene| scene["frames"][0]["camera"] = json!("Camera")),
        changed("an unknown camera model", |scene| scene["cameras"][0]["model"] = json!("PINHOL")),
        changed("a camera model with too few parameters", |scene| scene["cameras"][0]["model"] = json!("OPENCV")),
        changed("a camera without all parameters", |scene| scene["cameras"][0]["params"] = json!([500, 320, 240])),
        changed("singular intrinsics", |scene| scene["cameras"][0]["params"][1] = json!(0)),
        changed("an image size of zero", |scene| scene["cameras"][0]["width"] = json!(0)),
        changed("a pose that is not a rotation", move |scene| scene["frames"][0][pose][0][0] = json!(2)),
        changed("a mirrored pose", move |scene| {
            scene["frames"][0][pose] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 5]]);
        }),
        changed("a pose without three rows", move |scene| scene["frames"][0][pose] = json!([[1, 0, 0, 0]])),
        changed("a frame with neither pose nor projection", move |scene| {
            drop(scene["frames"][0].as_object_mut().unwrap().remove(pose));
        }),
        changed("a singular projection", |scene| {
            scene["frames"][0] = json!({"id": "000000", "projection": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]});
        }),
        changed("\"up\" without a direction", |scene| scene["up"] = json!([0, 0, 0])),
        changed("a box without four numbers", |scene| scene["detections"][2]["box"] = json!([10, 20, 30])),
        changed("a reversed box", |scene| scene["detections"][2]["box"] = json!([30, 20, 10, 40])),
        replaced("NaN", "\"box\": [", "\"box\": [NaN, "),
        replaced("a number that is too large", "\"box\": [", "\"box\": [1e999, "),
        changed("neither a box nor an ellipse", |scene| {
            drop(scene["detections"][2].as_object_mut().unwrap().remove("box"));
        }),
        changed("an ellipse without positive axes", |scene| {
            scene["detections"][2]["ellipse"] = json!({"center": [5, 5], "semi_axes": [3, 0], "angle": 0});
        }),
        changed("an outline of two points", |scene| scene["detections"][2]["outline"] = json!([[1, 2], [3, 4]])),
        changed("an oriented box without a width", |scene| {
            scene["detections"][2]["oriented_box"] = json!({"center": [9, 9], "size": [0, 4], "angle": 0.3});
        }),
        changed("a depth behind the camera", |scene| scene["detections"][2]["depth"] = json!({"median": -3})),
        changed("points in an unknown frame", |scene| {
            scene["frames"][0]["point_cloud"] = json!({"path": "a.bin", "frame": "lidar"});
        }),
        changed("an observed point that the scene does not have", |scene| {
            scene["points"] = json!([[0, 0, 1]]);
            scene["frames"][0]["observed_points"] = json!([0, 1]);
        }),
        changed("pixels of fewer points than were observed", |scene| {
            scene["points"] = json!([[0, 0, 1], [0, 1, 1]]);
            scene["frames"][0]["observed_points"] = json!([0, 1]);
            scene["frames"][0]["observed_pixels"] = json!([[10, 20]]);
        }),
        changed("a 3D box in an unknown frame", |scene| {
            scene["detections"][2]["box3d"] = json!({"center": [0, 0, 5], "frame": "lidar"});
        }),
        changed("a 3D box behind the camera", |scene| {
            scene["detections"][2]["box3d"] = json!({"center": [0, 0, -5], "half_extents": [2, 1, 1]});
        }),
        changed("a 3D box without anything", |scene| scene["detections"][2]["box3d"] = json!({"source": "a"})),
        changed("an object twice in one frame", |scene| {
            let again = scene["detections"][2].clone();
            scene["detections"].as_array_mut().unwrap().push(again);
        }),
        changed("an id that is a number", |scene| scene["detections"][2]["object"] = json!(7)),
    ]
}

/// Streams that cannot be opened or written. Bad lines are events: see `stream_hostile`.
fn streams() -> Vec<Case> {
    let lines = |title, content: &'static str, arguments| Case {
        title,
        arguments,
        code: 1,
        make: Box::new(move |folder| folder.write("state", content)),
    };
    vec![
        called("a stream that does not exist", 1, "stream no.jsonl"),
        called("a folder as a stream", 1, "stream ."),
        called("a map file in a folder that does not exist", 1, "stream scene.json --map no/out.json"),
        called("a map file in the place of the scene", 2, "stream scene.json --map scene.json"),
        called("a map file on standard output", 2, "stream scene.json --map -"),
        called("a map file and a state of the same name", 2, "stream scene.json --map out --state out"),
        called("--save-every without anything to write", 2, "stream scene.json --save-every 10"),
        called("--resume without a state", 2, "stream scene.json --resume"),
        called("--rerun with what is neither a recording nor an address", 2, "stream --rerun=scene.json"),
        called("--rerun and its value without =", 2, "stream --rerun out.rrd"),
        called("a recording of a stream in a folder that does not exist", 1, "stream scene.json --rerun=no/out.rrd"),
        called("an object that keeps too few views", 2, "stream scene.json --max-views 2"),
        called("built-in priors without meters", 1, "stream scene.json --priors builtin"),
        lines("a state that is no JSON", "{", "stream --state state --resume"),
        lines("a state that is none", "{}", "stream --state state --resume"),
        lines(
            "a state of another version",
            "{\"format\": \"quadlift.stream_state\", \"version\": 7}",
            "stream --state state --resume",
        ),
    ]
}

/// Reports and pictures that cannot be made.
fn looks() -> Vec<Case> {
    vec![
        called("a report in a folder that does not exist", 1, "localize scene.json --report no/out.html"),
        called("a report in the place of the result", 2, "localize scene.json -o out.json --report out.json"),
        called("a page of a file that does not exist", 1, "view scene.json truth.json --no-browser"),
        changed("a result with a wrong body", |scene| {
            scene["objects"] = json!([{"id": "a", "status": "ok", "ellipsoid":
                {"center": [0, 0, 0], "semi_axes": [1, 0, 1], "rotation": [1, 0, 0, 0]}}]);
        })
        .with("view scene.json --no-browser"),
        called("a picture of an unknown frame", 1, "render scene.json --frame 17 -o out.png"),
        called("a picture of another format", 2, "render scene.json --frame 000000 -o out.pdf"),
        rendered(
            "a picture of an image that is none",
            1,
            "render scene.json --frame 000001 -o out.png",
            |_, folder| {
                folder.write("images/000001.png", "a cup on a table");
            },
        ),
    ]
}

/// Valid scenes in which no object can be localized: the message tells why.
fn hopeless() -> Vec<Case> {
    vec![
        changed("an empty scene", |scene| {
            scene["frames"] = json!([]);
            scene["detections"] = json!([]);
        }),
        Case {
            arguments: "localize scene.json -o out.json --associate never",
            ..changed("no detection has an object id", |scene| {
                for detection in scene["detections"].as_array_mut().unwrap() {
                    detection.as_object_mut().unwrap().remove("object");
                }
            })
        },
        changed("objects that are seen once", |scene| {
            scene["detections"].as_array_mut().unwrap().retain(|d| d["frame"] == "000002");
        }),
        changed("all views from one point", |scene| {
            let pose = scene["frames"][0]["cam_from_world"].clone();
            let first: Vec<Value> = scene["detections"].as_array().unwrap().clone();
            for frame in scene["frames"].as_array_mut().unwrap() {
                frame["cam_from_world"] = pose.clone();
            }
            for (index, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
                detection["box"] = first[index / 6 * 6]["box"].clone();
            }
        }),
        code_3(changed("objects behind the cameras", |scene| {
            // Turned by 180 degrees about the vertical axis of the image, with the boxes mirrored: the rays are those
            // of the good scene, backwards.
            for frame in scene["frames"].as_array_mut().unwrap() {
                for row in [0, 2] {
                    for column in 0..4 {
                        let x = frame["cam_from_world"][row][column].as_f64().unwrap();
                        frame["cam_from_world"][row][column] = json!(-x);
                    }
                }
            }
            for detection in scene["detections"].as_array_mut().unwrap() {
                let b: Vec<f64> = detection["box"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
                detection["box"] = json!([b[0], 960.0 - b[3], b[2], 960.0 - b[1]]);
            }
        })),
        called("fewer views than asked for", 1, "localize scene.json -o out.json --min-views 7"),
    ]
}

const SEGMENT: &str = "segment scene.json -o out.json";
const LOCALIZE_MASKS: &str = "localize scene.json -o out.json --measurement mask";
const MASKS: &str = "segment scene.json -o out.json --method masks";

/// A case with a rendered scene after a change of the scene file and of the folder.
fn rendered(
    title: &'static str,
    code: i32,
    arguments: &'static str,
    change: impl Fn(&mut Value, &Folder) + 'static,
) -> Case {
    let make = move |folder: &Folder| {
        folder.rendered_scene("scene.json", 3);
        let mut scene = folder.json("scene.json");
        change(&mut scene, folder);
        folder.write_json("scene.json", &scene);
    };
    Case { title, arguments, code, make: Box::new(make) }
}

fn without(entry: &mut Value, field: &str) {
    entry.as_object_mut().unwrap().remove(field).unwrap();
}

fn every(scene: &mut Value, list: &str, change: impl Fn(&mut Value)) {
    scene[list].as_array_mut().unwrap().iter_mut().for_each(change);
}

fn images() -> Vec<Case> {
    let image = "images/000001.png";
    let smaller = |folder: &Folder, name: &str| {
        image::GrayImage::new(80, 60).save(folder.path(&format!("{name}/000001.png"))).unwrap();
    };
    vec![
        rendered("an image that does not exist", 1, SEGMENT, move |_, folder| {
            std::fs::remove_file(folder.path(image)).unwrap();
        }),
        rendered("an image that is cut off", 1, SEGMENT, move |_, folder| {
            let bytes = std::fs::read(folder.path(image)).unwrap();
            folder.write(image, &bytes[..bytes.len() / 2]);
        }),
        rendered("an image that is none", 1, SEGMENT, move |_, folder| folder.write(image, "a cup on a table")),
        rendered("an image of another size than the camera's", 1, SEGMENT, move |_, folder| smaller(folder, "images")),
        rendered("a frame without an image", 1, SEGMENT, |scene, _| without(&mut scene["frames"][2], "image")),
        rendered("no image at all", 1, SEGMENT, |scene, _| every(scene, "frames", |frame| without(frame, "image"))),
        rendered("images that do not exist", 1, SEGMENT, |_, folder| {
            std::fs::remove_dir_all(folder.path("images")).unwrap();
        }),
        rendered("a box outside of the image", 1, SEGMENT, |scene, _| {
            scene["detections"][3]["box"] = json!([250, 20, 290, 60]);
        }),
        rendered("a box without a width", 1, SEGMENT, |scene, _| {
            scene["detections"][3]["box"] = json!([70, 20, 70.001, 60]);
        }),
        rendered("no box at all", 1, SEGMENT, |scene, _| {
            every(scene, "detections", |detection| {
                without(detection, "box");
                detection["ellipse"] = json!({"center": [80, 60], "semi_axes": [9, 5], "angle": 0});
            });
        }),
        rendered("masks for some frames only", 1, MASKS, |scene, _| {
            for index in [1, 4] {
                without(&mut scene["detections"][index], "mask");
            }
        }),
        rendered("no mask at all", 1, MASKS, |scene, _| every(scene, "detections", |d| without(d, "mask"))),
        rendered("a label image that does not exist", 1, MASKS, |_, folder| {
            std::fs::remove_file(folder.path("masks/000001.png")).unwrap();
        }),
        rendered("a mask of another size than the image", 1, MASKS, move |_, folder| smaller(folder, "masks")),
        rendered("a value that no pixel has", 1, MASKS, |scene, _| scene["detections"][3]["mask"]["value"] = json!(9)),
        rendered("an empty mask", 1, MASKS, |scene, _| {
            scene["detections"][3]["mask"] = json!({"rle": {"size": [180, 240], "counts": [43200]}});
        }),
        rendered("runs that do not fill their image", 1, MASKS, |scene, _| {
            scene["detections"][3]["mask"] = json!({"rle": {"size": [180, 240], "counts": [100, 20]}});
        }),
        rendered("a mask in two forms", 1, MASKS, |scene, _| {
            scene["detections"][3]["mask"]["polygons"] = json!([[0, 0, 9, 0, 9, 9]]);
        }),
        rendered("a mask of a single pixel", 1, MASKS, |scene, _| {
            scene["detections"][3]["mask"] = json!({"rle": {"size": [180, 240], "counts": [100, 1, 43099]}});
        }),
        rendered("masks as measurements where there are none", 1, LOCALIZE_MASKS, |scene, _| {
            every(scene, "detections", |d| without(d, "mask"));
        }),
        rendered("masks as measurements, one of them missing", 1, LOCALIZE_MASKS, |_, folder| {
            std::fs::remove_file(folder.path("masks/000001.png")).unwrap();
        }),
        called("masks for a closed form of ellipses", 2, "localize scene.json --measurement mask --method lfd"),
        rendered("an unknown method", 2, "segment scene.json -o out.json --method sam", |_, _| {}),
        rendered(
            "masks into the folder of the images",
            2,
            "segment scene.json -o out.json --out-masks images",
            |_, _| {},
        ),
        rendered(
            "masks and contact sheets in one folder",
            2,
            "segment scene.json -o out.json --out-masks new --contact-sheets new",
            |_, _| {},
        ),
        rendered("a segmentation in place of its scene", 2, "segment scene.json -o scene.json", |_, _| {}),
        called("an unknown key of --assume", 2, "localize scene.json --assume pose=opengl"),
        called("an unknown value of a key", 2, "localize scene.json --assume boxes=xyhw"),
        called("a key twice", 2, "localize scene.json --assume boxes=xywh,boxes=yxyx"),
        called("a key of a scene", 2, "import mot mot.txt --into scene.json -o out.json --assume poses=opengl"),
    ]
}

/// Detections of other programs, for a good scene without detections whose frames are 000000 to 000005.
fn detections() -> Vec<Case> {
    let file = |title, arguments, name: &'static str, content: &'static str| Case {
        make: Box::new(move |folder: &Folder| {
            let mut scene = folder.small_scene();
            drop(scene.as_object_mut().unwrap().remove("detections"));
            folder.write_json("scene.json", &scene);
            folder.write(name, content);
        }),
        ..called(title, 1, arguments)
    };
    const COCO: &str = "import coco coco.json --into scene.json -o out.json";
    const MOT: &str = "import mot mot.txt --into scene.json -o out.json";
    const YOLO: &str = "import yolo labels --into scene.json -o out.json";
    const CSV: &str = "import csv boxes.csv --into scene.json -o out.json";
    let label = "labels/000001.txt";
    let usage = |case: Case| Case { code: 2, ..case };
    vec![
        file("no image is a frame", CSV, "boxes.csv", "image,x0,y0,x1,y1\na.png,1,2,3,4\nb.png,1,2,3,4\n"),
        file("image numbers with two readings", MOT, "mot.txt", "11,1,10,20,30,40\n").with_ids_from_ten(),
        file("a track twice in one image", CSV, "boxes.csv", "frame,x0,y0,x1,y1,track\n0,1,2,3,4,7\n0,2,2,3,4,7\n"),
        file(
            "images of another size",
            COCO,
            "coco.json",
            r#"{"images": [{"id": 1, "file_name": "000000.png", "width": 32, "height": 32}], "annotations": [{"image_id": 1, "bbox": [1, 2, 3, 4]}]}"#,
        ),
        file(
            "an annotation of an unknown image",
            COCO,
            "coco.json",
            r#"{"images": [], "annotations": [{"image_id": 1, "bbox": [1, 2, 3, 4]}]}"#,
        ),
        file(
            "runs that do not fill the image",
            COCO,
            "coco.json",
            r#"[{"image_id": 1, "segmentation": {"size": [9, 9], "counts": "04"}}]"#,
        ),
        file(
            "a box of edges where a size is expected",
            COCO,
            "coco.json",
            r#"[{"image_id": 1, "bbox": [30, 20, -10, 4]}]"#,
        ),
        file("a reversed box", CSV, "boxes.csv", "0,30,20,10,40\n"),
        file("no column for the image", CSV, "boxes.csv", "x0,y0,x1,y1\n1,2,3,4\n"),
        file("columns without names", CSV, "boxes.csv", "1,2,3,4,5,6,7\n"),
        file("too few columns of MOTChallenge", MOT, "mot.txt", "1,2,3\n"),
        file("pixels in a YOLO file", YOLO, label, "0 345.2 120 20 20\n"),
        file("a score or a track id", YOLO, label, "0 0.5 0.5 0.2 0.2 1\n"),
        file("a folder without label files", YOLO, "labels/a.md", ""),
        file(
            "names that are not in the YAML file",
            "import yolo labels --into scene.json -o out.json --class-names data.yaml",
            "data.yaml",
            "nc: 2\n",
        ),
        file("a LabelMe file without shapes", "import labelme a.json --into scene.json -o out.json", "a.json", "{}"),
        file(
            "a Pascal VOC box without a corner",
            "import voc a.xml --into scene.json -o out.json",
            "a.xml",
            "<annotation>\n<object><name>cup</name><bndbox><xmin>5</xmin></bndbox></object></annotation>\n",
        ),
        Case {
            title: "a COLMAP image whose camera is not that of its rig",
            arguments: "import colmap . -o out.json",
            code: 1,
            make: Box::new(|folder| {
                folder.write("cameras.txt", "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 500 500 320 240\n");
                folder.write("images.txt", "1 1 0 0 0 0 0 2 2 a.png\n\n");
                folder.write("rigs.txt", "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 0 0 0\n");
                folder.write("frames.txt", "1 1 1 0 0 0 0 0 2 1 CAMERA 1 1\n");
            }),
        },
        file(
            "a shot of OpenSfM with an unknown camera",
            "import opensfm a.json -o out.json",
            "a.json",
            r#"[{"cameras": {}, "shots": {"a.jpg": {"rotation": [0, 0, 0], "translation": [0, 0, 0], "camera": "c"}}}]"#,
        ),
        Case {
            title: "a Polycam camera whose rotation is none",
            arguments: "import arkit capture -o out.json",
            code: 1,
            make: Box::new(|folder| {
                let path = folder.path("capture/keyframes/cameras");
                std::fs::create_dir_all(&path).unwrap();
                let text = r#"{"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": 2, "height": 2, "t_00": 1, "t_01": 1, "t_02": 0,
                    "t_03": 0, "t_10": 0, "t_11": 1, "t_12": 0, "t_13": 0, "t_20": 0, "t_21": 0, "t_22": 1, "t_23": 0}"#;
                std::fs::write(path.join("1.json"), text).unwrap();
            }),
        },
        Case {
            title: "a scene of nuScenes that does not exist",
            arguments: "import nuscenes . --sequence scene-0062 -o out.json",
            code: 1,
            make: Box::new(|folder| {
                for table in ["scene", "sample", "sensor", "calibrated_sensor", "sample_data", "ego_pose"] {
                    let rows = if table == "scene" { r#"[{"token": "s", "name": "scene-0061"}]"# } else { "[]" };
                    folder.write(&format!("{table}.json"), rows);
                }
            }),
        },
        file(
            "a CVAT box without a corner",
            "import cvat a.xml --into scene.json -o out.json",
            "a.xml",
            "<annotations>\n<image name=\"a\" width=\"4\" height=\"4\"><box label=\"cup\" xtl=\"5\"/></image></annotations>\n",
        ),
        file(
            "a CVAT file that defines entities",
            "import cvat a.xml --into scene.json -o out.json",
            "a.xml",
            "<!DOCTYPE annotations [<!ENTITY a \"aaaa\">]>\n<annotations>&a;</annotations>\n",
        ),
        file(
            "a task of Label Studio without an image",
            "import label-studio a.json --into scene.json -o out.json",
            "a.json",
            r#"[{"data": {"text": "hello"}, "annotations": []}]"#,
        ),
        file(
            "a KITTI label that is cut off",
            "import kitti-labels a.txt --into scene.json -o out.json",
            "a.txt",
            "0 1 Car 0 0\n",
        ),
        file(
            "cameras of no known format",
            "localize --cameras boxes.csv --detections boxes.csv -o out.json",
            "boxes.csv",
            "1,2,3\n",
        ),
        file(
            "detections of no known format",
            "localize --cameras scene.json --detections notes.txt -o out.json",
            "notes.txt",
            "hello\n",
        ),
        usage(file("cameras without detections", "localize --cameras scene.json -o out.json", "a.txt", "")),
        usage(
            file(
                "a trajectory without intrinsics",
                "localize --cameras tum.txt --detections boxes.csv",
                "tum.txt",
                "0 0 0 0 0 0 0 1\n",
            )
            .and("boxes.csv", "0,1,2,3,4\n"),
        ),
    ]
}

impl Case {
    /// The same with one more file.
    fn and(self, name: &'static str, content: &'static str) -> Self {
        let make = self.make;
        Self {
            make: Box::new(move |folder| {
                make(folder);
                folder.write(name, content);
            }),
            ..self
        }
    }

    /// The same with frames whose ids count from 10.
    fn with_ids_from_ten(self) -> Self {
        let make = self.make;
        Self {
            make: Box::new(move |folder| {
                make(folder);
                let mut scene = folder.json("scene.json");
                for (index, frame) in scene["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
                    frame["id"] = json!(format!("frame_{}", index + 10));
                }
                folder.write_json("scene.json", &scene);
            }),
            ..self
        }
    }
}

fn choices() -> Vec<Case> {
    let sources = |scene: &mut Value| {
        for (index, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
            detection["source"] = json!(if index % 2 == 0 { "yolo" } else { "label" });
        }
    };
    let unknown = Case {
        arguments: "localize scene.json -o out.json --source yolov8",
        ..changed("a source that does not exist", sources)
    };
    let priors = Case {
        make: Box::new(|folder| {
            folder.write_json("scene.json", &folder.small_scene());
            folder.write("priors.toml", "[car]\nsize = [4, 2]\nsize_sd = [1, 1, 1]\n");
        }),
        ..called("a wrong file of priors", 1, "localize scene.json -o out.json --priors priors.toml")
    };
    vec![
        changed("several sources and none chosen", sources),
        unknown,
        called("built-in priors without meters", 1, "localize scene.json -o out.json --priors builtin"),
        priors,
        called("a file of priors that does not exist", 1, "localize scene.json -o out.json --priors no.toml"),
        called("priors for a closed form", 2, "localize scene.json -o out.json --method lfd --priors builtin"),
        called("two sources of priors", 2, "localize scene.json -o out.json --priors builtin --priors a.toml"),
        called("learned sizes of a closed form", 2, "localize scene.json -o out.json --method lfd --learn-sizes"),
        called("a weight for another method", 2, "localize scene.json -o out.json --reg-weight 1"),
        called("a negative weight", 2, "localize scene.json -o out.json --method reg --reg-weight=-1"),
        called(
            "noise_model for another method",
            2,
            "localize scene.json -o out.json --method lfd --noise-model edge_noise=1",
        ),
        called("an unknown noise level", 2, "localize scene.json -o out.json --noise-model edges=0.1"),
        called("a noise level of zero", 2, "localize scene.json -o out.json --noise-model edge_noise=0"),
        called(
            "noise levels of a scene that is no result",
            1,
            "localize scene.json -o out.json --noise-model scene.json",
        ),
        called("a noise level twice", 2, "localize scene.json -o out.json --noise-model shape=0.1,shape=0.2"),
        called(
            "noise levels of a file that does not exist",
            2,
            "localize scene.json -o out.json --noise-model no.json",
        ),
        called("a cuboid from a closed form", 2, "localize scene.json -o out.json --method planes --body cuboid"),
        called("an unknown body", 2, "localize scene.json -o out.json --body sphere"),
        called("a kind that is not fitted", 2, "localize scene.json -o out.json --body superellipsoid:1.5"),
        called("an unknown noise", 2, "synth -o out.json --noise fog:1"),
        called("too many outliers", 2, "synth -o out.json --outliers 1.5"),
        called("ellipse noise on boxes", 2, "synth -o out.json --noise re:45"),
        called("an unknown path of the cameras", 2, "synth -o out.json --trajectory circle"),
        called("a share of misses above one", 2, "synth -o out.json --misses 1.5"),
        called("a negative number of false boxes", 2, "synth -o out.json --false-positives=-1"),
        called("no ids, and ids of a tracker", 2, "synth -o out.json --no-ids --fragments 0.1"),
        called("a truth in place of the scene", 2, "synth -o out.json --ground-truth out.json"),
        called("an unknown error of depths", 2, "synth -o out.json --cues depth --cue-noise fog:1"),
        called("a share of flipped 3D boxes above one", 2, "synth -o out.json --cues box3d --cue-noise flips:2"),
        called("errors of 3D boxes without 3D boxes", 2, "synth -o out.json --cues depth --cue-noise yaw:10"),
        called("ellipses of cuboids", 2, "synth -o out.json --body cuboid --measurement ellipses"),
    ]
}

/// Scenes whose detections name no object.
fn associations() -> Vec<Case> {
    const ASSOCIATE: &str = "associate scene.json -o out.json";
    let nameless = |title, arguments, change: fn(&mut Value)| Case {
        arguments,
        ..changed(title, move |scene| {
            for detection in scene["detections"].as_array_mut().unwrap() {
                detection.as_object_mut().unwrap().remove("object");
            }
            change(scene);
        })
    };
    let code_2 = |case: Case| Case { code: 2, ..case };
    vec![
        nameless("no detections to associate", ASSOCIATE, |scene| scene["detections"] = json!([])),
        nameless("all detections in one frame", ASSOCIATE, |scene| keep_frames(scene, &["000002"])),
        nameless("all detections in two frames", ASSOCIATE, |scene| keep_frames(scene, &["000002", "000004"])),
        nameless("the same in localize", LOCALIZE, |scene| keep_frames(scene, &["000002", "000004"])),
        code_3(nameless("cameras that see nothing in common", ASSOCIATE, |scene| {
            // Each looks another way from the same place.
            for (index, frame) in scene["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
                let (sin, cos) = (std::f64::consts::TAU * index as f64 / 6.0).sin_cos();
                frame["cam_from_world"] = json!([[cos, 0, -sin, 0], [0, 1, 0, 0], [sin, 0, cos, 0]]);
            }
        })),
        nameless("scores that are all too low", "associate scene.json -o out.json --min-score 0.5", |scene| {
            scene["detections"].as_array_mut().unwrap().iter_mut().for_each(|d| d["score"] = json!(0.1));
        }),
        nameless("a score that is no number", ASSOCIATE, |scene| scene["detections"][0]["score"] = json!("high")),
        nameless(
            "sizes in meters, a scene without a unit",
            "associate scene.json -o out.json --priors builtin",
            |_| {},
        ),
        nameless("an unknown source to associate", "associate scene.json -o out.json --source yolo", |_| {}),
        code_2(nameless("an overlap above one", "associate scene.json -o out.json --max-overlap 2", |_| {})),
        code_2(nameless("objects of one view", "associate scene.json -o out.json --min-views 1", |_| {})),
        code_2(nameless("an associated scene in place of the scene", "associate scene.json -o scene.json", |_| {})),
    ]
}

/// Leaves the detections in these frames.
fn keep_frames(scene: &mut Value, frames: &[&str]) {
    scene["detections"].as_array_mut().unwrap().retain(|d| frames.contains(&d["frame"].as_str().unwrap()));
}

fn paths() -> Vec<Case> {
    let folder = Case {
        make: Box::new(|folder| {
            folder.write_json("scene.json", &folder.small_scene());
            std::fs::create_dir(folder.path("results")).unwrap();
        }),
        ..called("an output that is a folder", 1, "localize scene.json -o results")
    };
    let twice = Case {
        make: Box::new(|folder| ["a/scene.json", "b/scene.json"].iter().for_each(|name| folder.write(name, "{}"))),
        ..called("two results of one name", 2, "localize a/scene.json b/scene.json -o results")
    };
    vec![
        called("an output in a folder that does not exist", 1, "localize scene.json -o no/out.json"),
        called("a result in another format", 2, "localize scene.json -o out.ply"),
        called("a page in place of the result", 2, "localize scene.json -o out.html"),
        called("an associated scene in another format", 2, "associate scene.json -o out.csv"),
        Case {
            make: Box::new(|folder| folder.copy(&tutorial("sparse"))),
            ..called("cameras of another program in place of a scene", 1, "localize 0 -o out.json")
        },
        Case {
            make: Box::new(|folder| folder.copy(&tutorial("sparse"))),
            ..called("the same in associate", 1, "associate 0 -o out.json")
        },
        Case {
            make: Box::new(|folder| folder.copy(&tutorial("sparse/0"))),
            ..called("a file of another program's cameras", 1, "localize images.txt -o out.json")
        },
        Case {
            make: Box::new(|folder| folder.write("coco.json", r#"{"images": [], "annotations": []}"#)),
            ..called("detections of another program in place of a scene", 1, "localize coco.json -o out.json")
        },
        folder,
        called("an output that is the scene", 2, "localize scene.json -o scene.json"),
        Case {
            make: Box::new(|folder| ["a.json", "b.json", "out.json"].iter().for_each(|name| folder.write(name, "{}"))),
            ..called("several scenes and one file", 1, "localize a.json b.json -o out.json")
        },
        twice,
        called("a pattern that nothing matches", 1, "localize none*.json -o results"),
        Case {
            make: Box::new(|folder| std::fs::create_dir(folder.path("empty")).unwrap()),
            ..called("a folder without scenes", 1, "localize empty -o results")
        },
        called("a synthetic scene in a folder that does not exist", 1, "synth -o no/scene.json"),
        Case {
            make: Box::new(|folder| folder.write("taken", "")),
            ..called("a demo in place of a file", 1, "demo --out taken")
        },
    ]
}

fn evaluations() -> Vec<Case> {
    let pair = |title, arguments, truth: fn(&mut Value)| Case {
        make: Box::new(move |folder: &Folder| {
            folder.succeed("synth -o truth.json --objects 2 --views 6");
            folder.succeed("localize truth.json -o estimate.json");
            let mut changed = folder.json("truth.json");
            truth(&mut changed);
            folder.write_json("truth.json", &changed);
            let object = |name: &str| json!({"format": "quadlift.scene", "version": 1, "name": name});
            folder.write_json("empty.json", &object("empty"));
            let mut other = object("other");
            other["detections"] = json!([{"frame": "000000", "object": "cup", "box": [1, 2, 3, 4]}]);
            folder.write_json("other.json", &other);
        }),
        ..called(title, 1, arguments)
    };
    const EVALUATE: &str = "evaluate estimate.json truth.json";
    vec![
        pair("a truth without objects", EVALUATE, |truth| drop(truth.as_object_mut().unwrap().remove("objects"))),
        pair("no common object", "evaluate estimate.json truth.json --match ids", |truth| {
            truth["objects"][0]["id"] = json!("cup");
            truth["objects"][1]["id"] = json!("mug");
        }),
        pair("an object id that is used twice", EVALUATE, |truth| {
            truth["objects"][0]["id"] = json!("object_001");
        }),
        pair("an axis that is not positive", EVALUATE, |truth| {
            truth["objects"][1]["ellipsoid"]["semi_axes"][2] = json!(0)
        }),
        pair("a rotation that is no unit quaternion", EVALUATE, |truth| {
            truth["objects"][0]["ellipsoid"]["rotation"] = json!([1, 1, 0, 0]);
        }),
        pair("an unknown status", EVALUATE, |truth| truth["objects"][0]["status"] = json!("fine")),
        pair("no estimate", "evaluate no.json truth.json", |_| {}),
        pair("an estimate without objects", "evaluate empty.json truth.json", |_| {}),
        pair("identities of other detections", "evaluate other.json truth.json", |_| {}),
        pair("identities of an unknown source", "evaluate truth.json truth.json --source yolo", |_| {}),
    ]
}

fn exports() -> Vec<Case> {
    let of_truth = |title, code, arguments| Case {
        make: Box::new(|folder: &Folder| {
            folder.succeed("synth -o truth.json --objects 2 --views 6");
            folder.write("tables/notes.txt", "");
            folder.write("calib.txt", "P0: 1 2 3\n");
        }),
        ..called(title, code, arguments)
    };
    vec![
        called("a scene without objects", 1, "export ply scene.json -o out.ply"),
        Case {
            make: Box::new(|folder| {
                let mut scene = folder.small_scene();
                scene["objects"] = json!([{"id": "cup", "status": "too_few_views"}]);
                folder.write_json("scene.json", &scene);
            }),
            ..called("objects without a body", 1, "export glb scene.json -o out.glb")
        },
        of_truth("an export in place of the scene", 2, "export ply truth.json -o truth.json"),
        of_truth("an export into a folder that does not exist", 1, "export coco truth.json -o no/out.json"),
        of_truth("an export in place of a folder", 1, "export coco truth.json -o tables"),
        of_truth("two tables of one name", 2, "export csv truth.json -o out.csv --views out.csv"),
        of_truth("a calibration without P2", 1, "export kitti truth.json -o out.txt --calib calib.txt"),
        of_truth("frusta of a negative depth", 2, "export ply truth.json -o out.ply --frusta=-1"),
        of_truth("an origin of two numbers", 2, "export geojson truth.json -o out.json --origin 48.2,16.37"),
        of_truth("places on Earth without an origin", 1, "export geojson truth.json -o out.json"),
        of_truth("places on Earth without meters", 1, "export geojson truth.json -o out.json --origin 48.2,16.37,170"),
        of_truth("an unknown format", 2, "export obj truth.json -o out.obj"),
        of_truth("a recording in a folder with files", 1, "export rerun truth.json -o tables"),
        of_truth("a recording in place of a file", 1, "export rerun truth.json -o calib.txt"),
        of_truth("a recording in a folder that does not exist", 1, "export rerun truth.json -o no/out"),
        of_truth("a recording of a file that does not exist", 1, "export rerun truth.json estimate.json -o new"),
        Case {
            make: Box::new(|folder| folder.write("scene.json", r#"{"format": "quadlift.scene", "version": 1}"#)),
            ..called("a recording of nothing", 1, "export rerun scene.json -o new")
        },
    ]
}

/// Logs in MCAP. Those of other programs with damaged parts are in `scripts/check_mcap.py`.
fn logs() -> Vec<Case> {
    let file = |title, name: &'static str, content: &'static [u8], arguments| Case {
        make: Box::new(move |folder: &Folder| folder.write(name, content)),
        ..called(title, 1, arguments)
    };
    let log = |title, code, arguments| Case {
        make: Box::new(|folder: &Folder| {
            folder.succeed("synth -o scene.json --objects 2 --views 6");
            folder.succeed("export mcap scene.json -o log.mcap");
        }),
        ..called(title, code, arguments)
    };
    const IMPORT: &str = "import mcap log.mcap -o out.json";
    vec![
        file("a bag of ROS 1", "drive.bag", b"#ROSBAG V2.0\n", "import mcap drive.bag -o out.json"),
        file("a bag in SQLite", "drive.db3", b"SQLite format 3\0", "import mcap drive.db3 -o out.json"),
        file("a log that is none", "log.mcap", b"frame,x0,y0,x1,y1\n", IMPORT),
        file("a log of a later version", "log.mcap", b"\x89MCAP1\r\n", IMPORT),
        file("a log that is cut off", "log.mcap", b"\x89MCAP0\r\n\x01\x14\0\0\0\0\0\0\0\x04\0", IMPORT),
        log("a log in place of a scene", 1, "info log.mcap"),
        log("a log without the world's frame", 1, "import mcap log.mcap -o out.json --world-frame odom"),
        log("a log without the camera's frame", 1, "localize log.mcap -o out.json --camera-frame gripper"),
        log("a log without a topic", 1, "localize log.mcap -o out.json --topics /boxes"),
        log("an option of logs for a scene", 2, "localize scene.json -o out.json --world-frame map"),
        log("the same in a stream", 2, "stream scene.json --topics /boxes"),
        log("a log that would be overwritten", 2, "import mcap log.mcap -o log.mcap"),
    ]
}

/// What the program says: errors, and the notes on objects without a body.
fn message(run: &Run) -> String {
    let notes = run.stdout.lines().filter_map(|line| line.strip_prefix("note: "));
    // The usage line and hints of the argument parser are left out.
    let errors = run.stderr.lines().take_while(|line| !line.is_empty());
    notes.chain(errors).collect::<Vec<_>>().join("\n")
}

fn check(case: &Case) -> String {
    let folder = Folder::new();
    (case.make)(&folder);
    let before = folder.names();
    let run = folder.run(case.arguments);
    let title = case.title;
    assert_eq!(run.code, case.code, "{title}: {}\n{}", run.stdout, run.stderr);
    assert!(run.stderr.starts_with("error: "), "{title}: {:?}", run.stderr);
    if run.code == 2 || !run.stdout.contains("wrote ") {
        assert_eq!(folder.names(), before, "{title}: something was written");
        assert_eq!(run.stdout, "", "{title}");
    } else if case.arguments.starts_with("segment") {
        // What failed says so, and the rest is done.
        let scene = folder.json("out.json");
        let status = |status: &str| {
            scene["detections"].as_array().unwrap().iter().filter(|d| d["segmentation"]["status"] == status).count()
        };
        assert!(status("failed") >= 1 && status("ok") >= 3, "{title}: {scene}");
    } else {
        // Every object has its status in the result; where nothing else is said, some are "ok".
        let failed = run.code == 3 || run.stderr.ends_with("no object could be localized\n");
        for object in folder.json("out.json")["objects"].as_array().unwrap() {
            assert_eq!(object["status"] == "ok", !failed, "{title}");
        }
    }
    let message = message(&run);
    assert!(!message.contains(".rs:") && !message.contains("Error {"), "{title}: {message}");
    message
}

const INTRODUCTION: &str = "\
What `quadlift` prints when an input is wrong: the input error, the exit code, the message. Written by the test; after a change of a message:
QUADLIFT_UPDATE_DOCS=1 cargo test -p quadlift-cli --test program bad_inputs
";

/// A line as code in Markdown, whether or not it holds backticks.
fn code_span(line: &str) -> String {
    if line.contains('`') { format!("`` {line} ``") } else { format!("`{line}`") }
}

fn document() -> String {
    let sections = [
        ("Files", files()),
        ("Entries of a scene", entries()),
        ("Scenes in which nothing can be localized", hopeless()),
        ("Detections without identities", associations()),
        ("Images and masks", images()),
        ("Detections of other programs", detections()),
        ("Choices", choices()),
        ("Paths", paths()),
        ("Evaluation", evaluations()),
        ("Exports", exports()),
        ("Reports and pictures", looks()),
        ("Streams", streams()),
        ("Logs in MCAP", logs()),
    ];
    let mut text = INTRODUCTION.to_owned();
    for (heading, cases) in sections {
        writeln!(text, "\n{heading}\n").unwrap();
        for case in cases {
            let lines: Vec<String> = check(&case).replace('|', "\\|").lines().map(code_span).collect();
            writeln!(text, "| {} | {} | {} |", case.title, case.code, lines.join("<br>")).unwrap();
        }
    }
    text
}

/// The snapshot of all messages: rows of a table in Markdown.
const SNAPSHOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/program/snapshots/bad_inputs.txt");

/// The row of an input error in the snapshot, without its exit code.
pub(crate) fn row(title: &str) -> String {
    let rows = std::fs::read_to_string(SNAPSHOT).unwrap().replace("\r\n", "\n");
    let row = rows.lines().find_map(|line| line.strip_prefix(&format!("| {title} | ")));
    let row = row.unwrap_or_else(|| panic!("no input error has the title {title}"));
    format!("| {title} | {}", row.split_once(" | ").unwrap().1)
}

#[test]
fn every_bad_input_has_its_message() {
    let document = document();
    if std::env::var_os("QUADLIFT_UPDATE_DOCS").is_some() {
        std::fs::write(SNAPSHOT, &document).unwrap();
    }
    let written = std::fs::read_to_string(SNAPSHOT).unwrap_or_default().replace("\r\n", "\n");
    for (line, (new, old)) in document.lines().zip(written.lines()).enumerate() {
        assert_eq!(new, old, "{SNAPSHOT}:{} is out of date; run with QUADLIFT_UPDATE_DOCS=1", line + 1);
    }
    assert!(document == written, "{SNAPSHOT} is out of date; run with QUADLIFT_UPDATE_DOCS=1");
}

#[test]
fn an_earlier_result_survives_a_failure() {
    let folder = Folder::new();
    folder.write("out.json", "earlier");
    folder.write("scene.json", "{");
    assert_eq!(folder.run(LOCALIZE).code, 1);
    assert_eq!(folder.read("out.json"), "earlier");
    assert_eq!(folder.names(), ["out.json", "scene.json"]);
}

#[test]
fn any_cut_of_a_scene_is_refused_in_words() {
    let folder = Folder::new();
    let text = folder.small_scene().to_string();
    for cut in (1..text.len()).step_by(text.len() / 30) {
        folder.write("scene.json", &text[..cut]);
        let run = folder.run("info scene.json");
        assert!(run.code == 1 && run.stderr.starts_with("error: scene.json"), "{cut}: {}", run.stderr);
    }
}

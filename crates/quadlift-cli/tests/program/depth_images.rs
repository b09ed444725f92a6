//! Depth images: rendered, read by the built program, and damaged.

use crate::common::Folder;
use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use nalgebra::Vector2;
use quadlift::geometry::Ellipsoid;
use quadlift::scene::Scene;
use quadlift_io::read_scene_file;
use serde_json::{Value, json};

/// World units of one count.
const SCALE: f64 = 0.005;

/// Pixels of the image in a pixel of the depth image.
const COARSE: u32 = 4;

/// How far along a ray an ellipsoid is.
fn hit(body: &Ellipsoid, from: nalgebra::Point3<f64>, ray: nalgebra::Vector3<f64>) -> Option<f64> {
    let turned = |v: nalgebra::Vector3<f64>| (body.rotation.inverse() * v).component_div(&body.semi_axes);
    let (o, d) = (turned(from - body.center), turned(ray));
    let (a, b, c) = (d.norm_squared(), d.dot(&o), o.norm_squared() - 1.0);
    (b * b > a * c).then(|| (-b - (b * b - a * c).sqrt()) / a)
}

/// The depth image of a frame: bodies before a wall.
fn depth_image(scene: &Scene, frame: usize, bodies: &[Ellipsoid]) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    let frame = &scene.frames[frame];
    let size = frame.image_size.unwrap();
    let camera = frame.projection.center_in_world().unwrap();
    ImageBuffer::from_fn(size.x as u32 / COARSE, size.y as u32 / COARSE, |x, y| {
        let pixel = Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) * f64::from(COARSE);
        let ray = frame.projection.ray_in_world(&pixel).unwrap();
        let depth = |body: &Ellipsoid| Some(frame.projection.depth(&(camera + ray * hit(body, camera, ray)?)));
        let nearest = bodies.iter().filter_map(depth).fold(260.0, f64::min);
        // Every tenth pixel has no depth.
        Luma([if (x + y) % 10 == 0 { 0 } else { (nearest / SCALE).round() as u16 }])
    })
}

/// A scene of one view with a depth image in `depth/`; the true objects are in `truth.json`.
fn made(folder: &Folder) -> Value {
    folder.succeed("synth -o truth.json --objects 12 --views 1 --seed 5 --noise box:0.01 --cube 80");
    let file = read_scene_file(&folder.path("truth.json")).unwrap();
    let scene = file.to_scene().unwrap();
    let objects = file.to_objects().unwrap();
    let bodies: Vec<Ellipsoid> = objects.iter().filter_map(|object| Some(object.body()?.closest_ellipsoid())).collect();
    assert_eq!(bodies.len(), 12);
    std::fs::create_dir(folder.path("depth")).unwrap();
    depth_image(&scene, 0, &bodies).save(folder.path("depth/0.png")).unwrap();
    let mut value = folder.json("truth.json");
    value.as_object_mut().unwrap().remove("objects");
    value["frames"][0]["depth"] = json!({"path": "depth/0.png", "scale": SCALE, "source": "lidar"});
    value
}

#[test]
fn one_view_with_a_depth_image_locates_objects() {
    let folder = Folder::new();
    let scene = made(&folder);
    folder.write_json("scene.json", &scene);
    let run = folder.run("localize scene.json -o objects.json -v");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("depth images: 12 detections with a depth, 0 without"), "{}", run.stderr);
    let (found, truth) = (folder.json("objects.json"), folder.json("truth.json"));
    let number = |value: &Value| value.as_f64().unwrap();
    let mut errors: Vec<f64> = found["objects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|object| {
            let id = &object["id"];
            let body = truth["objects"].as_array().unwrap().iter().find(|body| body["id"] == *id).unwrap();
            let off = (0..3).map(|k| number(&object["center"][k]) - number(&body["ellipsoid"]["center"][k]));
            let size = (0..3).map(|k| number(&body["ellipsoid"]["semi_axes"][k])).sum::<f64>() / 3.0;
            off.map(|x| x * x).sum::<f64>().sqrt() / size
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() == 12 && errors[6] < 0.5, "{errors:?}");
    // Paths follow the file, and the result keeps them.
    assert_eq!(found["frames"][0]["depth"]["path"], "depth/0.png");
    // Other methods do not read them, and a depth of the detection itself counts.
    let planes = folder.run("localize scene.json --method planes -v");
    assert!(!planes.stderr.contains("depth images"), "{}", planes.stderr);
    let mut own = scene.clone();
    own["detections"][0]["depth"] = json!({"median": 20.0});
    folder.write_json("own.json", &own);
    assert!(folder.run("localize own.json -v").stderr.contains("depth images: 11 detections with a depth"));
    // A source whose scale is that of a frame.
    let mut relative = scene.clone();
    relative["cue_sources"] = json!({"lidar": {"scale": "frame"}});
    folder.write_json("relative.json", &relative);
    let run = folder.run("localize relative.json -o relative_objects.json -v");
    assert!(
        run.stderr.contains("depths of lidar in single frames are 1.000 to 1.000 of the true ones"),
        "{}",
        run.stderr
    );
    let scales = folder.json("relative_objects.json")["localization"]["cue_scales"].clone();
    assert_eq!((scales.as_array().unwrap().len(), &scales[1]["frame"]), (2, &json!("000000")), "{scales}");
    // A mask limits the pixels: those of the wall alone.
    let mut masked = scene;
    masked["detections"][0]["mask"] = json!({"polygons": [[0, 0, 40, 0, 40, 40, 0, 40]]});
    folder.write_json("masked.json", &masked);
    folder.succeed("localize masked.json -o masked_objects.json");
    let id = &masked["detections"][0]["object"];
    let of =
        |name: &str| folder.json(name)["objects"].as_array().unwrap().iter().find(|o| o["id"] == *id).unwrap().clone();
    assert_ne!(of("masked_objects.json")["center"], of("objects.json")["center"]);
    // And so does an outline, which has its lines besides.
    let corners = json!([[0, 0], [40, 0], [40, 40], [0, 40]]);
    let depth_of = |detection: &str, field: &str, value: Value| {
        let mut scene = masked.clone();
        let found = scene["detections"][0].as_object_mut().unwrap();
        found.remove("mask");
        found.insert(field.to_owned(), value);
        folder.write_json(detection, &scene);
        folder.succeed(&format!("localize {detection} -q -o found.json --measurement box"));
        of("found.json")["center"].clone()
    };
    let with_mask = depth_of(
        "mask.json",
        "mask",
        json!({"polygons": [corners.as_array().unwrap().iter().flat_map(|c| c.as_array().unwrap().clone()).collect::<Vec<_>>()]}),
    );
    assert_eq!(depth_of("outline.json", "outline", corners), with_mask);
}

/// The first line of the errors with this depth image, and the exit code.
fn message(folder: &Folder, scene: &Value, depth: Value) -> (i32, String) {
    let mut scene = scene.clone();
    scene["frames"][0]["depth"] = depth;
    folder.write_json("damaged.json", &scene);
    let run = folder.run("localize damaged.json");
    (run.code, run.stderr.lines().next().unwrap_or_default().to_owned())
}

#[test]
fn damaged_depth_images_are_named() {
    let folder = Folder::new();
    let scene = made(&folder);
    let at = |path: &str| json!({"path": format!("depth/{path}"), "scale": SCALE});
    let good = std::fs::read(folder.path("depth/0.png")).unwrap();
    folder.write("depth/cut.png", &good[..good.len() / 2]);
    folder.write("depth/text.png", "depth");
    ImageBuffer::<Luma<u16>, Vec<u16>>::new(160, 60).save(folder.path("depth/flat.png")).unwrap();
    let truth = read_scene_file(&folder.path("truth.json")).unwrap().to_scene().unwrap();
    let size = truth.frames[0].image_size.unwrap();
    let (width, height) = (size.x as u32 / COARSE, size.y as u32 / COARSE);
    // Larger than the camera, and only a header: the size alone is enough.
    let mut large = Vec::new();
    ImageBuffer::<Luma<u16>, Vec<u16>>::new(2 * size.x as u32, 2 * size.y as u32)
        .write_to(&mut std::io::Cursor::new(&mut large), image::ImageFormat::Png)
        .unwrap();
    folder.write("depth/large.png", &large[..64]);
    GrayImage::new(width, height).save(folder.path("depth/gray.png")).unwrap();
    RgbImage::new(width, height).save(folder.path("depth/color.png")).unwrap();
    ImageBuffer::<Luma<u16>, Vec<u16>>::new(width, height).save(folder.path("depth/zero.png")).unwrap();
    let told: Vec<String> =
        ["missing.png", "cut.png", "text.png", "gray.png", "color.png", "flat.png", "large.png", "zero.png"]
            .iter()
            .map(|name| {
                let (code, line) = message(&folder, &scene, at(name));
                format!("{name} {code}: {line}")
            })
            .chain(
                [json!({"path": "depth/0.png"}), json!({"path": "depth/0.png", "scale": -1}), json!("depth/0.png")]
                    .map(|depth| {
                        let (code, line) = message(&folder, &scene, depth.clone());
                        format!("{depth} {code}: {line}")
                    }),
            )
            .collect();
    insta::assert_snapshot!(told.join("\n"), @r#"
missing.png 1: error: depth/missing.png: there is no such file
cut.png 1: error: depth/cut.png: the PNG image is damaged or cut off (unexpected end of file)
text.png 1: error: depth/text.png: this is not an image: expected PNG or JPEG
gray.png 1: error: depth/gray.png: the image is in greyscale with 8 bits; expected a depth image in greyscale with 16 bits
color.png 1: error: depth/color.png: the image is in color with 8 bits; expected a depth image in greyscale with 16 bits
flat.png 1: error: depth/flat.png: the depth image has 160 x 60 pixels; the camera of frame "000000" has 1280 x 960: expected as many, or both sides smaller by one factor
large.png 1: error: depth/large.png: the depth image has 2560 x 1920 pixels; the camera of frame "000000" has 1280 x 960: expected as many, or both sides smaller by one factor
zero.png 1: warning: damaged.json: no pixel of a detection has a depth in the depth images; expected counts above 0
{"path":"depth/0.png"} 1: error: damaged.json:164:7: frames[0].depth: missing field `scale` ("depth": of a detection {"median": number, "sd": number, "source": "..."}, of a frame {"path": "...", "scale": world units of one count})
{"path":"depth/0.png","scale":-1} 1: error: damaged.json: frames[0].depth.scale: found -1; expected a positive number, the world units of one count
"depth/0.png" 1: error: damaged.json:162:28: frames[0].depth: found the text "depth/0.png", expected an object {...} ("depth": of a detection {"median": number, "sd": number, "source": "..."}, of a frame {"path": "...", "scale": world units of one count})
"#);
    // A file that is named by the scene is not overwritten.
    folder.write_json("scene.json", &scene);
    let run = folder.run("localize scene.json -o depth/0.png");
    assert_ne!(run.code, 0);
    assert_eq!(std::fs::read(folder.path("depth/0.png")).unwrap(), good);
}

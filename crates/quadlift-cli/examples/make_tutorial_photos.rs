//! Makes the files of docs/tutorial-photos.md: photographs of a desk (rendered), a COLMAP model of them, YOLO's labels, and
//! the truth.
//!
//!     cargo run --release -p quadlift-cli --example make_tutorial_photos -- docs/data/tutorial-photos

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Context, Result};
use nalgebra::{Matrix3, Rotation3};
use quadlift::geometry::{Body, quaternion_from_rotation};
use quadlift_io::scene_file::ObjectRecord;
use quadlift_io::{SceneFile, write_file, write_jpeg, write_scene_file};
use quadlift_segment::render::{DeskOptions, render_desk};

/// Quality of the images: small files are wanted.
const QUALITY: u8 = 78;

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args_os().nth(1).context("expected a folder")?);
    for name in ["images", "sparse/0", "labels"] {
        std::fs::create_dir_all(folder.join(name))?;
    }
    let options = DeskOptions { seed: 7, views: 36, width: 480, height: 360 };
    let desk = render_desk(&options)?;
    let (scene, frames) = (&desk.synthetic.scene, &desk.synthetic.frames);
    let [width, height] = [options.width, options.height].map(f64::from);
    let name = |index: usize| format!("desk_{:02}", index + 1);

    let mut images = String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; POINTS2D[]\n");
    for (index, frame) in frames.iter().enumerate() {
        let pose = frame.cam_from_world.matrix();
        let rotation: Matrix3<f64> = pose.fixed_columns::<3>(0).into();
        let [w, x, y, z] = quaternion_from_rotation(&Rotation3::from_matrix_unchecked(rotation));
        let t = pose.column(3);
        let id = index + 1;
        let file = name(index);
        writeln!(images, "{id} {w:.9} {x:.9} {y:.9} {z:.9} {:.9} {:.9} {:.9} 1 {file}.jpg\n", t[0], t[1], t[2])?;
        write_jpeg(&folder.join(format!("images/{file}.jpg")), &desk.images[index], QUALITY)?;
        let mut labels = String::new();
        for detection in scene.detections.iter().filter(|d| d.frame_index as usize == index) {
            let (Some(class), Some(b)) = (detection.category_index, &detection.bounding_box) else { continue };
            let [x0, y0, x1, y1] = b.edges();
            let [x, y] = [(x0 + x1) / 2.0 / width, (y0 + y1) / 2.0 / height];
            let [w, h] = [(x1 - x0) / width, (y1 - y0) / height];
            writeln!(labels, "{class} {x:.6} {y:.6} {w:.6} {h:.6} {:.3}", detection.score.unwrap_or(1.0))?;
        }
        write_file(&folder.join(format!("labels/{file}.txt")), |out| out.write_all(labels.as_bytes()))?;
    }
    let first = frames.first().context("there are no frames")?.intrinsics;
    let cameras = format!(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 PINHOLE {} {} {} {} {} {}\n",
        options.width, options.height, first.fx, first.fy, first.cx, first.cy
    );
    let mut classes = String::from("names:\n");
    for (index, category) in scene.categories.iter().enumerate() {
        writeln!(classes, "  {index}: {category}")?;
    }
    for (path, text) in [("sparse/0/cameras.txt", &cameras), ("sparse/0/images.txt", &images), ("data.yaml", &classes)]
    {
        write_file(&folder.join(path), |out| out.write_all(text.as_bytes()))?;
    }
    let object = |((id, body), category): (&(String, Body), &&str)| {
        let category = Some((*category).to_owned());
        let mut object = ObjectRecord { id: id.clone(), category, ..Default::default() };
        object.set_body(body);
        object
    };
    let truth = SceneFile {
        name: Some("the things on the desk".to_owned()),
        length_unit: Some("m".to_owned()),
        objects: desk.synthetic.truth.iter().zip(&desk.categories).map(object).collect(),
        ..Default::default()
    };
    write_scene_file(&folder.join("truth.json"), &truth)?;
    Ok(())
}

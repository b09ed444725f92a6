//! nerfstudio's and instant-ngp's `transforms.json`.
//!
//! Poses are camera-to-world with OpenGL axes (x right, y up, z backwards); they become world-to-camera with OpenCV
//! axes. `applied_transform` and `applied_scale`, the rotation and scale that nerfstudio applied to the world, are undone, so
//! that the world is that of the COLMAP model the file was made of. Convention: docs.nerf.studio, "Data conventions";
//! `nerfstudio_dataparser.py`.

use std::path::Path;

use nalgebra::{Matrix3, Matrix4, Vector3};
use quadlift::geometry::{Camera, CameraModel};

use super::format::{Format, PoseFormat};
use super::image_names::image_of_stem;
use super::import::{Import, PixelCenters, camera_id};
use super::json::{Node, parse_json};
use super::poses::{check_rigid, from_rows, inverse, rows};
use crate::error::ReadError;
use crate::images::read_image_size;
use crate::input::read_bytes;
use crate::scene_file::{CameraRecord, DepthImageRecord, FrameRecord, SceneFile};
use crate::wording::count;

/// World units of one count of a depth image: nerfstudio's default, millimeters in a world in meters.
const DEPTH_SCALE: f64 = 0.001;

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "nerfstudio",
    title: "nerfstudio",
    about: "nerfstudio's or instant-ngp's transforms.json",
    looks: "transforms.json",
    options: &["pixel_centers"],
    finds: |probe| {
        let is_file = probe.keys()?.are_of_object() && probe.text()?.contains("\"transform_matrix\"");
        probe.when(is_file || probe.has("transforms.json"))
    },
    read: |path, options| read_nerfstudio(path, options.pixel_centers),
};

/// Reads `transforms.json`, given as file or folder. Frame ids are the `file_path`s. Missing image sizes are read from
/// the images, if available.
///
/// # Errors
/// [`ReadError`] with the entry, what was found and what was expected.
fn read_nerfstudio(path: &Path, pixel_centers: PixelCenters) -> Result<Import, ReadError> {
    let file = if path.is_dir() { path.join("transforms.json") } else { path.to_owned() };
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    let size_of = |image: &str| {
        let size = read_image_size(&folder.join(image)).ok()?;
        Some(size.map(f64::from))
    };
    let exists = |image: &str| folder.join(image).is_file();
    let mut import = parse_nerfstudio(&file, &read_bytes(&file)?, pixel_centers, &exists, &size_of)?;
    import.image_folder = Some(folder);
    Ok(import)
}

/// The cameras in the bytes of `transforms.json`; the path is used in messages. `exists` tests for an image by name,
/// `size_of` returns its width and height.
///
/// # Errors
/// As [`read_nerfstudio`].
fn parse_nerfstudio(
    path: &Path,
    bytes: &[u8],
    pixel_centers: PixelCenters,
    exists: &dyn Fn(&str) -> bool,
    size_of: &dyn Fn(&str) -> Option<[f64; 2]>,
) -> Result<Import, ReadError> {
    let value = parse_json(path, bytes)?;
    let root = Node::root(path, &value);
    let mut notes = vec!["OpenGL axes and camera-to-world poses were converted".to_owned(), pixel_centers.note()];
    let world_from_saved = world_from_saved(&root, &mut notes)?;
    let mut scene = SceneFile::default();
    // ScanNet++ lists the images that it tests with apart.
    let test = root.optional("test_frames")?.map(|node| node.items()).transpose()?.unwrap_or_default();
    if !test.is_empty() {
        notes.push(format!("{} of test_frames were read, too", count(test.len(), "frame")));
    }
    for frame in root.member("frames")?.items()?.iter().chain(&test) {
        let name = frame.member("file_path")?.text()?;
        let plain = name.strip_prefix("./").unwrap_or(name);
        // Blender's synthetic scenes leave out extensions.
        let full = if exists(plain) { None } else { image_of_stem(plain, exists) };
        let image = full.unwrap_or_else(|| plain.to_owned());
        let camera = camera(&root, frame, pixel_centers, &|| size_of(&image))?;
        let id = camera_id(&mut scene, camera);
        let pose = frame.member("transform_matrix")?;
        let saved_from_gl = from_rows(&pose.three_rows()?);
        let world_from_gl = world_from_saved.apply(&saved_from_gl);
        let gl_from_cv = Matrix4::from_diagonal(&nalgebra::Vector4::new(1.0, -1.0, -1.0, 1.0));
        let world_from_cam = world_from_gl * gl_from_cv;
        check_rigid(&world_from_cam, "it").map_err(|problem| pose.error(problem))?;
        let cam_from_world = inverse(&world_from_cam).ok_or_else(|| pose.error("the rotation cannot be inverted"))?;
        scene.frames.push(FrameRecord {
            id: name.to_owned(),
            camera: Some(id),
            cam_from_world: Some(rows(&cam_from_world)),
            image: Some(image),
            depth: depth_image(frame)?,
            ..FrameRecord::default()
        });
    }
    if scene.frames.iter().any(|frame| frame.depth.is_some()) {
        notes.push(format!(
            "depth images are read as millimeters, as by nerfstudio: {DEPTH_SCALE} world units of one count"
        ));
    }
    if scene.cameras.iter().any(|camera| camera.width.is_none()) {
        notes.push("the image sizes are unknown: box edges at the border are not treated as cut off".to_owned());
    }
    Import { scene, notes, ..Import::default() }.checked(path)
}

/// The depth image of a frame; files that are no images (`.npy`) are left out.
fn depth_image(frame: &Node) -> Result<Option<Box<DepthImageRecord>>, ReadError> {
    let path = frame.optional("depth_file_path")?.map(|node| node.text()).transpose()?;
    let is_png =
        |path: &&str| Path::new(path).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
    Ok(path.filter(is_png).map(|path| {
        let path = path.strip_prefix("./").unwrap_or(path).to_owned();
        Box::new(DepthImageRecord { path, scale: DEPTH_SCALE, ..DepthImageRecord::default() })
    }))
}

/// The transform of the world recorded in the file, which is undone.
struct Undo {
    rotation: Matrix3<f64>,
    shift: Vector3<f64>,
    scale: f64,
}

impl Undo {
    /// The pose before the change: `saved = scale * (rotation * x + shift)` for points, and no scale on directions.
    fn apply(&self, saved_from_cam: &Matrix4<f64>) -> Matrix4<f64> {
        let turn = saved_from_cam.fixed_view::<3, 3>(0, 0).into_owned();
        let center: Vector3<f64> = saved_from_cam.fixed_view::<3, 1>(0, 3).into_owned();
        let back = self.rotation.transpose();
        super::poses::matrix4(&(back * turn), &(back * (center / self.scale - self.shift)))
    }
}

fn world_from_saved(root: &Node, notes: &mut Vec<String>) -> Result<Undo, ReadError> {
    let mut undo = Undo { rotation: Matrix3::identity(), shift: Vector3::zeros(), scale: 1.0 };
    if let Some(node) = root.optional("applied_transform")? {
        let matrix = from_rows(&node.three_rows()?);
        check_rigid(&matrix, "it").map_err(|problem| node.error(problem))?;
        undo.rotation = matrix.fixed_view::<3, 3>(0, 0).into_owned();
        undo.shift = matrix.fixed_view::<3, 1>(0, 3).into_owned();
        notes.push("applied_transform was undone: the world frame is that of the source (COLMAP)".to_owned());
    } else {
        let text = "there is no applied_transform: the world frame is that of the file (in older nerfstudio files \
             COLMAP's y, x, -z)";
        notes.push(text.to_owned());
    }
    if let Some(node) = root.optional("applied_scale")? {
        undo.scale = node.number()?;
        if undo.scale <= 0.0 {
            return Err(node.error(format!("found {}, expected a positive number", undo.scale)));
        }
        notes.push("applied_scale was undone".to_owned());
    }
    Ok(undo)
}

/// The camera of a frame, without an id: values of the frame override those of the file.
fn camera(
    root: &Node,
    frame: &Node,
    pixel_centers: PixelCenters,
    size: &dyn Fn() -> Option<[f64; 2]>,
) -> Result<CameraRecord, ReadError> {
    let entry = |key: &str| -> Result<Option<Node>, ReadError> {
        Ok(match frame.optional(key)? {
            Some(own) => Some(own),
            None => root.optional(key)?,
        })
    };
    let number = |key: &str| entry(key)?.map(|node| node.number()).transpose();
    let coefficient = |key: &str| Ok::<f64, ReadError>(number(key)?.unwrap_or(0.0));
    let size = match (number("w")?, number("h")?) {
        (Some(w), Some(h)) => Some([w, h]),
        _ => size(),
    };
    let name = entry("camera_model")?.map(|node| node.text()).transpose()?.unwrap_or("OPENCV");
    let fisheye_flag = entry("is_fisheye")?.map(|node| node.boolean()).transpose()?.unwrap_or(false);
    let [k1, k2, k3, k4] = [coefficient("k1")?, coefficient("k2")?, coefficient("k3")?, coefficient("k4")?];
    let [p1, p2] = [coefficient("p1")?, coefficient("p2")?];
    let (model, coefficients) = match name {
        "EQUIRECTANGULAR" => (CameraModel::Equirectangular, Vec::new()),
        "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => {
            (CameraModel::OpenCvFisheye, vec![k1, k2, k3, k4])
        }
        "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "FULL_OPENCV" => {
            if fisheye_flag {
                (CameraModel::OpenCvFisheye, vec![k1, k2, k3, k4])
            } else if k4 != 0.0 {
                let problem =
                    format!("k4 is {k4}: a perspective camera with four radial coefficients is not supported");
                return Err(frame.error(problem));
            } else if k3 != 0.0 {
                (CameraModel::FullOpenCv, vec![k1, k2, p1, p2, k3, 0.0, 0.0, 0.0])
            } else if [k1, k2, p1, p2] != [0.0; 4] {
                (CameraModel::OpenCv, vec![k1, k2, p1, p2])
            } else {
                (CameraModel::Pinhole, Vec::new())
            }
        }
        other => {
            let problem = format!(
                "the camera model \"{other}\" is not supported; expected OPENCV, OPENCV_FISHEYE, PINHOLE or \
                 EQUIRECTANGULAR"
            );
            return Err(frame.error(problem));
        }
    };
    let no_size = || frame.error("the image size is needed, and there is neither \"w\" and \"h\" nor the image");
    let params = if model == CameraModel::Equirectangular {
        size.ok_or_else(no_size)?.to_vec()
    } else {
        let focal = |length: Option<f64>, angle: Option<f64>, axis: usize| match (length, angle) {
            (Some(length), _) => Ok(Some(length)),
            (None, Some(angle)) => Ok(Some(0.5 * size.ok_or_else(no_size)?[axis] / (0.5 * angle).tan())),
            (None, None) => Ok(None),
        };
        let fx = focal(number("fl_x")?, number("camera_angle_x")?, 0)?;
        let fy = focal(number("fl_y")?, number("camera_angle_y")?, 1)?;
        let (Some(fx), Some(fy)) = (fx.or(fy), fy.or(fx)) else {
            return Err(frame.error("there is no focal length: expected \"fl_x\" or \"camera_angle_x\""));
        };
        let center = |key: &str, axis: usize| match number(key)? {
            Some(center) => Ok(center + pixel_centers.shift()),
            // Half the size is the middle of the image in corner-based pixels, whatever else the file uses.
            None => Ok(0.5 * size.ok_or_else(no_size)?[axis]),
        };
        let mut params = vec![fx, fy, center("cx", 0)?, center("cy", 1)?];
        params.extend(coefficients);
        params
    };
    Camera::new(model, &params).map_err(|error| frame.error(error.to_string()))?;
    Ok(CameraRecord {
        model: model.name().to_owned(),
        width: size.map(|size| size[0]),
        height: size.map(|size| size[1]),
        params,
        ..CameraRecord::default()
    })
}

#[cfg(test)]
#[path = "nerfstudio/tests.rs"]
mod tests;

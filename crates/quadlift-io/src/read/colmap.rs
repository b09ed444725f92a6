//! COLMAP models: `cameras`, `images` and, if they exist, `rigs`, `frames` and `points3D`, as text or binary.
//!
//! COLMAP's conventions are those of the scene file: OpenCV axes, world to camera, pixels from the corner, all camera
//! models with their names. Format: `src/colmap/scene/reconstruction_io` of COLMAP.

mod models;
mod points;
mod observed;
mod rigs;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Vector3;
use quadlift::geometry::CameraModel;

use super::bytes::Bytes;
use super::format::{Format, PoseFormat};
use super::import::Import;
use super::poses::{matrix4, rotation_of, rows};
use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::scene_file::{CameraRecord, FrameRecord, SceneFile};
use crate::text::{Fields, Line, lines};
use crate::wording::count;

use models::Place;
use observed::Chosen;
pub(super) use points::DEFAULT_POINTS;
use rigs::{ImageId, Rigs};

/// Possible locations of images, relative to the folder of the model.
const IMAGE_FOLDERS: [&str; 3] = ["images", "../images", "../../images"];

/// A file with its bytes.
pub(super) type File<'a> = (&'a Path, &'a [u8]);

/// The row of this format.
pub(super) const FORMAT: PoseFormat = Format {
    name: "colmap",
    title: "COLMAP",
    about: "A COLMAP model, text or binary",
    looks: "a COLMAP model (cameras.bin or cameras.txt)",
    options: &["points"],
    finds: |probe| {
        if probe.is_named(&["cameras.bin", "cameras.txt", "images.bin", "images.txt"]) {
            return Ok(Some(probe.path().parent().unwrap_or(Path::new("")).to_owned()));
        }
        probe.when(probe.folder().is_some_and(|folder| !Place::all_in(folder).is_empty()))
    },
    read: |path, options| read_colmap(path, options.points.unwrap_or(DEFAULT_POINTS)),
};

/// Reads the model in a folder, or in its `sparse` or `sparse/0`; of several (`sparse/1`, ...) the one with most images. Frames have the
/// names of the images as their ids, and are sorted by them. Of the sparse points at most `most_points` are kept, evenly
/// spread; with 0 their file is not read, and it may be missing. Images of one frame of a rig have its id as `rig_frame`.
///
/// # Errors
/// [`ReadError`] with line or byte, what was found and what was expected.
fn read_colmap(folder: &Path, most_points: usize) -> Result<Import, ReadError> {
    match Place::all_in(folder).as_slice() {
        [] => Err(ReadError::new(
            folder,
            "expected the folder of a COLMAP model, with cameras.bin and images.bin or cameras.txt and images.txt",
        )),
        [only] => read_model(only, most_points),
        several => read_largest(folder, several, most_points),
    }
}

/// Reads the model with most images, of equal ones the first; a note lists all.
fn read_largest(folder: &Path, models: &[Place], most_points: usize) -> Result<Import, ReadError> {
    let images = |place: &Place| read_model(place, 0).map_or(0, |import| import.scene.frames.len());
    let images: Vec<usize> = models.iter().map(images).collect();
    // `max_by_key` takes the last.
    let largest = (0..models.len()).rev().max_by_key(|&k| images[k]).unwrap_or(0);
    let names: Vec<String> = models.iter().map(|place| place.name_in(folder)).collect();
    let list: Vec<String> =
        names.iter().zip(&images).map(|(name, &images)| format!("{name} ({})", count(images, "image"))).collect();
    let mut import = read_model(&models[largest], most_points)?;
    import.notes.push(format!(
        "the folder has {} models: {}; {} was read",
        models.len(),
        list.join(", "),
        names[largest]
    ));
    Ok(import)
}

/// Reads a model.
fn read_model(place: &Place, most_points: usize) -> Result<Import, ReadError> {
    let (model, extension) = (&place.folder, place.extension);
    let cameras_path = model.join(format!("cameras.{extension}"));
    let images_path = model.join(format!("images.{extension}"));
    let points_path = model.join(format!("points3D.{extension}"));
    let (cameras, images) = (read_bytes(&cameras_path)?, read_bytes(&images_path)?);
    let has_points = most_points > 0 && points_path.is_file();
    let points = if has_points { read_bytes(&points_path)? } else { Vec::new() };
    let rig_paths = ["rigs", "frames"].map(|name| model.join(format!("{name}.{extension}")));
    let mut rigs = Vec::new();
    for path in rig_paths.iter().filter(|path| path.is_file()) {
        rigs.push((path.as_path(), read_bytes(path)?));
    }
    let rig_files: Vec<File> = rigs.iter().map(|(path, bytes)| (*path, bytes.as_slice())).collect();
    let parse = if extension == "bin" { parse_binary } else { parse_text };
    let files = [(&*cameras_path, &*cameras), (&images_path, &images), (&points_path, &points)];
    let mut import = parse(files, <[File; 2]>::try_from(rig_files).ok(), most_points)?;
    if let [(path, _)] = rigs.as_slice() {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        import.notes.push(format!("{name} was not used: rigs.{extension} and frames.{extension} are needed together"));
    }
    import.image_folder = IMAGE_FOLDERS.map(|place| model.join(place)).into_iter().find(|place| place.is_dir());
    Ok(import)
}

/// At most so many of the points of another program, given with their ids, rounded as those of COLMAP.
pub(super) fn evenly_spread(all: Vec<(u64, [f64; 3])>, most: usize) -> Vec<[f64; 3]> {
    let all = all.into_iter().map(|(id, position)| points::Point::new(id, position)).collect();
    points::chosen(all, most).iter().map(|point| point.position).collect()
}

/// The model in the bytes of `cameras.txt`, `images.txt` and `points3D.txt`, which may be empty, and of `rigs.txt` and
/// `frames.txt` if there are rigs; the paths serve for messages.
///
/// # Errors
/// As [`read_colmap`].
fn parse_text(
    [cameras, images, points]: [File; 3],
    rigs: Option<[File; 2]>,
    most_points: usize,
) -> Result<Import, ReadError> {
    let points = Chosen::new(points::parse_text(points)?, most_points);
    let mut model = Model { rigs: rigs.map(rigs::parse_text).transpose()?, ..Model::default() };
    // Without cameras the file is empty but for its comments.
    for line in lines(cameras.0, as_utf8(cameras.0, cameras.1)?).filter(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let id = fields.whole("a camera id, a whole number")?;
        let (model_name, size, params) = camera_fields(&mut fields).map_err(|problem| line.error(problem))?;
        model.add_camera(id, model_name, size, params).map_err(|problem| line.error(problem))?;
    }
    let mut image_lines = lines(images.0, as_utf8(images.0, images.1)?).peekable();
    while let Some(line) = image_lines.find(|line| !line.is_blank_or_comment()) {
        let mut fields = line.fields();
        let id = fields.whole("an image id, a whole number")?;
        let quaternion = fields.numbers("a quaternion QW QX QY QZ")?;
        let translation = fields.numbers("a translation TX TY TZ")?;
        let camera = fields.whole("a camera id, a whole number")?;
        let image = ImageId { id, camera, name: fields.rest().to_owned() };
        model.add_image(image, quaternion, translation).map_err(|problem| line.error(problem))?;
        // The second line of each image lists its points; it is empty if there are none, and some programs omit such
        // lines.
        while let Some(line) = image_lines.peek() {
            let is_comment = line.text.starts_with('#');
            if is_comment {
                image_lines.next();
            } else if is_points(line)? {
                model.add_pixels(id, points.pixels_of_text(id, line)?);
                image_lines.next();
            }
            if !is_comment {
                break;
            }
        }
    }
    model.import(images.0, "text", &points)
}

/// Whether a line that follows an image holds its points; otherwise it is the next image.
///
/// # Errors
/// [`ReadError`] if it is neither.
fn is_points(line: &Line) -> Result<bool, ReadError> {
    let words = || line.text.split_whitespace();
    let is_number = |word: &str| word.parse::<f64>().is_ok();
    let is_image = |(index, word): (usize, &str)| match index {
        0 | 8 => word.parse::<u32>().is_ok(),
        9.. => true,
        _ => is_number(word),
    };
    let count = words().count();
    // Points without decimals look like an image, but for its name.
    if count >= 10 && words().enumerate().all(is_image) && !(count % 3 == 0 && words().skip(9).all(is_number)) {
        return Ok(false);
    }
    let first_point = words().take(2).all(is_number) && words().nth(2).is_none_or(|id| id.parse::<i64>().is_ok());
    if count % 3 == 0 && first_point {
        return Ok(true);
    }
    Err(line.error(format!(
        "{count} fields; expected the points of the image before (X Y POINT3D_ID, or nothing), or the next image \
         (IMAGE_ID, QW QX QY QZ, TX TY TZ, CAMERA_ID, NAME)"
    )))
}

/// The model in the bytes of `cameras.bin`, `images.bin` and `points3D.bin`, which may be empty, and of `rigs.bin` and
/// `frames.bin` if there are rigs; the paths serve for messages.
///
/// # Errors
/// As [`read_colmap`].
fn parse_binary(
    [cameras, images, points]: [File; 3],
    rigs: Option<[File; 2]>,
    most_points: usize,
) -> Result<Import, ReadError> {
    let points = Chosen::new(points::parse_binary(points)?, most_points);
    let mut model = Model { rigs: rigs.map(rigs::parse_binary).transpose()?, ..Model::default() };
    let mut bytes = Bytes::new(cameras.0, cameras.1);
    // The counts of the files are not trusted: nothing is allocated for them.
    for _ in 0..bytes.u64("the number of cameras")? {
        let id = bytes.u32("a camera id")?;
        let number = bytes.i32("the number of a camera model")?;
        let Some(kind) = usize::try_from(number).ok().and_then(|number| CameraModel::all().nth(number)) else {
            return Err(bytes.error(format!("the camera model before this has the number {number}; expected 0 to 17")));
        };
        let size = [bytes.u64("an image width")? as f64, bytes.u64("an image height")? as f64];
        let mut params = Vec::new();
        for name in kind.parameter_names() {
            params.push(bytes.f64(name)?);
        }
        model.add_camera(id, kind, size, params).map_err(|problem| bytes.error(problem))?;
    }
    bytes.end()?;
    let mut bytes = Bytes::new(images.0, images.1);
    for _ in 0..bytes.u64("the number of images")? {
        let id = bytes.u32("an image id")?;
        let quaternion = bytes.f64s("a quaternion w, x, y, z")?;
        let translation = bytes.f64s("a translation")?;
        let camera = bytes.u32("a camera id")?;
        let image = ImageId { id, camera, name: bytes.text("the name of an image")?.to_owned() };
        model.add_image(image, quaternion, translation).map_err(|problem| bytes.error(problem))?;
        let pixels = points.pixels_of_bytes(id, &mut bytes)?;
        model.add_pixels(id, pixels);
    }
    bytes.end()?;
    model.import(images.0, "binary", &points)
}

/// Model, image size and parameters, as in a line of `cameras.txt` after the id.
pub(super) fn camera_fields(fields: &mut Fields) -> Result<(CameraModel, [f64; 2], Vec<f64>), String> {
    let plain = |error: ReadError| error.problem;
    let name = fields.word("the name of a camera model").map_err(plain)?;
    let Some(model) = CameraModel::from_name(name) else {
        let known: Vec<&str> = CameraModel::all().map(CameraModel::name).collect();
        return Err(format!("found the camera model \"{name}\"; known are {}", known.join(", ")));
    };
    let size = [fields.number("an image width").map_err(plain)?, fields.number("an image height").map_err(plain)?];
    let mut params = Vec::new();
    for name in model.parameter_names() {
        params.push(fields.number(&format!("{name} of a {} camera", model.name())).map_err(plain)?);
    }
    if !fields.is_empty() {
        let expected = params.len();
        return Err(format!("a {} camera has {expected} parameters; found more: {}", model.name(), fields.rest()));
    }
    Ok((model, size, params))
}

/// What is read, sorted.
#[derive(Default)]
struct Model {
    cameras: BTreeMap<u32, CameraRecord>,
    frames: BTreeMap<String, FrameRecord>,
    images: Vec<ImageId>,
    rigs: Option<Rigs>,
    /// By the ids of the images; `None` where their points are not those of the tracks.
    pixels: BTreeMap<u32, Option<Box<[[f64; 2]]>>>,
}

impl Model {
    fn add_camera(&mut self, id: u32, model: CameraModel, size: [f64; 2], params: Vec<f64>) -> Result<(), String> {
        quadlift::geometry::Camera::new(model, &params).map_err(|error| format!("camera {id}: {error}"))?;
        let [width, height] = size;
        if !(width > 0.0 && height > 0.0) {
            return Err(format!("camera {id} has the image size {width} x {height}; expected two positive numbers"));
        }
        let record = CameraRecord {
            id: id.to_string(),
            model: model.name().to_owned(),
            width: Some(width),
            height: Some(height),
            params,
            ..CameraRecord::default()
        };
        match self.cameras.insert(id, record) {
            None => Ok(()),
            Some(_) => Err(format!("the camera id {id} is used twice")),
        }
    }

    fn add_image(&mut self, image: ImageId, quaternion: [f64; 4], translation: [f64; 3]) -> Result<(), String> {
        let (name, camera) = (&image.name, image.camera);
        if name.is_empty() {
            return Err("the image has no name".to_owned());
        }
        if !self.cameras.contains_key(&camera) {
            return Err(format!("image \"{name}\" has the camera {camera}, which is not in the file of the cameras"));
        }
        let rotation = rotation_of(quaternion);
        // The pose of an image without one comes from its rig.
        if rotation.is_none() && self.rigs.is_none() {
            return Err(format!("image \"{name}\" has the quaternion {quaternion:?}, which is not a rotation"));
        }
        let record = FrameRecord {
            id: name.clone(),
            camera: Some(camera.to_string()),
            cam_from_world: rotation.map(|rotation| rows(&matrix4(&rotation, &Vector3::from(translation)))),
            image: Some(name.clone()),
            ..FrameRecord::default()
        };
        if self.frames.insert(name.clone(), record).is_some() {
            return Err(format!("the image name \"{name}\" is used twice"));
        }
        self.images.push(image);
        Ok(())
    }

    fn add_pixels(&mut self, image: u32, pixels: Option<Option<Box<[[f64; 2]]>>>) {
        self.pixels.extend(pixels.map(|pixels| (image, pixels)));
    }

    /// Tells the frames which of the points were observed in them, and in which pixels. Images of tracks that the model does not have are
    /// passed over.
    fn add_observations(&mut self, points: &Chosen) {
        for image in &self.images {
            if let (Some(frame), Some(seen)) = (self.frames.get_mut(&image.name), points.observed.get(&image.id)) {
                frame.observed_points = Some(seen.iter().map(|seen| seen.point).collect());
                frame.observed_pixels = self.pixels.remove(&image.id).flatten();
            }
        }
    }

    fn import(mut self, path: &Path, form: &str, points: &Chosen) -> Result<Import, ReadError> {
        let mut notes = vec![
            format!("COLMAP model in {form} form: axes, poses and pixel coordinates need no conversion"),
            "the length unit is unknown".to_owned(),
        ];
        if let Some(rigs) = self.rigs.take() {
            let of_rigs = rigs.apply(&self.images, &mut self.frames);
            notes.extend(of_rigs.map_err(|problem| ReadError::new(path, problem))?);
        }
        match points.points.len() {
            0 => {}
            kept if kept == points.all => notes.push(format!("{} of the model", count(kept, "sparse point"))),
            kept => notes.push(format!("{kept} of {}, evenly spread", count(points.all, "sparse point"))),
        }
        if !points.observed.is_empty() {
            let (with, without) = self.pixels.values().fold((0, 0), |(with, without), pixels| match pixels {
                Some(_) => (with + 1, without),
                None => (with, without + 1),
            });
            let pixels = if with > 0 { ", with their pixels" } else { "" };
            notes.push(format!("frames have the points that were observed in them{pixels}"));
            if without > 0 {
                let images = count(without, "image");
                notes.push(format!("the pixels of {images} were not used: their points are not those of the tracks"));
            }
            self.add_observations(points);
        }
        let scene = SceneFile {
            points: points.points.iter().map(|point| point.position).collect(),
            cameras: self.cameras.into_values().collect(),
            frames: self.frames.into_values().collect(),
            ..SceneFile::default()
        };
        Import { scene, notes, ..Import::default() }.checked(path)
    }
}

#[cfg(test)]
#[path = "colmap/tests.rs"]
mod tests;

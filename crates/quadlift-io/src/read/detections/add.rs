//! Adding detections to a scene, in its frames and in its convention.

use std::collections::HashSet;

use nalgebra::Vector2;
use quadlift::geometry::{BoundingBox, Ellipse, OrientedBox};
use quadlift::scene::check_outline;

use super::files::{Detected, DetectionFiles, DetectionFormat, ImageKey, Outline, extent};
use super::matching::{MatchBy, MatchOptions, match_frames};
use super::shapes::box_of_runs;
use crate::correct::shift;
use crate::error::ReadError;
use crate::read::image_names::stem;
use crate::read::import::PixelCenters;
use crate::read::options::ReadOptions;
use crate::scene_file::{DetectionRecord, FrameRecord, MaskRecord, SceneFile};
use crate::wording::count;

/// Names that a message lists.
const LISTED: usize = 3;

/// Options for adding detections.
#[derive(Debug, Clone, PartialEq)]
pub struct AddOptions<'a> {
    /// How images are matched to frames.
    pub match_by: MatchBy,
    /// The number that the detections give to the frame number 0 of the scene, if known. If images are matched by name
    /// or time: the detections of frame number N belong to frame number 0, and so on.
    pub frame_offset: Option<i64>,
    /// Maximum time difference between an image and a frame, in seconds.
    pub time_tolerance: f64,
    /// Width and height in pixels of the images on which the detector ran. If the camera has another size, coordinates
    /// are scaled to it; if it has none, it gets this size.
    pub image_size: Option<[f64; 2]>,
    /// Whether the pictures may be turned by 90 degrees against the cameras: a correction turns the boxes back later.
    pub turned: bool,
    /// Whether the boxes have another format, which a correction undoes later: they may look reversed.
    pub boxes_follow: bool,
    /// The source of the new detections.
    pub source: &'a str,
    /// Skip detections with a lower score.
    pub min_score: Option<f64>,
    /// Whether existing detections of the scene are removed.
    pub replace: bool,
    /// Origin of the pixel coordinates of the detections.
    pub pixel_centers: PixelCenters,
}

impl AddOptions<'_> {
    /// Those of detections of a format that were read with these options.
    pub fn of(format: &DetectionFormat, reading: &ReadOptions) -> Self {
        let mut options = Self { source: format.name, boxes_follow: reading.boxes_follow, ..Self::default() };
        if let Some(tolerance) = reading.time_tolerance {
            options.time_tolerance = tolerance;
        }
        if format.options.contains(&"pixel_centers") {
            options.pixel_centers = reading.pixel_centers;
        }
        options
    }
}

impl Default for AddOptions<'_> {
    fn default() -> Self {
        Self {
            match_by: MatchBy::Auto,
            frame_offset: None,
            time_tolerance: 0.02,
            image_size: None,
            turned: false,
            boxes_follow: false,
            source: "detector",
            min_score: None,
            replace: false,
            pixel_centers: PixelCenters::Half,
        }
    }
}

/// What was added.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AddedDetections {
    /// Number of detections that the scene has got.
    pub added: usize,
    /// Number of them with a track id.
    pub with_object: usize,
    /// How images were matched to frames.
    pub matched_by: MatchBy,
    /// The number that the detections give to the frame number 0: given or estimated, where images are matched by
    /// number, otherwise as [`AddOptions::frame_offset`] has it.
    pub frame_offset: i64,
    /// Number of images with a frame.
    pub matched_images: usize,
    /// Images without a frame.
    pub images_without_frame: Vec<String>,
    /// Ids of frames without an image in the file.
    pub frames_without_image: Vec<String>,
    /// Detections of the images without a frame.
    pub in_no_frame: usize,
    /// Number of detections skipped for their score.
    pub low_score: usize,
    /// Number of detections skipped because their box has no width or no height.
    pub empty: usize,
    /// Detections of the scene that were removed.
    pub removed: usize,
    /// Assumptions, as text.
    pub notes: Vec<String>,
}

/// Adds detections to the frames of a scene. Existing detections are kept, unless they are replaced.
///
/// # Errors
/// [`ReadError`] if no image matches a frame of the scene, if the scene already has detections of the source, if an
/// image has another size than the frame's camera, if a size is needed but unknown, or if a track has two detections in
/// one image.
pub fn add_detections(
    scene: &mut SceneFile,
    files: DetectionFiles,
    options: &AddOptions,
) -> Result<AddedDetections, ReadError> {
    let error = |problem: String| ReadError::new(&files.path, problem);
    if !options.replace && scene.detections.iter().any(|d| d.source.as_deref() == Some(options.source)) {
        return Err(error(format!(
            "the scene already has detections of the source \"{}\"; choose another name (--source SOURCE) or replace \
             all (--replace)",
            options.source
        )));
    }
    let matching = MatchOptions {
        by: options.match_by,
        frame_offset: options.frame_offset,
        time_tolerance: options.time_tolerance,
        numbering: files.numbering,
    };
    let mut matching = match_frames(scene, &files.images, &matching).map_err(error)?;
    if matching.count() == 0 {
        return Err(error(nothing_matches(scene, &files, options)));
    }
    if let (None, Some(offset)) = (matching.frame_offset, options.frame_offset.filter(|offset| *offset != 0)) {
        shift_frames(&mut matching.frame_of_image, offset, scene);
    }
    let mut report = AddedDetections {
        matched_by: matching.by,
        frame_offset: matching.frame_offset.or(options.frame_offset).unwrap_or(0),
        matched_images: matching.count(),
        ..Default::default()
    };
    report.notes.extend(matching.note);
    if options.pixel_centers == PixelCenters::Integer {
        report.notes.push("pixel centers at integers: 0.5 was added to the coordinates".to_owned());
    }
    let (mut detections, mut scaled, mut behind) = (Vec::new(), 0, 0);
    let mut seen = vec![false; scene.frames.len()];
    let sizes = scene.image_sizes();
    for (image, frame) in files.images.iter().zip(&matching.frame_of_image) {
        let Some(frame) = *frame else {
            report.images_without_frame.push(image.key.words());
            report.in_no_frame += image.detections.len();
            continue;
        };
        seen[frame] = true;
        let size = image_size(sizes[frame], &scene.frames[frame], &image.key, options).map_err(error)?;
        let scale = scale_of(files.normalized, size, &image.key, options).map_err(error)?;
        scaled += usize::from(!files.normalized && scale != [1.0, 1.0]);
        // Half a pixel of the image in which the detection was made.
        let shift = scale.map(|scale| options.pixel_centers.shift() * if files.normalized { 1.0 } else { scale });
        let mut tracks = HashSet::new();
        for detected in &image.detections {
            if options.min_score.zip(detected.score).is_some_and(|(least, score)| score < least) {
                report.low_score += 1;
                continue;
            }
            let Some(mut record) = record(detected, scale, shift, options.boxes_follow) else {
                report.empty += 1;
                continue;
            };
            if record.box3d.as_ref().is_some_and(|box3d| !box3d.is_in_front_of(&scene.frames[frame])) {
                behind += 1;
                continue;
            }
            if let Some(track) = &detected.track {
                if !tracks.insert(track) {
                    let name = image.key.words();
                    return Err(error(format!("the track {track} has two detections in the image {name}")));
                }
                report.with_object += 1;
            }
            record.frame = scene.frames[frame].id.as_str().into();
            record.source = Some(options.source.into());
            detections.push(record);
        }
    }
    let without = scene.frames.iter().zip(&seen).filter(|(_, seen)| !**seen);
    report.frames_without_image = without.map(|(frame, _)| frame.id.clone()).collect();
    report.added = detections.len();
    if behind > 0 {
        let which =
            format!("{behind} of {} 3D boxes are not in front of the camera of their frame", behind + report.added);
        if report.added == 0 {
            return Err(error(format!("{which}; expected boxes in the world of the scene, and its pose convention")));
        }
        report.notes.push(format!("{which}, and were skipped"));
    }
    report.notes.extend(scaled_in_words(scaled, options));
    if options.replace {
        report.removed = scene.detections.len();
        scene.detections.clear();
    }
    scene.detections.extend(detections);
    Ok(report)
}

/// Moves images that were matched by name or time to the frames that are `offset` frames earlier; those beyond the first or last get none.
fn shift_frames(frame_of_image: &mut [Option<usize>], offset: i64, scene: &SceneFile) {
    let ids: Vec<&str> = scene.frames.iter().map(|frame| frame.id.as_str()).collect();
    let frames = shift(offset).frames(&ids).unwrap_or_default();
    for frame in frame_of_image {
        *frame = frame.and_then(|frame| frames.get(frame).copied().flatten());
    }
}

/// How many images had another size than their camera.
fn scaled_in_words(scaled: usize, options: &AddOptions) -> Option<String> {
    let [width, height] = options.image_size.filter(|_| scaled > 0)?;
    let images = count(scaled, "image");
    Some(format!("the detections of {images} were scaled from {width} x {height} pixels (image_size)"))
}

/// The factor from the coordinates of an image's detections to pixels of its frame's camera.
fn scale_of(
    normalized: bool,
    size: Option<[f64; 2]>,
    key: &ImageKey,
    options: &AddOptions,
) -> Result<[f64; 2], String> {
    match (normalized, size) {
        (false, Some(of_camera)) => Ok(scale_from(options.image_size, of_camera)),
        (false, None) => Ok([1.0, 1.0]),
        (true, Some(size)) => Ok(size),
        (true, None) => Err(format!(
            "the coordinates of {} are fractions of image width and height, which are unknown: the camera has no \
             \"width\" and \"height\" (--assume image_size=WxH)",
            key.words()
        )),
    }
}

/// The image size of a frame, if known; sizes in the scene and in the file must be equal.
fn image_size(
    known: Option<[f64; 2]>,
    frame: &FrameRecord,
    key: &ImageKey,
    options: &AddOptions,
) -> Result<Option<[f64; 2]>, String> {
    match (known, key.size) {
        (Some([w, h]), Some([found_w, found_h]))
            if [w, h] != [found_w, found_h] && options.image_size != Some([found_w, found_h]) =>
        {
            let is_turned = [h, w] == [found_w, found_h];
            if is_turned && options.turned {
                return Ok(known);
            }
            let advice = if is_turned {
                "picture is turned by 90 degrees, as by its EXIF orientation: --assume orientation=6 turns the boxes back if \
                 clockwise, orientation=8 if not"
                    .to_owned()
            } else {
                format!(
                    "detections must come from images of the camera's size (--assume image_size={found_w}x{found_h} scales them)"
                )
            };
            Err(format!(
                "the image {} has {found_w} x {found_h} pixels, the camera of frame \"{}\" has {w} x {h}; the {advice}",
                key.words(),
                frame.id
            ))
        }
        (known, of_file) => Ok(known.or(of_file).or(options.image_size)),
    }
}

/// What coordinates are multiplied by, from images of one size to those of the camera.
fn scale_from(measured: Option<[f64; 2]>, of_camera: [f64; 2]) -> [f64; 2] {
    measured.map_or([1.0, 1.0], |[width, height]| [of_camera[0] / width, of_camera[1] / height])
}

/// A detection in pixels from the corner of the image; `None` when its box has no width or no height.
fn record(detected: &Detected, scale: [f64; 2], shift: [f64; 2], boxes_follow: bool) -> Option<DetectionRecord> {
    let place = |[x, y]: [f64; 2]| [x * scale[0] + shift[0], y * scale[1] + shift[1]];
    let (mut around, mut ellipse, mut mask, mut corners, mut turned) = (None, None, None, None, None);
    match &detected.outline {
        Outline::Unknown => {}
        Outline::Polygons(polygons) => {
            let placed = |p: &Vec<f64>| p.chunks_exact(2).flat_map(|xy| place([xy[0], xy[1]])).collect::<Vec<f64>>();
            let polygons: Vec<Vec<f64>> = polygons.iter().map(placed).collect();
            around = Some(extent(polygons.iter().flatten().copied()));
            let single: Option<Box<[[f64; 2]]>> = match &polygons[..] {
                [polygon] => Some(polygon.chunks_exact(2).map(|xy| [xy[0], xy[1]]).collect()),
                _ => None,
            };
            corners = single.filter(|corners| check_outline(corners).is_ok());
            if corners.is_none() {
                mask = Some(MaskRecord { polygons: Some(polygons), ..MaskRecord::default() });
            }
        }
        Outline::Rle(rle) => {
            // Runs count pixels; files with shares of the image have none.
            let place = |[x0, y0, x1, y1]: [f64; 4]| [x0 * scale[0], y0 * scale[1], x1 * scale[0], y1 * scale[1]];
            around = box_of_runs(rle).map(|edges| place(edges.map(|x| x as f64)));
            mask = Some(MaskRecord { rle: Some(rle.clone()), ..MaskRecord::default() });
        }
        Outline::OrientedBox(corners) => {
            let found = OrientedBox::of_corners(corners.map(|corner| Vector2::from(place(corner))))?;
            // Not around the corners, where the object is not.
            around = Some(found.inscribed_ellipse()?.bounding_box().edges());
            turned = Some(Box::new(found.into()));
        }
        Outline::Circle([x, y, radius]) => {
            let radii = Vector2::new(radius * scale[0], radius * scale[1]);
            ellipse = Some(Ellipse::new(place([*x, *y]).into(), radii, 0.0).ok()?);
        }
    }
    let given = detected.bounding_box.map(|[x0, y0, x1, y1]| {
        let ([x0, y0], [x1, y1]) = (place([x0, y0]), place([x1, y1]));
        [x0, y0, x1, y1]
    });
    let edges = given.or(around).or_else(|| ellipse.map(|ellipse| ellipse.bounding_box().edges()));
    if edges.is_none() && detected.box3d.is_none() {
        return None;
    }
    let bounding_box = match boxes_follow {
        true => edges,
        false => edges.map(BoundingBox::new).transpose().ok()?.map(|b| b.edges()),
    };
    Some(DetectionRecord {
        object: detected.track.as_ref().map(|id| object_id(id).into()),
        category: detected.category.as_deref().map(Into::into),
        score: detected.score,
        bounding_box,
        box3d: detected.box3d.clone(),
        ellipse: ellipse.map(|ellipse| Box::new(ellipse.into())),
        outline: corners,
        oriented_box: turned,
        mask: mask.map(Box::new),
        occluded: detected.occluded,
        truncated: detected.truncated,
        visible_fraction: detected.visible_fraction,
        ..DetectionRecord::default()
    })
}

/// The object id of a track: `t` with the number; other ids are not changed.
fn object_id(track: &str) -> String {
    if track.parse::<u64>().is_ok() { format!("t{track}") } else { track.to_owned() }
}

/// The message if no image matches a frame.
fn nothing_matches(scene: &SceneFile, files: &DetectionFiles, options: &AddOptions) -> String {
    if files.images.is_empty() {
        return "there are no detections".to_owned();
    }
    let listed = |names: Vec<String>| {
        let more = if names.len() > LISTED { ", ..." } else { "" };
        let names: Vec<String> = names.iter().take(LISTED).map(|name| format!("\"{name}\"")).collect();
        format!("{}{more}", names.join(", "))
    };
    let images = listed(files.images.iter().take(LISTED + 1).map(|image| image.key.words()).collect());
    let frames = scene.frames.iter().take(LISTED + 1);
    let frames = listed(frames.map(|frame| frame.image.clone().unwrap_or_else(|| frame.id.clone())).collect());
    let by = options.match_by;
    let how = if by == MatchBy::Auto { String::new() } else { format!(" by {}", by.name()) };
    let numbered = |name: &str| stem(name).ends_with(|c: char| c.is_ascii_digit());
    let by_names = matches!(by, MatchBy::Auto | MatchBy::Name | MatchBy::Stem);
    let hint = match files.images.iter().find_map(|image| image.key.name.as_deref()) {
        Some(name) if by_names && numbered(name) => "; --match index compares the numbers in the names",
        _ => "",
    };
    format!(
        "no image of the detections matches a frame of the scene{how}: the detections have the images {images}, the \
         scene has the frames {frames}{hint}"
    )
}

//! Two maps as one, in the frame of the first one.

use std::collections::{BTreeMap, BTreeSet};

use quadlift::align::{MapTransform, same_place};

use super::map_objects::MapObjects;
use crate::error::EntryError;
use crate::scene_file::{ObjectRecord, SceneFile};

/// Before ids of the second file that the first one has, too.
const PREFIX: &str = "b/";

/// Two maps as one.
#[derive(Debug, Clone)]
pub struct Merged {
    /// Cameras, frames, detections and objects of both, in the frame of the first one.
    pub file: SceneFile,
    /// Frames and objects of the second file that have another id now, with both.
    pub renamed_frames: Vec<(String, String)>,
    /// The same of objects that are not matched.
    pub renamed_objects: Vec<(String, String)>,
    /// Whether both files have detections of objects, so that the objects can be localized from all of them.
    pub has_detections: bool,
}

/// Moves the second file into the frame of the first one and adds it. Objects that are matched have one id, that of the first file; of
/// other objects, frames and cameras of the second file whose ids are taken, the ids get a prefix. Cameras that are equal are one. Of the
/// two estimates of a matched object, the one with the smaller variance of the center is kept. Where the scale was estimated, sources of depths
/// and 3D boxes of the second file get the prefix, too: they have another scale there.
///
/// # Errors
/// [`EntryError`] names the first entry of the second file that cannot be moved.
pub fn merge(
    a: &SceneFile,
    b: &SceneFile,
    [of_a, of_b]: [&MapObjects; 2],
    transform: &MapTransform,
) -> Result<Merged, EntryError> {
    let mut b = b.clone();
    b.move_by(&transform.a_from_b)?;
    if transform.covariance[(6, 6)] > 0.0 {
        separate_cue_sources(&mut b);
    }
    let mut file = a.clone();
    let has = |file: &SceneFile| file.detections.iter().any(|detection| detection.object.is_some());
    let has_detections = has(a) && has(&b);

    let (ids_a, ids_b) = (ids_of(a), ids_of(&b));
    let taken: BTreeSet<&str> = a.cameras.iter().map(|camera| camera.id.as_str()).collect();
    let mut cameras = Names::new(taken);
    for mut camera in b.cameras {
        if a.cameras.contains(&camera) {
            cameras.keep(&camera.id);
            continue;
        }
        camera.id = cameras.name(&camera.id);
        file.cameras.push(camera);
    }

    let mut frames = Names::new(a.frames.iter().map(|frame| frame.id.as_str()).collect());
    let mut renamed_frames = Vec::new();
    let first_point = a.points.len() as u32;
    for mut frame in b.frames {
        let id = frames.name(&frame.id);
        if id != frame.id {
            renamed_frames.push((std::mem::replace(&mut frame.id, id.clone()), id));
        }
        frame.camera = frame.camera.map(|camera| cameras.get(&camera));
        frame.observed_points.iter_mut().flatten().for_each(|point| *point = point.saturating_add(first_point));
        file.frames.push(frame);
    }
    file.points.append(&mut b.points);
    file.point_cloud = file.point_cloud.or(b.point_cloud);
    for (name, source) in b.cue_sources {
        file.cue_sources.entry(name).or_insert(source);
    }

    let mut objects = Names::new(ids_a.iter().map(String::as_str).collect());
    for &(i, j) in &transform.matches {
        objects.set(&of_b.ids[j], &of_a.ids[i]);
    }
    let mut renamed_objects = Vec::new();
    for id in &ids_b {
        if !objects.knows(id) {
            let name = objects.name(id);
            if name != *id {
                renamed_objects.push((id.clone(), name));
            }
        }
    }
    for mut detection in b.detections {
        detection.frame = frames.get(&detection.frame).into();
        detection.object = detection.object.map(|object| objects.get(&object).into());
        file.detections.push(detection);
    }
    let mut places: BTreeMap<String, usize> = BTreeMap::new();
    file.objects.iter().enumerate().for_each(|(index, object)| {
        places.insert(object.id.clone(), index);
    });
    for mut object in b.objects {
        object.id = objects.get(&object.id);
        object.views_rejected.iter_mut().for_each(|frame| *frame = frames.get(frame));
        object.view_residuals_px.iter_mut().for_each(|view| view.frame = frames.get(&view.frame));
        if let Some(odd) = object.cross_validation.as_mut().and_then(|checked| checked.suspect_view.as_mut()) {
            *odd = frames.get(odd);
        }
        match places.get(&object.id) {
            None => file.objects.push(object),
            Some(&index) if is_better(&object, &file.objects[index]) => file.objects[index] = object,
            Some(_) => {}
        }
    }
    Ok(Merged { file, renamed_frames, renamed_objects, has_detections })
}

/// Gives the sources of depths and 3D boxes of a map other names: where the scale between the maps was estimated, the scales of a source differ
/// in the two.
fn separate_cue_sources(file: &mut SceneFile) {
    let rename = |source: &mut Option<Box<str>>, default: &str| {
        *source = Some(format!("{PREFIX}{}", source.as_deref().unwrap_or(default)).into());
    };
    for frame in &mut file.frames {
        frame.depth.iter_mut().for_each(|depth| rename(&mut depth.source, "depth_image"));
        frame.point_cloud.iter_mut().for_each(|cloud| rename(&mut cloud.source, "point_cloud"));
    }
    for detection in &mut file.detections {
        detection.cue_sources_mut().for_each(|(cue, source)| rename(source, cue));
    }
    let sources = std::mem::take(&mut file.cue_sources);
    file.cue_sources = sources.into_iter().map(|(name, source)| (format!("{PREFIX}{name}"), source)).collect();
}

/// The ids of objects and those that detections name.
fn ids_of(file: &SceneFile) -> BTreeSet<String> {
    let of_detections = file.detections.iter().filter_map(|detection| detection.object.as_deref());
    file.objects.iter().map(|object| object.id.as_str()).chain(of_detections).map(str::to_owned).collect()
}

/// Whether the center of the one estimate has the smaller variance. Without a covariance it is the truth.
fn is_better(one: &ObjectRecord, other: &ObjectRecord) -> bool {
    let variance =
        |object: &ObjectRecord| object.covariance.as_ref().map_or(0.0, |c| (0..3).map(|k| c.matrix[k][k]).sum::<f64>());
    variance(one) < variance(other)
}

impl Merged {
    /// Pairs of objects of the merged map that lie at one place and have one category, and are not merged: by id.
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_objects`].
    pub fn at_one_place(&self) -> Result<Vec<[String; 2]>, EntryError> {
        let found = self.file.to_map_objects()?;
        let ids = |(i, j): (usize, usize)| [found.ids[i].clone(), found.ids[j].clone()];
        Ok(same_place(&found.objects).into_iter().map(ids).collect())
    }
}

/// Ids of the second file, and what they are in the merged one.
struct Names {
    used: BTreeSet<String>,
    of: BTreeMap<String, String>,
}

impl Names {
    fn new(used: BTreeSet<&str>) -> Self {
        Self { used: used.into_iter().map(str::to_owned).collect(), of: BTreeMap::new() }
    }

    /// A new name for an id.
    fn name(&mut self, id: &str) -> String {
        let mut name = id.to_owned();
        while self.used.contains(&name) {
            name = format!("{PREFIX}{name}");
        }
        self.used.insert(name.clone());
        self.of.insert(id.to_owned(), name.clone());
        name
    }

    fn set(&mut self, id: &str, name: &str) {
        self.of.insert(id.to_owned(), name.to_owned());
    }

    fn keep(&mut self, id: &str) {
        self.set(id, id);
    }

    fn knows(&self, id: &str) -> bool {
        self.of.contains_key(id)
    }

    fn get(&self, id: &str) -> String {
        self.of.get(id).cloned().unwrap_or_else(|| id.to_owned())
    }
}

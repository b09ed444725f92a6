//! Matches images of another program's file with the frames of a scene, by name, number or time.

use std::collections::{BTreeMap, HashMap, HashSet};

use super::files::{DetectedImage, ImageKey, Numbering};
use super::original_names::original_name;
use crate::read::image_names::stem;
use crate::read::time_units::units;
use crate::scene_file::{FrameRecord, SceneFile};

/// How the images of a file are matched to the frames of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MatchBy {
    /// The way below that matches most images; of equal ones the first.
    #[default]
    Auto,
    /// The names of the images (or the ids of the frames). Folders are compared only if names are not unique.
    Name,
    /// The same without the extensions of the names.
    Stem,
    /// Numbers: those in the names of the frames where each has its own, otherwise their places in the scene, from 0.
    Index,
    /// Times in seconds.
    Time,
}

impl MatchBy {
    /// All ways.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Name, Self::Stem, Self::Index, Self::Time];

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Name => "name",
            Self::Stem => "stem",
            Self::Index => "index",
            Self::Time => "time",
        }
    }
}

/// Options of the matching.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatchOptions {
    pub by: MatchBy,
    /// The number that the detections give to the frame number 0 of the scene.
    pub frame_offset: Option<i64>,
    /// Largest difference of times in seconds.
    pub time_tolerance: f64,
    pub numbering: Numbering,
}

/// Which image is which frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Matching {
    pub by: MatchBy,
    /// For each image, the index of its frame; no frame twice.
    pub frame_of_image: Vec<Option<usize>>,
    /// The number that the detections give to frame number 0, if they were matched by number.
    pub frame_offset: Option<i64>,
    /// Assumptions, as text.
    pub note: Option<String>,
}

impl Matching {
    pub(super) fn count(&self) -> usize {
        self.frame_of_image.iter().flatten().count()
    }
}

/// Matches images to frames. Returns an error message if numbers are ambiguous.
pub(super) fn match_frames(
    scene: &SceneFile,
    images: &[DetectedImage],
    options: &MatchOptions,
) -> Result<Matching, String> {
    let ways = match options.by {
        MatchBy::Auto => {
            let any = |has: fn(&ImageKey) -> bool| images.iter().any(|image| has(&image.key));
            let (names, numbers) = (any(|key| key.name.is_some()), any(|key| key.number.is_some()));
            let mut ways = Vec::new();
            ways.extend(names.then_some([MatchBy::Name, MatchBy::Stem]).into_iter().flatten());
            let is_sampled = matches!(options.numbering, Numbering::Sampled { .. });
            ways.extend((numbers || is_sampled).then_some(MatchBy::Index));
            let is_time = |key: &ImageKey| key.time.is_some() || key.name.as_deref().is_some_and(names_time);
            ways.extend(any(is_time).then_some(MatchBy::Time));
            ways
        }
        by => vec![by],
    };
    let mut best: Option<Matching> = None;
    let mut unclear = None;
    for by in ways {
        let matching = match by {
            MatchBy::Name | MatchBy::Stem | MatchBy::Auto => by_name(scene, images, by),
            MatchBy::Time => by_time(scene, images, options.time_tolerance),
            MatchBy::Index => match by_number(scene, images, options) {
                Ok(matching) => matching,
                Err(problem) => {
                    unclear = Some(problem);
                    continue;
                }
            },
        };
        if best.as_ref().is_none_or(|best| matching.count() > best.count()) {
            best = Some(matching);
        }
    }
    match (best, unclear) {
        (Some(best), _) if best.count() > 0 => Ok(best),
        (_, Some(problem)) => Err(problem),
        (best, None) => Ok(best.unwrap_or_default()),
    }
}

/// The folders and the name of a path, from behind.
fn parts(path: &str, by: MatchBy) -> Vec<&str> {
    let mut parts: Vec<&str> = path.rsplit(['/', '\\']).filter(|part| !part.is_empty() && *part != ".").collect();
    if let (Some(last), MatchBy::Stem) = (parts.first_mut(), by) {
        *last = stem(last);
    }
    parts
}

fn by_name(scene: &SceneFile, images: &[DetectedImage], by: MatchBy) -> Matching {
    let mut frames: HashMap<&str, Vec<(usize, Vec<&str>)>> = HashMap::new();
    for (index, frame) in scene.frames.iter().enumerate() {
        for path in [Some(frame.id.as_str()), frame.image.as_deref()].into_iter().flatten() {
            let parts = parts(path, by);
            if let Some(last) = parts.first() {
                frames.entry(last).or_default().push((index, parts));
            }
        }
    }
    let frame_of = |name: &str| {
        let wanted = parts(name, by);
        let candidates = frames.get(wanted.first()?)?;
        let agreement = |found: &[&str]| wanted.iter().zip(found).take_while(|(a, b)| a == b).count();
        let most = candidates.iter().map(|(_, found)| agreement(found)).max()?;
        let mut best = candidates.iter().filter(|(_, found)| agreement(found) == most).map(|(index, _)| *index);
        let frame = best.next()?;
        best.all(|other| other == frame).then_some(frame)
    };
    let (mut taken, mut versions) = (HashSet::new(), 0);
    let mut frame_of_image = Vec::with_capacity(images.len());
    for image in images {
        let name = image.key.name.as_deref();
        let mut frame = name.and_then(frame_of);
        // Annotation tools rename images.
        let mut renamed = false;
        if let (None, Some(original)) = (frame, name.and_then(original_name)) {
            frame = frame_of(&original);
            renamed = true;
        }
        let is_first = frame.is_some_and(|frame| taken.insert(frame));
        versions += usize::from(renamed && frame.is_some() && !is_first);
        frame_of_image.push(frame.filter(|_| is_first));
    }
    let note = (versions > 0).then(|| {
        format!(
            "{versions} images are further versions of a frame's image and have no frame: the first version of each was \
             used; export the data set without augmentation"
        )
    });
    Matching { by, frame_of_image, frame_offset: None, note }
}

/// The number at the end of a name, such as 12 in "left/frame_0012.png".
fn number_in(name: &str) -> Option<i64> {
    let original = original_name(name);
    let stem = parts(original.as_deref().unwrap_or(name), MatchBy::Stem).first().copied()?;
    if stem.contains('.') && stem.parse::<f64>().is_ok() {
        // A time.
        return None;
    }
    let digits = &stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..];
    digits.parse().ok()
}

/// The numbers in the names of the frames, where each has its own.
pub(crate) fn numbers_of_frames(frames: &[FrameRecord]) -> Option<BTreeMap<i64, usize>> {
    let number = |frame: &FrameRecord| frame.image.as_deref().and_then(number_in).or_else(|| number_in(&frame.id));
    let numbers: BTreeMap<i64, usize> =
        frames.iter().enumerate().map(|(index, frame)| Some((number(frame)?, index))).collect::<Option<_>>()?;
    (numbers.len() == frames.len()).then_some(numbers)
}

fn by_number(scene: &SceneFile, images: &[DetectedImage], options: &MatchOptions) -> Result<Matching, String> {
    let number = |image: &DetectedImage| image.key.number.or_else(|| number_in(image.key.name.as_deref()?));
    let mut numbers: Vec<Option<i64>> = images.iter().map(number).collect();
    let in_names = numbers_of_frames(&scene.frames);
    let mut numbering = options.numbering;
    if let Numbering::Sampled { first, step, last } = numbering {
        // The frames may be those that were annotated, or all of the video.
        let highest = in_names.as_ref().and_then(|names| names.keys().next_back().copied());
        let of_video = highest.unwrap_or(scene.frames.len() as i64 - 1) >= last;
        numbering = if of_video { Numbering::OfNames } else { Numbering::From(0) };
        for number in numbers.iter_mut().filter(|_| !of_video) {
            *number = number.map(|number| number - first).filter(|number| number % step == 0).map(|n| n / step);
        }
    }
    let offset = match options.frame_offset {
        Some(offset) => offset,
        None => offset(scene, &numbers, in_names.as_ref(), numbering)?,
    };
    let mut taken = HashSet::new();
    let frame_of = |number: &Option<i64>| {
        let number = number.as_ref()?.checked_sub(offset)?;
        let frame = match &in_names {
            Some(frames) => *frames.get(&number)?,
            None => usize::try_from(number).ok().filter(|&index| index < scene.frames.len())?,
        };
        taken.insert(frame).then_some(frame)
    };
    let frame_of_image: Vec<Option<usize>> = numbers.iter().map(frame_of).collect();
    let example = numbers.iter().zip(&frame_of_image).find_map(|(number, frame)| Some((number.as_ref()?, (*frame)?)));
    let note = example.map(|(number, frame)| {
        let kind = if in_names.is_some() { "the numbers in their names" } else { "their places in the scene" };
        let id = &scene.frames[frame].id;
        format!("frames were matched by {kind}: number {number} of the detections is frame \"{id}\" (frame_offset)")
    });
    Ok(Matching { by: MatchBy::Index, frame_of_image, frame_offset: Some(offset), note })
}

/// The number that the detections give to the frame number 0 of the scene.
fn offset(
    scene: &SceneFile,
    numbers: &[Option<i64>],
    in_names: Option<&BTreeMap<i64, usize>>,
    numbering: Numbering,
) -> Result<i64, String> {
    let found = || numbers.iter().flatten().copied();
    let Some(frames) = in_names else {
        let last = scene.frames.len() as i64;
        return Ok(match numbering {
            Numbering::From(first) => first,
            Numbering::Unknown if found().min() >= Some(1) && found().max() == Some(last) => 1,
            Numbering::Unknown | Numbering::OfNames | Numbering::Sampled { .. } => 0,
        });
    };
    let has_zero = found().any(|number| number == 0);
    let first_frame = frames.keys().next().copied().unwrap_or_default();
    match (numbering, first_frame) {
        (Numbering::OfNames | Numbering::Sampled { .. }, _) => Ok(0),
        (Numbering::From(first), 0 | 1) => Ok(first - first_frame),
        // The numbers are those of the names, or they are counted from 0 as both are.
        (Numbering::From(0), _) => Ok(0),
        (Numbering::Unknown, first_frame) if first_frame != 1 || !has_zero => Ok(0),
        (_, first_frame) => {
            let last_frame = frames.keys().next_back().copied().unwrap_or_default();
            let (lowest, highest) = (found().min().unwrap_or_default(), found().max().unwrap_or_default());
            Err(format!(
                "the detections number their images from {lowest} to {highest}, the names of the frames have the \
                 numbers {first_frame} to {last_frame}, so it is ambiguous which numbers mean the same image; set \
                 --assume frame_offset=N, where N is the number that the detections give to image 0 (0 if the numbers are \
                 the same, 1 if the detections count from 1 and the images from 0, -1 for the reverse)"
            ))
        }
    }
}

/// The number that a name is.
fn time_in(path: &str) -> Option<f64> {
    parts(path, MatchBy::Stem).first()?.parse().ok().filter(|time: &f64| time.is_finite())
}

/// Whether a name is a time: it has digits after a point, or counts from 1970.
fn names_time(path: &str) -> bool {
    time_in(path).is_some_and(|time| time >= 1e9 || time.fract() != 0.0)
}

fn by_time(scene: &SceneFile, images: &[DetectedImage], tolerance: f64) -> Matching {
    let time_of_frame =
        |f: &FrameRecord| f.time.or_else(|| time_in(&f.id)).or_else(|| f.image.as_deref().and_then(time_in));
    let mut times: Vec<(f64, usize)> =
        scene.frames.iter().enumerate().filter_map(|(index, frame)| Some((time_of_frame(frame)?, index))).collect();
    let time_of_image = |image: &DetectedImage| image.key.time.or_else(|| image.key.name.as_deref().and_then(time_in));
    let of_images: Vec<Option<f64>> = images.iter().map(time_of_image).collect();
    let known = (times.iter().map(|(time, _)| *time).collect::<Vec<f64>>(), of_images.iter().flatten().copied());
    let [unit_of_frames, unit] = units(&known.0, &known.1.collect::<Vec<f64>>());
    times.iter_mut().for_each(|(time, _)| *time *= unit_of_frames);
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The nearest frame of each image, then the nearest image of each frame.
    let mut image_of_frame: HashMap<usize, (f64, usize)> = HashMap::new();
    for (image_index, time) in of_images.iter().enumerate() {
        let Some(time) = time.map(|time| time * unit) else { continue };
        let after = times.partition_point(|(t, _)| *t < time);
        let candidates = &times[after.saturating_sub(1)..(after + 1).min(times.len())];
        let nearest = candidates.iter().map(|(t, frame)| ((t - time).abs(), *frame)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((difference, frame)) = nearest.filter(|(difference, _)| *difference <= tolerance) else { continue };
        let known = image_of_frame.entry(frame).or_insert((difference, image_index));
        if difference < known.0 {
            *known = (difference, image_index);
        }
    }
    let mut frame_of_image = vec![None; images.len()];
    for (frame, (_, image)) in image_of_frame {
        frame_of_image[image] = Some(frame);
    }
    let of_other = [("frames", unit_of_frames), ("detections", unit)].into_iter().filter(|(_, unit)| *unit != 1.0);
    let of_other: String =
        of_other.map(|(what, unit)| format!("; the times of the {what} are in {unit:e} s")).collect();
    let note = Some(format!("frames were matched by time, to {tolerance} s (--time-tolerance){of_other}"));
    Matching { by: MatchBy::Time, frame_of_image, frame_offset: None, note }
}

#[cfg(test)]
#[path = "matching_tests.rs"]
mod tests;

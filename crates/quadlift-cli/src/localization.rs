//! Localising one scene: what was chosen, the call of the library, and the result as a scene file.

use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift::scene::{Scene, SourceError};
use quadlift::solve::{BodyKind, CategoryPriors, Estimate, Method, Status};
use quadlift::{Localization, LocalizeError, Options, UsedMeasurements, localize};
use quadlift_io::{SceneFile, builtin_priors, estimates_to_objects, read_priors};
use serde_json::{Map, Value, json};

use crate::args::body_name;
use crate::error::usage;
use crate::output::Output;
use crate::progress::{counting_bar, object_bar};
use crate::segmentation::Problem;

/// Where the priors on categories come from.
#[derive(Debug, Clone, Default)]
pub enum PriorSource {
    /// There are none.
    #[default]
    None,
    /// Those that come with the program, in metres.
    Builtin,
    /// A TOML file.
    File(PathBuf),
}

/// The choices for a localisation.
#[derive(Debug, Default)]
pub struct Settings {
    /// Options of the library.
    pub options: Options,
    /// Where the priors in the options come from.
    pub priors: PriorSource,
}

impl Settings {
    /// Checks the options and reads the priors.
    pub fn new(mut options: Options, priors: PriorSource) -> anyhow::Result<Self> {
        // An empty scene has nothing that the options could fail on, except for the source.
        let without_source = Options { source: None, ..options.clone() };
        if let Err(error) = localize(&Scene::default(), &without_source, &|_, _| {}) {
            return usage(error.to_string());
        }
        options.map.priors = match &priors {
            PriorSource::None => CategoryPriors::default(),
            PriorSource::Builtin => builtin_priors(),
            PriorSource::File(path) => read_priors(path)?,
        };
        Ok(Self { options, priors })
    }

    /// The settings as they are written to the result. The number of threads is not among them: it changes nothing.
    fn to_json(&self) -> Value {
        let o = &self.options;
        let mut json = json!({
            "method": method_name(o.method),
            "source": o.source,
            "observations": observations_name(o.measurements),
            "min_views": o.min_views.max(o.method.fewest_views()),
            "max_occluded": o.max_occluded,
            "max_truncated": o.max_truncated,
            "seed": o.seed,
        });
        if o.method == Method::Map {
            json["body"] = o.map.body.map_or_else(|| "auto".to_owned(), body_name).into();
            json["ground_plane"] = o.map.ground_plane.into();
            json["camera_height"] = o.map.camera_height.into();
            json["pose_noise"] = o.map.pose_noise.map(|p| [p.rotation_sd, p.translation_sd].to_vec()).into();
            json["priors"] = match &self.priors {
                PriorSource::None => Value::Null,
                PriorSource::Builtin => "builtin".into(),
                PriorSource::File(path) => path.display().to_string().into(),
            };
        }
        if o.method == Method::Reg {
            json["lambda"] = o.reg.lambda.into();
        }
        json
    }

    /// The settings in a few words, with the kind of body that was fitted.
    pub fn in_words(&self, fitted: BodyKind) -> String {
        match self.options.method {
            Method::Map => match self.options.map.body {
                Some(body) => format!("map, {}", body_name(body)),
                None => format!("map, {}, chosen", body_name(fitted)),
            },
            Method::Reg => format!("reg, lambda {:e}", self.options.reg.lambda),
            method => method_name(method).to_owned(),
        }
    }

    /// Categories of the scene that have no prior although priors are used.
    pub fn categories_without_prior<'a>(&self, scene: &'a Scene) -> Vec<&'a str> {
        let none = matches!(self.priors, PriorSource::None);
        let unknown = |name: &&str| !none && self.options.map.priors.of(name).is_none();
        scene.categories.iter().map(String::as_str).filter(unknown).collect()
    }
}

/// The name of the used measurements on the command line and in files.
fn observations_name(measurements: UsedMeasurements) -> &'static str {
    match measurements {
        UsedMeasurements::Auto => "auto",
        UsedMeasurements::Box => "box",
        UsedMeasurements::Ellipse => "ellipse",
        UsedMeasurements::BoxAndEllipse => "box+ellipse",
        UsedMeasurements::Mask => "mask",
    }
}

/// The name of a method on the command line and in files.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Map => "map",
        Method::Planes => "planes",
        Method::Lfd => "lfd",
        Method::Pfd => "pfd",
        Method::Reg => "reg",
    }
}

/// Reads the masks of the detections that will be localised, where they are wanted; returns what could not be read, in
/// words. `title` stands before the progress bar.
pub fn read_masks(
    title: &str,
    (path, file): (&Path, &SceneFile),
    scene: &mut Scene,
    options: &Options,
    out: &Output,
) -> anyhow::Result<Vec<String>> {
    if options.measurements != UsedMeasurements::Mask {
        return Ok(Vec::new());
    }
    // An unclear source is for `localize` to tell.
    let source = scene.source_index(options.source.as_deref()).unwrap_or_default();
    if file.detections.iter().all(|detection| detection.mask.is_none()) {
        bail!("no detection has a \"mask\"; `quadlift segment` finds masks in the images");
    }
    let bar = counting_bar(title, "frames with masks", out);
    let problems = file.add_support_lines(path, scene, source, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    // Detections of one label image share its problem.
    let mut told: Vec<Problem> = Vec::new();
    for (index, error) in problems.map_err(|error| error.in_file(path))? {
        let message = error.to_string();
        match told.iter_mut().find(|problem| problem.message == message) {
            Some(problem) => problem.detections.push(index),
            None => told.push(Problem { message, detections: vec![index] }),
        }
    }
    Ok(told.iter().map(|problem| problem.in_words(scene)).collect())
}

/// Refuses a scene that is not in metres, as the built-in priors are.
pub fn check_metres(scene: &Scene) -> anyhow::Result<()> {
    if scene.length_unit.as_deref() == Some("m") {
        return Ok(());
    }
    let unit = match &scene.length_unit {
        Some(unit) => format!("\"{unit}\""),
        None => "not given".to_owned(),
    };
    bail!(
        "the built-in priors are sizes in metres, but the length unit of the scene is {unit}; set \"length_unit\": \"m\" if \
         it is in metres, or give a file of priors in its unit"
    )
}

/// Localises the objects of a scene; `title` stands before the progress bar.
pub fn localize_scene(title: &str, scene: &Scene, settings: &Settings, out: &Output) -> anyhow::Result<Localization> {
    if matches!(settings.priors, PriorSource::Builtin) {
        check_metres(scene)?;
    }
    let bar = object_bar(title, out);
    let result = localize(scene, &settings.options, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let localization = match result {
        Err(error @ LocalizeError::Source(SourceError::Several(_))) => bail!("{error} (--source NAME)"),
        result => result?,
    };
    if localization.estimates.is_empty() {
        match (scene.detections.len(), localization.left_out.without_object) {
            (0, _) => bail!("there is nothing to localise: the scene has no detections"),
            (_, n) => bail!(
                "there is nothing to localise: {n} detections name no object (--associate always finds out which show \
                 the same one)"
            ),
        }
    }
    Ok(localization)
}

/// Number of objects of which a body was found.
pub fn count_localised(estimates: &[Estimate]) -> usize {
    estimates.iter().filter(|estimate| estimate.status == Status::Ok).count()
}

/// The noise levels by name.
pub fn noise_json(localization: &Localization) -> Map<String, Value> {
    localization.noise.iter().map(|(name, level)| ((*name).to_owned(), Value::from(*level))).collect()
}

/// Number of estimates with each status.
pub fn status_counts(estimates: &[Estimate]) -> Map<String, Value> {
    let mut counts = Map::new();
    for estimate in estimates {
        let count = counts.entry(estimate.status.name()).or_insert(json!(0));
        *count = json!(count.as_u64().unwrap_or(0) + 1);
    }
    counts
}

/// The result as a scene file: the scene's cameras and frames, the estimates, and how they were obtained.
pub fn result_file(file: &SceneFile, scene: &Scene, localization: &Localization, settings: &Settings) -> SceneFile {
    let about = json!({
        "program": "quadlift",
        "version": env!("CARGO_PKG_VERSION"),
        "settings": settings.to_json(),
        "body": body_name(localization.body),
        "objects": localization.estimates.len(),
        "localised": count_localised(&localization.estimates),
        "status": status_counts(&localization.estimates),
        "left_out": left_out_json(localization),
        "noise": noise_json(localization),
    });
    file.with_results(estimates_to_objects(scene, localization), about)
}

/// The detections that took no part, by reason.
pub fn left_out_json(localization: &Localization) -> Value {
    let left_out = localization.left_out;
    json!({
        "without_object": left_out.without_object,
        "occluded_or_truncated": left_out.occluded_or_truncated,
        "beyond_lens": left_out.beyond_lens,
    })
}

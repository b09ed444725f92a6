//! Localising one scene: settings, the call of the library, and the result as a scene file.

use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift::scene::{Scene, SourceError};
use quadlift::solve::{BodyKind, CategoryPriors, Method};
use quadlift::{Localization, LocalizeError, LocalizeOptions, MeasurementKind, localize_observed};
use quadlift_io::problems::Problems;
use quadlift_io::scene_file::{DepthsFound, DetectionRecord, fitted_body_name, settings_record};
use quadlift_io::{SceneFile, builtin_priors, read_priors};
use serde_json::Value;

use crate::error::usage;
use crate::output::Output;
use crate::progress::{counting_bar, object_bar, shown_on};
use crate::words::count;

/// Where the priors on categories come from.
#[derive(Debug, Clone, Default)]
pub enum PriorSource {
    /// There are none.
    #[default]
    None,
    /// The built-in priors, in metres.
    Builtin,
    /// A TOML file.
    File(PathBuf),
}

/// The choices for a localisation.
#[derive(Debug, Default)]
pub struct Settings {
    /// LocalizeOptions of the library.
    pub options: LocalizeOptions,
    /// Where the priors in the options come from.
    pub priors: PriorSource,
}

impl Settings {
    /// Checks the options and reads the priors.
    pub fn new(mut options: LocalizeOptions, priors: PriorSource) -> anyhow::Result<Self> {
        if let Err(error) = options.validate() {
            return usage(error.to_string());
        }
        if let Some(map) = options.method.map_options_mut() {
            map.priors = match &priors {
                PriorSource::None => CategoryPriors::default(),
                PriorSource::Builtin => builtin_priors(),
                PriorSource::File(path) => read_priors(path)?,
            };
        }
        Ok(Self { options, priors })
    }

    /// The settings as they are written to the result.
    fn to_json(&self) -> Value {
        let priors = match &self.priors {
            PriorSource::None => None,
            PriorSource::Builtin => Some("builtin".to_owned()),
            PriorSource::File(path) => Some(path.display().to_string()),
        };
        settings_record(&self.options, priors.as_deref())
    }

    /// The settings in a few words, with the kind of body that was fitted.
    pub fn in_words(&self, fitted: Option<BodyKind>) -> String {
        match &self.options.method {
            Method::Map(map) => match map.body {
                Some(body) => format!("method map, body {body}"),
                None => format!("method map, body {} (auto)", fitted_body_name(fitted)),
            },
            Method::Reg(reg) => format!("reg, lambda {:e}", reg.lambda),
            method => method.name().to_owned(),
        }
    }

    /// The priors on categories; none for methods that take none.
    pub fn priors_on_categories(&self) -> CategoryPriors {
        self.options.method.map_options().map(|map| map.priors.clone()).unwrap_or_default()
    }

    /// Categories of the scene that have no prior although priors are used.
    pub fn categories_without_prior<'a>(&self, scene: &'a Scene) -> Vec<&'a str> {
        // Where sizes are learnt, the result says which.
        let learns = self.options.method.map_options().is_some_and(|map| map.learn_sizes);
        let none = learns || matches!(self.priors, PriorSource::None);
        let priors = self.priors_on_categories();
        let unknown = |name: &&str| !none && priors.of(name).is_none();
        scene.categories.iter().map(String::as_str).filter(unknown).collect()
    }
}

/// Reads the masks of the detections to localise, if needed; returns read errors as text. `title` precedes the progress
/// bar.
pub fn read_masks(
    title: &str,
    (path, file): (&Path, &SceneFile),
    scene: &mut Scene,
    options: &LocalizeOptions,
    out: &Output,
) -> anyhow::Result<Vec<String>> {
    if options.measurements != MeasurementKind::Mask {
        return Ok(Vec::new());
    }
    // An ambiguous source is reported by `localize`.
    let source = scene.source_index(options.source.as_deref()).unwrap_or_default();
    let has_lines = |d: &DetectionRecord| d.mask.is_some() || d.outline.is_some() || d.oriented_box.is_some();
    if !file.detections.iter().any(has_lines) {
        bail!("no detection has a \"mask\" or an \"outline\"; `quadlift segment` finds masks in the images");
    }
    let bar = counting_bar(title, "frames with masks", out);
    let problems = file.add_support_lines(path, scene, source, &shown_on(&bar));
    bar.finish_and_clear();
    // Detections of one label image share its problem.
    let mut told = Problems::default();
    for (index, error) in problems.map_err(|error| error.in_file(path))? {
        told.add(error.to_string(), &[index]);
    }
    Ok(told.in_words(scene))
}

/// Reads the depth images of the frames, if the method uses them; returns read errors as text. `title` precedes the progress bar.
pub fn read_depths(
    title: &str,
    (path, file): (&Path, &SceneFile),
    scene: &mut Scene,
    options: &LocalizeOptions,
    out: &Output,
) -> anyhow::Result<Vec<String>> {
    if !file.has_depth_images() || options.method.map_options().is_none() {
        return Ok(Vec::new());
    }
    // An ambiguous source is reported by `localize`.
    let source = scene.source_index(options.source.as_deref()).unwrap_or_default();
    let bar = counting_bar(title, "depth images", out);
    let found = file.add_depths(path, scene, source, &shown_on(&bar));
    bar.finish_and_clear();
    let DepthsFound { detections, without, problems, .. } = found.map_err(|error| error.in_file(path))?;
    out.detail(&format!("depth images: {} with a depth, {without} without", count(detections, "detection")));
    if detections == 0 && without > 0 {
        out.warning(&format!(
            "{title}: no pixel of a detection has a depth in the depth images; expected counts above 0"
        ));
    }
    Ok(problems.iter().map(ToString::to_string).collect())
}

/// Reads the points of the frames, if the method uses them; returns read errors as text. `title` precedes the progress bar.
pub fn read_points(
    title: &str,
    (path, file): (&Path, &SceneFile),
    scene: &mut Scene,
    options: &LocalizeOptions,
    out: &Output,
) -> anyhow::Result<Vec<String>> {
    if !file.has_points_of_frames() || options.method.map_options().is_none() {
        return Ok(Vec::new());
    }
    // An ambiguous source is reported by `localize`.
    let source = scene.source_index(options.source.as_deref()).unwrap_or_default();
    let bar = counting_bar(title, "frames with points", out);
    let found = file.add_depths_of_points(path, scene, source, &shown_on(&bar));
    bar.finish_and_clear();
    let DepthsFound { detections, without, repeated, problems } = found.map_err(|error| error.in_file(path))?;
    out.detail(&format!(
        "points: {} with a depth, {repeated} in other views of their objects, {without} without",
        count(detections, "detection")
    ));
    if detections == 0 && without > 0 && problems.is_empty() {
        out.warning(&format!(
            "{title}: no detection has three points or more; expected some in the boxes (check \"frame\" and \"transform\" of the \
             point clouds)"
        ));
    }
    Ok(problems.iter().map(ToString::to_string).collect())
}

/// Refuses a scene that is not in metres, as the built-in priors are.
pub fn check_metres(scene: &Scene) -> anyhow::Result<()> {
    quadlift_io::priors::check_metres(scene.length_unit.as_deref()).map_err(anyhow::Error::msg)
}

/// Localises the objects of a scene; `title` precedes the progress bar.
pub fn localize_scene(title: &str, scene: &Scene, settings: &Settings, out: &Output) -> anyhow::Result<Localization> {
    if matches!(settings.priors, PriorSource::Builtin) {
        check_metres(scene)?;
    }
    let plausible_sizes = quadlift_io::priors::plausible_sizes(scene.length_unit.as_deref());
    let options = LocalizeOptions { plausible_sizes, ..settings.options.clone() };
    let bar = object_bar(title, out);
    let result = localize_observed(scene, &options, &shown_on(&bar));
    bar.finish_and_clear();
    let localization = match result {
        Err(error @ LocalizeError::Source(SourceError::Several(_))) => bail!("{error} (--source NAME)"),
        result => result?,
    };
    if localization.estimates.is_empty() {
        match (scene.detections.len(), localization.skipped.without_object) {
            (0, _) => bail!("there is nothing to localise: the scene has no detections"),
            (_, n) => bail!(
                "there is nothing to localise: {n} detections have no object id (--associate always associates them)"
            ),
        }
    }
    Ok(localization)
}

/// The result as a scene file: the scene's cameras and frames, the estimates, and how they were obtained.
pub fn result_file(file: &SceneFile, scene: &Scene, localization: &Localization, settings: &Settings) -> SceneFile {
    file.localized(scene, localization, settings.to_json())
}

/// [`result_file`] without the estimates, which [`quadlift_io::scene_file::write_localized_file`] adds one by one.
pub fn result_file_without_objects(
    file: &SceneFile,
    scene: &Scene,
    localization: &Localization,
    settings: &Settings,
) -> SceneFile {
    file.localized_without_objects(scene, localization, settings.to_json())
}

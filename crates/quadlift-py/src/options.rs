//! LocalizeOptions of the localisation, from Python's keywords.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use pyo3::prelude::*;
use quadlift::cross_validation::Extent;
use quadlift::run::RunOptions;
use quadlift::solve::{BodyKind, CategoryPriors, Method, PoseNoise, Sigmas};
use quadlift::{LocalizeOptions, UnknownName};
use quadlift_io::calibration::{CalibrationRecord, ResultAndTruth, calibrate};
use quadlift_io::priors::check_metres;
use quadlift_io::run::{FileOptions, PriorSource};

use crate::error::refuse;
use crate::scene::PyScene;

/// The keywords of `localize`, as Python hands them over. Names are those of the program.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct LocalizeKeywords {
    method: String,
    body: String,
    source: Option<String>,
    observations: String,
    associate: String,
    ids: Option<String>,
    /// "builtin" or a path.
    priors: Option<String>,
    /// The text of a file of priors, in the place of a path.
    priors_text: Option<String>,
    /// Whether sizes of categories are learnt from the scene.
    learn_sizes: bool,
    /// All views (true), a sample (false), none.
    cross_validate: Option<bool>,
    min_views: usize,
    max_occluded: Option<f64>,
    max_truncated: Option<f64>,
    upright: bool,
    ground_plane: bool,
    camera_height: Option<f64>,
    pose_noise: Option<[f64; 2]>,
    refine_poses: Option<String>,
    fixed_extrinsics: bool,
    reg_weight: Option<f64>,
    sigmas: Option<HashMap<String, f64>>,
    accept_inconsistent: bool,
    seed: u64,
    /// Results and their truths.
    calibration: Vec<(Py<PyScene>, Py<PyScene>)>,
}

impl LocalizeKeywords {
    /// Checks the keywords and reads what they name.
    pub fn options(&self) -> PyResult<FileOptions> {
        let mut method: Method = named("method", &self.method)?;
        if method.map_options().is_none() {
            let given = [
                ("priors", self.priors.is_some() || self.priors_text.is_some()),
                ("learn_sizes", self.learn_sizes),
                ("ground_plane", self.ground_plane),
                ("camera_height", self.camera_height.is_some()),
                ("pose_noise", self.pose_noise.is_some()),
                ("refine_poses", self.refine_poses.is_some()),
                ("sigmas", self.sigmas.is_some()),
                ("calibration", !self.calibration.is_empty()),
            ];
            if let Some((name, _)) = given.into_iter().find(|(_, given)| *given) {
                return Err(refuse(format!("{name} is an argument of method=\"map\" only")));
            }
        }
        match (&mut method, self.reg_weight) {
            (Method::Reg(reg), Some(lambda)) => reg.lambda = lambda,
            (_, Some(_)) => return Err(refuse("reg_weight is an argument of method=\"reg\" only")),
            _ => {}
        }
        let body = body(&self.body)?;
        if let Some(map) = method.map_options_mut() {
            map.body = body;
            map.upright = self.upright;
            map.learn_sizes = self.learn_sizes;
            map.ground_plane = self.ground_plane;
            map.camera_height = self.camera_height;
            map.refine_poses = self.refine_poses.as_deref().map(|name| named("refine_poses", name)).transpose()?;
            map.refine_extrinsics = !self.fixed_extrinsics;
            if self.fixed_extrinsics && self.refine_poses.is_none() {
                return Err(refuse("fixed_extrinsics needs refine_poses"));
            }
            let sds = self.pose_noise;
            map.pose_noise = sds.map(|[rotation_sd, translation_sd]| PoseNoise { rotation_sd, translation_sd });
            if let Some(levels) = &self.sigmas {
                let levels = levels.iter().map(|(name, level)| (name.as_str(), *level));
                map.sigmas = Some(Sigmas::new(levels).map_err(|error| refuse(format!("sigmas: {error}")))?);
            }
        } else if body.is_some_and(|body| body != BodyKind::Ellipsoid) {
            return Err(refuse("only the method map fits bodies other than ellipsoids"));
        }
        let mut options = LocalizeOptions {
            method,
            min_views: self.min_views,
            max_occluded: self.max_occluded,
            max_truncated: self.max_truncated,
            measurements: named("observations", &self.observations)?,
            accept_inconsistent: self.accept_inconsistent,
            seed: self.seed,
            ..Default::default()
        };
        options.cross_validation.extent = match self.cross_validate {
            None => Extent::Nothing,
            Some(false) => Extent::Sample,
            Some(true) => Extent::All,
        };
        options.validate().map_err(refuse)?;
        options.source = self.source.clone();
        let ids = self.ids.as_deref().map(|ids| named("ids", ids)).transpose()?;
        let run = RunOptions { localize: options, associate: named("associate", &self.associate)?, ids, fix: false };
        let priors = prior_source(self.priors.as_deref(), self.priors_text.as_deref());
        let options = FileOptions::new(run, priors).map_err(refuse)?;
        Ok(FileOptions { calibration: self.calibration()?, ..options })
    }

    /// As `--calibration` of the program.
    fn calibration(&self) -> PyResult<Option<CalibrationRecord>> {
        if self.calibration.is_empty() {
            return Ok(None);
        }
        let name = |scene: &PyScene, otherwise: &str| match (&*scene.loaded.path, scene.loaded.scene.name.as_str()) {
            (path, _) if !path.as_os_str().is_empty() => path.to_owned(),
            (_, "") => otherwise.into(),
            (_, name) => name.into(),
        };
        let names: Vec<[PathBuf; 2]> = self
            .calibration
            .iter()
            .map(|(result, truth)| [name(result.get(), "result"), name(truth.get(), "truth")])
            .collect();
        let pairs = self.calibration.iter().zip(&names);
        let pairs: Vec<ResultAndTruth> = pairs
            .map(|((result, truth), [of_result, of_truth])| {
                [(&**of_result, &**result.get().loaded.file()), (&**of_truth, &**truth.get().loaded.file())]
            })
            .collect();
        let calibration = calibrate(&pairs).map_err(|error| refuse(format!("calibration: {error}")))?;
        let names: Vec<[&Path; 2]> = names.iter().map(|[result, truth]| [&**result, &**truth]).collect();
        Ok(Some(CalibrationRecord::of(&calibration, &names)))
    }
}

/// Where priors come from: their name or path, or the text of a file.
fn prior_source(name: Option<&str>, text: Option<&str>) -> PriorSource {
    match (name, text) {
        (_, Some(text)) => PriorSource::Text(text.to_owned()),
        (Some("builtin"), None) => PriorSource::Builtin,
        (Some(path), None) => PriorSource::File(path.into()),
        (None, None) => PriorSource::None,
    }
}

/// Priors by their name or path, or from the text of a file, for a scene with this unit of length.
pub fn read_priors(name: Option<&str>, text: Option<&str>, length_unit: Option<&str>) -> PyResult<CategoryPriors> {
    let source = prior_source(name, text);
    if source == PriorSource::Builtin {
        check_metres(length_unit).map_err(refuse)?;
    }
    source.read().map_err(refuse)
}

/// The value of this name; the error names the argument, what was found and what there is.
pub fn choice<T: Copy>(argument: &str, name: &str, values: &[(&str, T)]) -> PyResult<T> {
    if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
        return Ok(*value);
    }
    let known: Vec<String> = values.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    Err(refuse(format!("{argument} is \"{name}\"; expected one of {}", known.join(", "))))
}

/// The choice of this name; the error names the argument, what was found and what there is.
pub fn named<T: FromStr<Err = UnknownName>>(argument: &str, name: &str) -> PyResult<T> {
    name.parse().map_err(|error: UnknownName| {
        let known: Vec<String> = error.expected.iter().map(|name| format!("\"{name}\"")).collect();
        refuse(format!("{argument} is \"{name}\"; expected one of {}", known.join(", ")))
    })
}

/// `auto`, or a kind of body.
fn body(name: &str) -> PyResult<Option<BodyKind>> {
    if name == "auto" {
        return Ok(None);
    }
    let refused = |_| {
        refuse(format!(
            "body is \"{name}\"; expected \"auto\", \"ellipsoid\", \"cuboid\", \"cylinder\" or \"superellipsoid:Q\" with Q from \
             1 (cuboid) to 2 (ellipsoid)"
        ))
    };
    name.parse().map(Some).map_err(refused)
}

//! The options of a localization, from Python's keywords.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use pyo3::prelude::*;
use quadlift::solve::CategoryPriors;
use quadlift_io::correct::{Assumption, RecordCorrection};
use quadlift_io::coverage::{CoverageRecord, coverage};
use quadlift_io::options::{RUN, Spec, Spelling, Value, check_needs_posterior, set_options};
use quadlift_io::priors::check_meters;
use quadlift_io::run::{FileOptions, PriorSource};

use crate::error::refuse;
use crate::scene::PyScene;

/// The value of an option.
#[derive(Debug, Clone, FromPyObject)]
pub(crate) enum Given {
    Flag(bool),
    Whole(u64),
    Number(f64),
    Text(String),
    Numbers(Vec<f64>),
    Levels(HashMap<String, f64>),
}

impl From<Given> for Value {
    fn from(given: Given) -> Self {
        match given {
            Given::Flag(flag) => Self::Flag(flag),
            Given::Whole(n) => Self::Whole(n),
            Given::Number(x) => Self::Number(x),
            Given::Text(text) => Self::Text(text),
            Given::Numbers(numbers) => Self::Numbers(numbers),
            Given::Levels(levels) => {
                let mut levels: Vec<(String, f64)> = levels.into_iter().collect();
                levels.sort_by(|a, b| a.0.cmp(&b.0));
                Self::Levels(levels)
            }
        }
    }
}

/// Options by their names, as Python hands them over.
pub(crate) type Chosen = HashMap<String, Option<Given>>;

/// The options of a table with what was chosen.
pub(crate) fn chosen<O: Default>(rows: &[Spec<O>], chosen: &Chosen) -> PyResult<O> {
    let given: Vec<(&str, Value)> = chosen.iter().map(|(name, value)| (name.as_str(), value.clone().into())).collect();
    let mut options = O::default();
    set_options(rows, &given, &mut options, Spelling::Keyword).map_err(refuse)?;
    Ok(options)
}

/// The keywords of `localize`, as Python hands them over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct LocalizeKeywords {
    /// Those of [`RUN`] that are given.
    run: Chosen,
    /// "builtin" or a path.
    priors: Option<String>,
    /// The text of a file of priors, in the place of a path.
    priors_text: Option<String>,
    /// Results and their truths.
    coverage: Vec<(Py<PyScene>, Py<PyScene>)>,
}

impl LocalizeKeywords {
    /// Checks the keywords and reads what they name.
    pub(crate) fn options(&self) -> PyResult<FileOptions> {
        let run = chosen(RUN, &self.run)?;
        let of_posterior =
            [("priors", self.priors.is_some() || self.priors_text.is_some()), ("coverage", !self.coverage.is_empty())];
        for (name, _) in of_posterior.into_iter().filter(|(_, is_given)| *is_given) {
            check_needs_posterior(&run, name, Spelling::Keyword).map_err(refuse)?;
        }
        let priors = prior_source(self.priors.as_deref(), self.priors_text.as_deref());
        let options = FileOptions::new(run, priors).map_err(refuse)?;
        Ok(FileOptions { coverage: self.coverage()?, ..options })
    }

    /// As `--coverage` of the program.
    fn coverage(&self) -> PyResult<Option<CoverageRecord>> {
        if self.coverage.is_empty() {
            return Ok(None);
        }
        let name = |scene: &PyScene, otherwise: &str| match (&*scene.loaded.path, scene.loaded.scene.name.as_str()) {
            (path, _) if !path.as_os_str().is_empty() => path.to_owned(),
            (_, "") => otherwise.into(),
            (_, name) => name.into(),
        };
        let names: Vec<[PathBuf; 2]> = self
            .coverage
            .iter()
            .map(|(result, truth)| [name(result.get(), "result"), name(truth.get(), "truth")])
            .collect();
        let pairs = self.coverage.iter().zip(&names);
        let pairs: Vec<[(&Path, &quadlift_io::SceneFile); 2]> = pairs
            .map(|((result, truth), [of_result, of_truth])| {
                [(&**of_result, &**result.get().loaded.file()), (&**of_truth, &**truth.get().loaded.file())]
            })
            .collect();
        let found = coverage(&pairs).map_err(|error| refuse(format!("coverage: {error}")))?;
        let names: Vec<[&Path; 2]> = names.iter().map(|[result, truth]| [&**result, &**truth]).collect();
        Ok(Some(CoverageRecord::of(&found, &names)))
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
pub(crate) fn read_priors(
    name: Option<&str>,
    text: Option<&str>,
    length_unit: Option<&str>,
) -> PyResult<CategoryPriors> {
    let source = prior_source(name, text);
    if source == PriorSource::Builtin {
        check_meters(length_unit).map_err(refuse)?;
    }
    source.read().map_err(refuse)
}

/// What inputs really are, as `--assume` has it: `poses=opengl,boxes=xywh`.
pub(crate) fn assumed(text: &str) -> PyResult<Vec<RecordCorrection>> {
    let parts = text.split(',').filter(|part| !part.trim().is_empty());
    let assumptions: Result<Vec<Assumption>, String> = parts.map(str::parse).collect();
    let corrections = assumptions.and_then(|list| Assumption::corrections(&list));
    corrections.map_err(|error| refuse(format!("assume is \"{text}\"; {error}")))
}

/// The value of this name; the error names the argument, what was found and what there is.
pub(crate) fn choice<T: Copy>(argument: &str, name: &str, values: &[(&str, T)]) -> PyResult<T> {
    if let Some((_, value)) = values.iter().find(|(known, _)| *known == name) {
        return Ok(*value);
    }
    let known: Vec<String> = values.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    Err(refuse(format!("{argument} is \"{name}\"; expected one of {}", known.join(", "))))
}

//! Association with Python's keywords.

use pyo3::prelude::*;
use quadlift::association::{AssociateOptions, Association};
use quadlift::run::{RunError, identify};
use quadlift::scene::Scene;
use quadlift_io::association::skipped_in_words;
use quadlift_io::diagnosis::{Context, DiagnosisRecord};
use quadlift_io::options::ASSOCIATION;
use quadlift_io::run::InputError;

use crate::loaded::Loaded;
use crate::options::{Chosen, chosen, read_priors};
use crate::run::Ticker;

/// The keywords of `associate`, as Python hands them over.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct AssociateKeywords {
    /// Those of [`ASSOCIATION`] that are given.
    chosen: Chosen,
    priors: Option<String>,
    priors_text: Option<String>,
}

impl AssociateKeywords {
    /// Checks the keywords for a scene.
    pub(crate) fn for_scene(&self, scene: &Scene) -> PyResult<AssociateOptions> {
        let unit = scene.length_unit.as_deref();
        let priors = read_priors(self.priors.as_deref(), self.priors_text.as_deref(), unit)?;
        Ok(AssociateOptions { priors, ..chosen(ASSOCIATION, &self.chosen)? })
    }
}

/// Checks and associates; the scene with the objects that were found, or the reason why there are none.
pub(crate) fn associated(
    loaded: &Loaded,
    options: &AssociateOptions,
    ticker: &Ticker,
) -> Result<(Scene, Association), String> {
    let mut input = loaded.input();
    let found = identify(&mut input, options, false, ticker);
    let (_, association) = found.map_err(|error| in_words(&error, &input.context))?;
    let source = input.scene().source_index(options.source.as_deref()).map_err(|error| error.to_string())?;
    Ok((association.applied_to(input.scene(), source), association))
}

/// Why a run failed.
pub(crate) fn in_words(error: &RunError<InputError>, context: &Context) -> String {
    let RunError::NothingFound { skipped, check, .. } = error else { return error.to_string() };
    let why = DiagnosisRecord::of(check, context).in_words().map_or(String::new(), |why| format!(": {why}"));
    format!("{error}{}{why}", skipped_in_words(*skipped))
}

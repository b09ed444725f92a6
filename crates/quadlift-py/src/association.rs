//! Association with Python's keywords.

use pyo3::prelude::*;
use quadlift::associate_observed;
use quadlift::association::{AssociateOptions, Association, Outcome};
use quadlift::diagnosis::diagnose_association;
use quadlift::scene::Scene;
use quadlift_io::association::skipped_in_words;
use quadlift_io::diagnosis::{Context, diagnosis_in_words};

use crate::error::refuse;
use crate::options::{IDS, choice, read_priors};
use crate::run::Ticker;

/// The keywords of `associate`, as Python hands them over. Names are those of the program.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct AssociateKeywords {
    ids: String,
    source: Option<String>,
    thorough: bool,
    min_views: usize,
    min_score: Option<f64>,
    max_overlap: Option<f64>,
    pixel_sd: Option<f64>,
    priors: Option<String>,
    priors_text: Option<String>,
}

impl AssociateKeywords {
    /// Checks the keywords for a scene.
    pub fn for_scene(self, scene: &Scene) -> PyResult<AssociateOptions> {
        let unit = scene.length_unit.as_deref();
        let (priors, _) = read_priors(self.priors.as_deref(), self.priors_text.as_deref(), unit)?;
        let options = AssociateOptions {
            ids: choice("ids", &self.ids, &IDS)?,
            thorough: self.thorough,
            min_views: self.min_views,
            min_score: self.min_score,
            max_overlap: self.max_overlap,
            pixel_sd: self.pixel_sd,
            priors,
            ..Default::default()
        };
        options.validate().map_err(refuse)?;
        Ok(AssociateOptions { source: self.source, ..options })
    }
}

/// Associates; returns an error with the reason if nothing is found.
pub fn associated(scene: &Scene, options: &AssociateOptions, ticker: &Ticker) -> Result<Association, String> {
    let association = associate_observed(scene, options, ticker).map_err(|error| error.to_string())?;
    match association.outcome {
        Outcome::Found => Ok(association),
        Outcome::NothingAgrees => {
            let diagnosis = diagnose_association(scene, &association, options).unwrap_or_default();
            let why = diagnosis_in_words(&diagnosis, &Context::default());
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            let skipped = skipped_in_words(association.skipped);
            Err(format!("no object was found: {}{skipped}{why}", Outcome::NothingAgrees.text()))
        }
        outcome => Err(format!("no object was found: {}{}", outcome.text(), skipped_in_words(association.skipped))),
    }
}

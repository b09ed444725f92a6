//! Options of a run on files: those of the library, and what files say beside them.

use std::path::PathBuf;

use quadlift::run::RunOptions;
use quadlift::scene::Scene;
use quadlift::solve::CategoryPriors;
use serde_json::{Map, Value};

use crate::coverage::CoverageRecord;
use crate::error::ReadError;
use crate::options::{RUN, value_record};
use crate::priors::{builtin_priors, check_meters, parse_priors, plausible_sizes, read_priors};

/// Where the priors on categories come from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum PriorSource {
    /// There are none.
    #[default]
    None,
    /// The built-in priors, in meters.
    Builtin,
    /// A TOML file.
    File(PathBuf),
    /// The text of such a file.
    Text(String),
}

impl PriorSource {
    /// Reads the priors.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not as expected.
    pub fn read(&self) -> Result<CategoryPriors, ReadError> {
        match self {
            Self::None => Ok(CategoryPriors::default()),
            Self::Builtin => Ok(builtin_priors()),
            Self::File(path) => read_priors(path),
            Self::Text(text) => parse_priors("priors".as_ref(), text),
        }
    }

    /// The source as results name it.
    pub fn name(&self) -> Option<String> {
        match self {
            Self::None => None,
            Self::Builtin => Some("builtin".to_owned()),
            Self::File(path) => Some(path.display().to_string()),
            Self::Text(_) => Some("given".to_owned()),
        }
    }
}

/// Options of [`super::run_file`].
#[derive(Debug, Clone, Default)]
pub struct FileOptions {
    /// The options of the library, with the priors that were read.
    pub run: RunOptions,
    /// Where these priors come from.
    pub priors: PriorSource,
    /// How regions are calibrated: what the result says about it.
    pub coverage: Option<CoverageRecord>,
}

impl FileOptions {
    /// Reads the priors of a source into the options.
    ///
    /// # Errors
    /// As [`PriorSource::read`].
    pub fn new(mut run: RunOptions, priors: PriorSource) -> Result<Self, ReadError> {
        if let Some(map) = run.localize.method.posterior_options_mut() {
            map.priors = priors.read()?;
        }
        Ok(Self { run, priors, coverage: None })
    }

    /// The options of the library for a scene: what they mean depends on its unit of length.
    ///
    /// # Errors
    /// The built-in priors are in meters, and the scene is not.
    pub(super) fn for_scene(&self, scene: &Scene) -> Result<RunOptions, String> {
        let unit = scene.length_unit.as_deref();
        if self.priors == PriorSource::Builtin {
            check_meters(unit)?;
        }
        let mut options = self.run.clone();
        options.localize.plausible_sizes = plausible_sizes(unit);
        Ok(options)
    }

    /// The settings as they are written to the result: all options of a run that its method takes, by their names, and the source
    /// of the priors. The number of threads is not included, because it does not affect the result.
    pub(crate) fn settings(&self) -> Value {
        let method = &self.run.localize.method;
        let rows = RUN.iter().filter(|row| row.only.is_none_or(|(_, needed)| needed == method.name()));
        let mut settings: Map<String, Value> =
            rows.map(|row| (row.name.to_owned(), value_record((row.get)(&self.run)))).collect();
        if method.posterior_options().is_some() {
            settings.insert("priors".to_owned(), self.priors.name().into());
        }
        settings.into()
    }

    /// The priors on categories; none for methods that take none.
    pub fn category_priors(&self) -> CategoryPriors {
        self.run.localize.method.posterior_options().map(|map| map.priors.clone()).unwrap_or_default()
    }

    /// Categories of the scene that have no prior although priors are used.
    pub fn categories_without_prior<'a>(&self, scene: &'a Scene) -> Vec<&'a str> {
        let map = self.run.localize.method.posterior_options();
        let Some(map) = map.filter(|map| !map.learn_sizes && self.priors != PriorSource::None) else {
            // Where sizes are learned, the result lists them.
            return Vec::new();
        };
        let unknown = |name: &&str| map.priors.of(name).is_none();
        scene.categories.iter().map(String::as_str).filter(unknown).collect()
    }
}

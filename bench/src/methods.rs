//! The rows of every table: methods with their bodies and priors. All settings of an experiment are in its file, made
//! with the functions here.

use quadlift::LocalizeOptions;
use quadlift::metrics::ObjectScore;
use quadlift::solve::{Method, PosteriorOptions, RegOptions};
use rayon::prelude::*;

use crate::data::TrueScene;
use crate::error::Error;
use crate::progress::Steps;

/// Weight of the regularizer of `reg`, the same in every experiment (the paper keeps one for all of its tests). How it
/// was chosen is shown by the last table but one of [`crate::Experiment::Synthetic`].
pub const REG_LAMBDA: f64 = 1e13;

/// A row: a method with its settings.
#[derive(Debug, Clone)]
pub struct MethodRow {
    /// The method's name.
    pub method: &'static str,
    /// Body, priors and other settings, as text.
    pub setting: String,
    /// The same for the program.
    pub options: LocalizeOptions,
}

impl MethodRow {
    /// A method without settings.
    pub fn closed_form(method: Method) -> Self {
        Self { method: method.name(), setting: "ellipsoid".to_owned(), options: LocalizeOptions::from(method) }
    }

    /// `posterior` with these options, described by `setting`.
    pub fn posterior(setting: &str, map: PosteriorOptions) -> Self {
        Self { method: "posterior", setting: setting.to_owned(), options: LocalizeOptions::from(map) }
    }

    /// The row's name in one line: "posterior, cuboid, car prior".
    pub fn name(&self) -> String {
        format!("{}, {}", self.method, self.setting)
    }
}

/// The paper's regularized estimator with the weight of its figures.
pub fn reg() -> Method {
    Method::Reg(RegOptions { lambda: REG_LAMBDA })
}

/// The methods without settings: `pfd`, `reg`, `lfd`, `planes`.
pub fn closed_forms() -> Vec<MethodRow> {
    [Method::Pfd, reg(), Method::Lfd, Method::Planes].map(MethodRow::closed_form).to_vec()
}

/// The scores of one row on several sequences.
#[derive(Debug, Clone)]
pub struct RowScores {
    /// The row.
    pub row: MethodRow,
    /// For each sequence, the scores of its objects.
    pub sequences: Vec<Vec<ObjectScore>>,
}

/// Runs every row on every scene, in parallel; `protocol` completes the options (source, limits on occlusion, seed).
///
/// # Errors
/// [`Error`] of the first scene that fails.
pub fn run_rows(
    rows: &[MethodRow],
    scenes: &[TrueScene],
    protocol: &(dyn Fn(&mut LocalizeOptions) + Sync),
    steps: &Steps,
) -> Result<Vec<RowScores>, Error> {
    let run = |row: &MethodRow, scene: &TrueScene| {
        let mut options = row.options.clone();
        protocol(&mut options);
        let scores = scene.scores(&options);
        steps.done();
        scores
    };
    let scores = |row: &MethodRow| -> Result<RowScores, Error> {
        let sequences = scenes.par_iter().map(|scene| run(row, scene)).collect::<Result<_, _>>()?;
        Ok(RowScores { row: row.clone(), sequences })
    };
    rows.par_iter().map(scores).collect()
}

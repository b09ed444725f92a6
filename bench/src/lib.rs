//! The experiments of *3D Pose from Detections* (section 5), compared with the paper's figures, and our own, compared
//! with a prototype: one file or folder each.
//!
//! [`run`] returns a [`Report`] with text, tables and plots. Nothing here is tuned on the truth used for scoring; all
//! settings of an experiment are in the `rows` of its file.
#![forbid(unsafe_code)]

mod accv;
mod association;
mod cameras;
pub mod compare;
mod cross_validation;
mod cues;
pub mod data;
pub mod diagnosis;
mod error;
mod false_boxes;
mod few_views;
pub mod held_out;
mod html;
mod kinds;
mod kitti;
pub mod methods;
mod minimal;
mod noise_curves;
mod online;
pub mod paper;
pub mod plot;
mod processor_time;
mod progress;
mod reg_weight;
pub mod render;
mod report;
pub mod scores;
pub mod segmentation;
#[cfg(feature = "sensitivity")]
mod sensitivity;
pub mod sequences;
mod stability;
mod synthetic;
pub mod table;
pub mod trust;
mod tuw;
pub mod verdicts;
mod wide_views;

pub use error::Error;
pub use html::html_page;
pub use progress::{Progress, Run, Steps};
pub use report::{Block, CONVENTIONS, Headline, Report, page, summary};

/// An experiment of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Experiment {
    /// Section 5.1: noise of ellipses, and of boxes.
    Synthetic,
    /// Section 5.2: one object on a table, 100 views.
    Accv,
    /// Section 5.3: several objects on a table, few views.
    Tuw,
    /// Section 5.4: parked cars from a moving car.
    Kitti,
    /// Section 5.5: two and three views.
    Minimal,
    /// Section 4.2: masks and ellipses from images, and bodies from them.
    Segmentation,
    /// Objects from detections without ids; not in the paper.
    Association,
    /// How well left-out views predict the quality of estimates; not in the paper.
    CrossValidation,
    /// Coverage of the confidence regions of estimates; not in the paper.
    Trust,
    /// The same with a quarter of the synthetic objects: the part of [`Experiment::ALL`].
    TrustBrief,
    /// The consistency check on right scenes and on mistakes; not in the paper.
    Diagnosis,
    /// Scenes with bodies of several kinds; not in the paper.
    Kinds,
    /// The default compared with a given noise level and a closed form, with 2 to 20 views; not in the paper.
    FewViews,
    /// The object map frame by frame, beside batch; not in the paper, and not in [`Experiment::ALL`].
    Online,
    /// Depths and 3D boxes of single images beside boxes; not in the paper, and not in [`Experiment::ALL`].
    Cues,
    /// Images located in maps of objects; not in the paper, and not in [`Experiment::ALL`].
    Cameras,
    /// Which answers change when the input changes by nothing that matters; not in the paper, and not in [`Experiment::ALL`].
    Stability,
    /// What each command says about mistakes of its input, and about right scenes; not in the paper, and not in [`Experiment::ALL`].
    Verdicts(verdicts::Extent),
    /// Tuned constants, halved and doubled (with the feature `sensitivity`); not in the paper, and not in [`Experiment::ALL`].
    #[cfg(feature = "sensitivity")]
    Sensitivity,
}

impl Experiment {
    /// All experiments, in the order of the paper; then what it describes without figures of its own, and what is ours.
    pub const ALL: [Self; 12] = [
        Self::Synthetic,
        Self::Accv,
        Self::Tuw,
        Self::Kitti,
        Self::Minimal,
        Self::Segmentation,
        Self::Association,
        Self::CrossValidation,
        Self::TrustBrief,
        Self::Diagnosis,
        Self::Kinds,
        Self::FewViews,
    ];

    /// The name of the command and of the files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Synthetic => "synthetic",
            Self::Accv => "accv",
            Self::Tuw => "tuw",
            Self::Kitti => "kitti",
            Self::Minimal => "minimal",
            Self::Segmentation => "segmentation",
            Self::Association => "association",
            Self::CrossValidation => "cross-validation",
            Self::Trust | Self::TrustBrief => "trust",
            Self::Diagnosis => "diagnosis",
            Self::Kinds => "kinds",
            Self::FewViews => "few-views",
            Self::Online => "online",
            Self::Cues => "cues",
            Self::Cameras => "cameras",
            Self::Stability => "stability",
            Self::Verdicts(_) => "verdicts",
            #[cfg(feature = "sensitivity")]
            Self::Sensitivity => "sensitivity",
        }
    }

    /// Whether it needs the real data.
    pub fn needs_data(self) -> bool {
        matches!(self, Self::Accv | Self::Tuw | Self::Kitti | Self::Minimal | Self::CrossValidation)
    }
}

/// Runs an experiment. `synthetic`, `kinds` and `few-views` need no real data; `segmentation`, `association`, `trust` and
/// `diagnosis` show less without.
///
/// # Errors
/// [`Error`]: no data, a file that is wrong.
pub fn run(experiment: Experiment, run: &Run) -> Result<Report, Error> {
    let data = run.data;
    let folder = || data::data_folder(data);
    match experiment {
        Experiment::Synthetic => synthetic::run(run),
        Experiment::Accv => accv::run(&folder()?, run),
        Experiment::Tuw => tuw::run(&folder()?, run),
        Experiment::Kitti => kitti::run(&folder()?, run),
        Experiment::Minimal => minimal::run(&folder()?, run),
        Experiment::Segmentation => segmentation::run(data, run),
        Experiment::Association => association::run(data, run),
        Experiment::CrossValidation => cross_validation::run(&folder()?, run),
        Experiment::Trust => trust::run(data, 20, run),
        Experiment::TrustBrief => trust::run(data, 5, run),
        Experiment::Diagnosis => diagnosis::run(data, run),
        Experiment::Kinds => kinds::run(run),
        Experiment::FewViews => few_views::run(run),
        Experiment::Online => online::run(data, run),
        Experiment::Cues => cues::run(data, run),
        Experiment::Cameras => cameras::run(data, run),
        Experiment::Stability => stability::run(data, run),
        Experiment::Verdicts(extent) => verdicts::run(extent, run),
        #[cfg(feature = "sensitivity")]
        Experiment::Sensitivity => sensitivity::run(data, run),
    }
}

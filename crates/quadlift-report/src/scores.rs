//! Scores of estimates, as reports show them.

use quadlift::metrics::{Evaluation, ObjectScore};
use quadlift_io::evaluation::{COLUMNS, Unit, failures_in_words};

use crate::data::ScoreColumn;

/// Scores of estimates, which also say which estimate and which true object are the same.
#[derive(Debug, Clone, Default)]
pub struct Scores {
    /// What is scored.
    pub columns: Vec<ScoreColumn>,
    /// One row for each true object.
    pub rows: Vec<TrueObjectScores>,
    /// Means over the objects.
    pub mean: Vec<Option<f64>>,
    /// How many objects failed, in a sentence.
    pub failures: String,
}

/// Scores of one true object.
#[derive(Debug, Clone, Default)]
pub struct TrueObjectScores {
    /// Id of the true object.
    pub id: String,
    /// Id of the paired estimate; absent if there is none.
    pub estimate: Option<String>,
    /// Status of that estimate.
    pub status: Option<String>,
    /// One value for each column.
    pub values: Vec<Option<f64>>,
}

impl Scores {
    /// Those of an evaluation.
    pub fn of(evaluation: &Evaluation) -> Self {
        let unit = |unit: Unit| match unit {
            Unit::Share => "share",
            Unit::Percent => "percent",
            Unit::Degrees => "degrees",
            Unit::Length => "length",
        };
        let row = |o: &ObjectScore| TrueObjectScores {
            id: o.id.clone(),
            estimate: o.estimate.clone(),
            status: o.status.clone(),
            values: COLUMNS.iter().map(|column| (column.of)(o)).collect(),
        };
        Self {
            columns: (COLUMNS.iter())
                .map(|column| ScoreColumn { title: column.title.to_owned(), unit: unit(column.unit) })
                .collect(),
            rows: evaluation.objects.iter().map(row).collect(),
            mean: COLUMNS.iter().map(|column| (column.mean)(&evaluation.mean).map(|mean| mean.value)).collect(),
            failures: failures_in_words(evaluation),
        }
    }
}

//! Scores of estimates against the truth, for people.

use std::fmt::Write;

use quadlift::metrics::{Evaluation, ObjectDetectionScore, PairedBy};
use quadlift::solve::Status;
use quadlift_io::evaluation::identities::{Division, DivisionOutcome};
use quadlift_io::evaluation::{COLUMNS, Column, MIN_IOU, Matching, Unit, failures_in_words};
use quadlift_report::Labels;

use crate::output::{BAD, GOOD, HEADING, WARNING, one_line};
use crate::table::{Cell, MAX_ROWS, Table, decimals, number, rest};
use crate::words::{count, some_of, with_unit};

/// How estimates and true objects are paired, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Match {
    /// By ids if any are shared, otherwise by overlap.
    #[default]
    Auto,
    /// By their ids.
    Ids,
    /// By the overlap of their bodies.
    Overlap,
}

impl From<Match> for Matching {
    fn from(matching: Match) -> Self {
        match matching {
            Match::Auto => Self::Auto,
            Match::Ids => Self::Ids,
            Match::Overlap => Self::Overlap,
        }
    }
}

/// The scores for people, with the labels of estimates and true objects; columns that no object has are left out.
pub(crate) fn render(evaluation: &Evaluation, [estimates, truth]: [&Labels; 2], length_unit: Option<&str>) -> String {
    let columns: Vec<&Column> =
        COLUMNS.iter().filter(|c| evaluation.objects.iter().any(|o| (c.of)(o).is_some())).collect();
    let by_overlap = evaluation.paired_by == PairedBy::Overlap;
    let mut titles = ["<object", "<estimate", "<status"].map(str::to_owned).to_vec();
    titles.extend(columns.iter().map(|column| match column.unit {
        Unit::Length => with_unit(column.title, length_unit),
        _ => column.title.to_owned(),
    }));
    let mut table = Table::new(titles);
    let error = evaluation.mean.center_error.map_or(1.0, |mean| mean.value);
    let show = |column: &Column, value: Option<f64>| match column.unit {
        Unit::Share => number(value, 3),
        Unit::Percent => number(value.map(|x| 100.0 * x), 1),
        Unit::Degrees => number(value.map(f64::to_degrees), 1),
        Unit::Length => number(value, decimals(error, 3)),
    };
    for object in evaluation.objects.iter().take(MAX_ROWS) {
        let status = match object.status.as_deref() {
            None => Cell::styled("missing", BAD),
            Some(status) if object.has_body && status == Status::Ok.name() => Cell::styled(status, GOOD),
            Some(status) => Cell::styled(status, BAD),
        };
        let scores = columns.iter().map(|column| show(column, (column.of)(object)).into());
        // Where ids pair them it is the same one.
        let estimate = object.estimate.as_deref().filter(|_| by_overlap).unwrap_or_default();
        let names = [truth.of(&object.id).into(), estimates.of(estimate).into(), status];
        table.push(names.into_iter().chain(scores).collect());
    }
    let means = columns
        .iter()
        .map(|column| Cell::styled(show(column, (column.mean)(&evaluation.mean).map(|mean| mean.value)), HEADING));
    let mean = [Cell::styled("mean", HEADING), Cell::default(), Cell::default()];
    table.push(mean.into_iter().chain(means).collect());
    let mut text = table.render() + &rest(evaluation.objects.len(), "object", "--json lists all");
    let _ = writeln!(text, "{}", failures_in_words(evaluation));
    if !evaluation.unmatched.is_empty() {
        let _ = writeln!(
            text,
            "{WARNING}note:{WARNING:#} estimates {}: {}",
            if by_overlap { "not paired with any true object" } else { "whose id no true object has" },
            one_line(&some_of(&estimates.of_all(&evaluation.unmatched)))
        );
    }
    text
}

/// The number of found objects, as text.
pub(crate) fn render_found(found: &ObjectDetectionScore) -> String {
    format!(
        "{HEADING}found{HEADING:#}: {} of {} (IoU of at least {MIN_IOU}, ignoring ids); {} of {} are correct\n",
        found.matched,
        count(found.true_objects, "true object"),
        found.matched,
        count(found.found, "ok estimate"),
    )
}

/// Why the association was not scored, if this should be reported.
pub(crate) fn why_no_identities(outcome: &DivisionOutcome) -> Option<String> {
    match outcome {
        DivisionOutcome::Absent | DivisionOutcome::Scored(_) => None,
        DivisionOutcome::SeveralSources(why) => Some(format!("{why}: --source SOURCE selects the detections to score")),
        DivisionOutcome::NoneCommon(why) => Some(why.clone()),
    }
}

/// The scores of the association, as text; empty if there are none.
pub(crate) fn render_identities(outcome: &DivisionOutcome) -> String {
    let DivisionOutcome::Scored(Division { score, compared, only_in_estimate, only_in_truth }) = outcome else {
        let note = |why: String| format!("{WARNING}note:{WARNING:#} {}\n", one_line(&why));
        return why_no_identities(outcome).map_or_else(String::new, note);
    };
    let mut text = format!(
        "{HEADING}identities{HEADING:#}: pairs of detections: precision {:.3}, recall {:.3}, F1 {:.3}; adjusted Rand \
         index {:.3}; {}\n",
        score.precision,
        score.recall,
        score.f1,
        score.adjusted_rand_index,
        count(score.duplicates, "duplicate object"),
    );
    if only_in_estimate + only_in_truth > 0 {
        let _ = writeln!(
            text,
            "{WARNING}note:{WARNING:#} {} are in both files; {only_in_estimate} only in the estimate, {only_in_truth} \
             only in the truth",
            count(*compared, "detection"),
        );
    }
    text
}

//! Association: objects from detections without ids (ours), compared with our numpy prototype.

pub(crate) mod case;
pub(crate) mod driving;
mod parts;
pub(crate) mod synthetic;
pub(crate) mod without_ids;

use std::path::Path;

use self::case::CaseScore;
use crate::data::data_folder;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::scores::{Figure, mean};

/// A target: the headline and its minimum.
#[derive(Debug, Clone, Copy)]
struct Aim {
    id: &'static str,
    least: f64,
}

/// Runs the experiment. Without real data the synthetic scenes remain, unless `data` names a folder that has none.
///
/// # Errors
/// [`Error::NoData`], [`Error::Read`], [`Error::Synthetic`], [`Error::Associate`], [`Error::Localize`].
pub(crate) fn run(data: Option<&Path>, run: &Run) -> Result<Report, Error> {
    let folder = match data_folder(data) {
        Ok(folder) => Some(folder),
        Err(error) if data.is_some() => return Err(error),
        Err(_) => None,
    };
    let real_steps = folder.as_ref().map_or(0, |_| without_ids::steps() + driving::steps());
    let all_steps = synthetic::steps(run) + real_steps + parts::steps(folder.is_some());
    let steps = Steps::new("association", all_steps, run.progress);
    let mut report = Report::new("association", "Association: objects from detections without ids");
    report.text(
        "The ids of the detections are taken away, or made wrong, and the detections are associated again. F1 is the \
         harmonic mean of precision and recall over pairs of detections of true objects. An object is found if the \
         body fitted by the association has a volume IoU of at least 0.25 with a true one; true objects count if they \
         are detected at least three times. O3D is the mean over them after `localize` (ellipsoids, no priors), 0 for \
         missing objects. The columns \"prototype\" hold the figures of our numpy prototype, \"aim\" the targets set \
         before the program was written.",
    );
    synthetic::add(&mut report, run, &steps)?;
    match &folder {
        Some(folder) => {
            without_ids::add(folder, &mut report, &steps)?;
            driving::add(folder, &mut report, &steps)?;
        }
        None => report.text("The real data is not available: only synthetic scenes are shown."),
    }
    parts::add(folder.as_deref(), &mut report, run, &steps)?;
    Ok(report)
}

/// The mean over some scores of what they have.
fn mean_of(scores: &[CaseScore], of: impl Fn(&CaseScore) -> Option<f64>) -> Option<f64> {
    mean(&scores.iter().filter_map(of).collect::<Vec<_>>())
}

fn headline(id: &'static str, what: String, value: Option<f64>, row: &str) -> Option<Headline> {
    let ours = Figure { value: value?, standard_error: None };
    Some(Headline { id, what, paper: None, ours, row: row.to_owned(), decimals: 3 })
}

//! The consistency check in the program: its words and its exit code.

use quadlift::association::Outcome as AssociationOutcome;
use quadlift::run::Check;
use quadlift_io::diagnosis::{Context, DiagnosisRecord};

use crate::error::{InconsistentError, Outcome};
use crate::output::Output;

/// The error of a scene in which association finds nothing; `skipped` describes skipped detections.
pub(crate) fn nothing_agrees(check: &Check, context: &Context, skipped: &str) -> InconsistentError {
    let record = DiagnosisRecord::of(check, context);
    let why = record
        .in_words()
        .unwrap_or_else(|| "no common mistake explains it; see \"When it does not work\" in the manual".to_owned());
    let found = AssociationOutcome::NothingAgrees.text();
    InconsistentError {
        text: format!("no object was found: {found}{skipped}: {why}"),
        diagnosis: DiagnosisRecord { consistent: false, ..record },
    }
}

/// Reports the problem of a scene and returns the outcome of the finished command. `accepted`: the user accepts an
/// inconsistent scene.
pub(crate) fn tell(check: &Check, context: &Context, accepted: bool, title: &str, out: &Output) -> Outcome {
    if let (Some(given), Some(refined)) = (check.before_refinement, check.diagnosis.agreement) {
        out.warning(&format!(
            "{title}: the poses as given contradict the boxes, which miss their object by {:.0} % of their half size; refined poses: {:.0} %",
            100.0 * given.miss,
            100.0 * refined.miss
        ));
    }
    let record = DiagnosisRecord::of(check, context);
    tell_words((record.in_words(), record.consistent), accepted, title, out)
}

/// Reports the problem of the map of a stream, which has no options to correct its input, and returns the outcome.
pub(crate) fn tell_of_map(check: &Check, title: &str, out: &Output) -> Outcome {
    let record = DiagnosisRecord::of(check, &Context::default());
    tell_words((record.of_map_in_words(), record.consistent), false, title, out)
}

fn tell_words((words, consistent): (Option<String>, bool), accepted: bool, title: &str, out: &Output) -> Outcome {
    match words {
        Some(words) if !consistent && !accepted => {
            out.error(&format!("{title}: the scene is inconsistent: {words}"));
            Outcome::Inconsistent
        }
        Some(words) if !consistent => {
            out.warning(&format!("{title}: the scene is inconsistent: {words}"));
            Outcome::Fine
        }
        Some(words) => {
            out.warning(&format!("{title}: possible mistake: {words}"));
            Outcome::Fine
        }
        None => Outcome::Fine,
    }
}

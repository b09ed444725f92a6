//! Scores of estimates against the truth, for Python.

use std::path::Path;

use quadlift_io::SceneFile;
use quadlift_io::evaluation::identities::{self, DivisionOutcome};
use quadlift_io::evaluation::{EvaluateError, Matching, evaluate_objects, found_record, scores_record};
use serde_json::{Value, json};

/// Names of `match`.
pub(crate) const MATCHING: [(&str, Matching); 3] =
    [("auto", Matching::Auto), ("ids", Matching::Ids), ("overlap", Matching::Overlap)];

/// Scores the objects of `estimate` against those of `truth`, and the association, if both files have the data: the
/// fields of Python's `Evaluation`.
pub(crate) fn scores(
    estimate: &SceneFile,
    truth: &SceneFile,
    matching: Matching,
    source: Option<&str>,
) -> Result<Value, String> {
    let has_objects = !(estimate.objects.is_empty() || truth.objects.is_empty());
    let (estimate, truth) = ((Path::new("the estimate"), estimate), (Path::new("the truth"), truth));
    let division = identities::score(estimate, truth, source).map_err(|error| error.to_string())?;
    let why = match &division {
        DivisionOutcome::Absent | DivisionOutcome::Scored(_) => None,
        DivisionOutcome::SeveralSources(why) => Some(format!("{why}: source=... selects the detections to score")),
        DivisionOutcome::NoneCommon(why) => Some(why.clone()),
    };
    if let Some(why) = &why
        && !has_objects
    {
        return Err(why.clone());
    }
    let mut document = json!({
        "objects": [], "mean": {}, "failures": 0, "unmatched": [], "matched_by": null, "found": null,
    });
    if has_objects || division == DivisionOutcome::Absent {
        let (scores, found) = evaluate_objects(estimate, truth, matching).map_err(|error| match error {
            EvaluateError::NoCommonId(why) => format!("{why} (match=\"overlap\" pairs them by their bodies)"),
            error => error.to_string(),
        })?;
        let record = scores_record(&scores);
        for name in ["objects", "failures", "unmatched", "matched_by"] {
            document[name] = record[name].clone();
        }
        for (name, mean) in record["mean"].as_object().into_iter().flatten() {
            document["mean"][name] = mean["value"].clone();
        }
        document["found"] = found_record(&found);
    }
    document["identities"] = division.to_record();
    document["notes"] = json!(why.into_iter().collect::<Vec<_>>());
    Ok(document)
}

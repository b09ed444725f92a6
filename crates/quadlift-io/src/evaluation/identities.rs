//! Scores an association of detections, over the detections that two scene files have in common.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use quadlift::metrics::{ClusteringScore, pairwise_clustering_scores};
use serde_json::{Value, json};

use super::EvaluateError;
use crate::scene_file::{DetectionRecord, SceneFile};

/// The score, and how many detections it rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Division {
    /// The score.
    pub score: ClusteringScore,
    /// Detections that are in both files.
    pub compared: usize,
    /// Detections of the estimate that the truth lacks.
    pub only_in_estimate: usize,
    /// Detections of the truth that the estimate lacks.
    pub only_in_truth: usize,
}

/// The outcome of scoring an association.
#[derive(Debug, Clone, PartialEq)]
pub enum DivisionOutcome {
    /// One of the files has no detections, those of the truth name no object, or the estimate has the ids that it was given.
    Absent,
    /// It is scored.
    Scored(Division),
    /// It is not: the detections of the estimate have several sources, and none was chosen.
    SeveralSources(String),
    /// It is not: the files have no detection in common.
    NoneCommon(String),
}

/// The key that identifies a detection in two files: its frame and its measurements, to the last bit.
type Key<'a> = (&'a str, Option<[u64; 4]>, Option<[u64; 5]>);

fn key(record: &DetectionRecord) -> Key<'_> {
    let ellipse = record.ellipse.as_deref().map(|e| {
        let ([x, y], [a, b]) = (e.center, e.semi_axes);
        [x, y, a, b, e.angle].map(f64::to_bits)
    });
    (&record.frame, record.bounding_box.map(|b| b.map(f64::to_bits)), ellipse)
}

/// Scores the objects that the detections of an estimate name against those that the same detections of a truth name.
///
/// Only of one source if given; then both files must have it. Messages name the paths.
///
/// # Errors
/// [`EvaluateError`] when one of the files has no detections of the source.
pub fn score(
    estimate: (&Path, &SceneFile),
    truth: (&Path, &SceneFile),
    source: Option<&str>,
) -> Result<DivisionOutcome, EvaluateError> {
    let of_source = |record: &&DetectionRecord| source.is_none() || record.source.as_deref() == source;
    let found: Vec<&DetectionRecord> = estimate.1.detections.iter().filter(of_source).collect();
    let all_true: Vec<&DetectionRecord> = truth.1.detections.iter().filter(of_source).collect();
    for ((path, _), kept) in [(estimate, &found), (truth, &all_true)] {
        if let Some(source) = source
            && kept.is_empty()
        {
            let why = format!("{}: there are no detections of the source \"{source}\"", path.display());
            return Err(EvaluateError::Unfit(why));
        }
    }
    let is_given = |about: &Value| ["association", "stream"].iter().all(|made| about.get(made).is_none());
    let no_ids = all_true.iter().all(|d| d.object.is_none()) || estimate.1.localization.as_ref().is_some_and(is_given);
    if found.is_empty() || no_ids {
        return Ok(DivisionOutcome::Absent);
    }
    let sources: BTreeSet<&str> = found.iter().map(|d| d.source.as_deref().unwrap_or("none")).collect();
    if sources.len() > 1 {
        let names: Vec<&str> = sources.into_iter().collect();
        return Ok(DivisionOutcome::SeveralSources(format!(
            "the detections of {} have several sources ({})",
            estimate.0.display(),
            names.join(", ")
        )));
    }
    let mut places: HashMap<Key, Vec<usize>> = HashMap::with_capacity(all_true.len());
    // From the end, so that of equal ones the first is taken first.
    for (place, record) in all_true.iter().enumerate().rev() {
        places.entry(key(record)).or_default().push(place);
    }
    let (mut true_names, mut found_names) = (Names::default(), Names::default());
    let mut pairs = Vec::with_capacity(found.len());
    for record in &found {
        if let Some(place) = places.get_mut(&key(record)).and_then(Vec::pop) {
            let true_name = all_true[place].object.as_deref().map(|name| true_names.number(name));
            pairs.push((true_name, record.object.as_deref().map(|name| found_names.number(name))));
        }
    }
    if pairs.is_empty() {
        return Ok(DivisionOutcome::NoneCommon(format!(
            "no detection of {} is in {} (the same frame, box and ellipse): identities are not scored",
            estimate.0.display(),
            truth.0.display()
        )));
    }
    let compared = pairs.len();
    let (truth, division): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    Ok(DivisionOutcome::Scored(Division {
        score: pairwise_clustering_scores(&truth, &division),
        compared,
        only_in_estimate: found.len() - compared,
        only_in_truth: all_true.len() - compared,
    }))
}

/// Numbers for names, in the order in which they are met.
#[derive(Default)]
struct Names<'a>(HashMap<&'a str, u32>);

impl<'a> Names<'a> {
    fn number(&mut self, name: &'a str) -> u32 {
        let next = self.0.len() as u32;
        *self.0.entry(name).or_insert(next)
    }
}

impl DivisionOutcome {
    /// As JSON; null where there is no score.
    pub fn to_record(&self) -> Value {
        let Self::Scored(division) = self else { return Value::Null };
        json!({
            "detections": division.compared,
            "only_in_estimate": division.only_in_estimate,
            "only_in_truth": division.only_in_truth,
            "precision": division.score.precision,
            "recall": division.score.recall,
            "f1": division.score.f1,
            "adjusted_rand_index": division.score.adjusted_rand_index,
            "duplicates": division.score.duplicates,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(detections: &[(&str, f64, Option<&str>)]) -> SceneFile {
        let record = |&(frame, x, object): &(&str, f64, Option<&str>)| DetectionRecord {
            frame: frame.into(),
            object: object.map(Into::into),
            bounding_box: Some([x, 0.0, x + 1.0, 1.0]),
            ..Default::default()
        };
        SceneFile { detections: detections.iter().map(record).collect(), ..Default::default() }
    }

    fn divided(estimate: &SceneFile, truth: &SceneFile) -> DivisionOutcome {
        score((Path::new("e"), estimate), (Path::new("t"), truth), None).unwrap()
    }

    #[test]
    fn detections_are_found_again_in_any_order() {
        let truth =
            scene(&[("a", 0.0, Some("cup")), ("b", 1.0, Some("cup")), ("a", 5.0, Some("mug")), ("b", 6.0, None)]);
        let estimate =
            scene(&[("b", 1.0, Some("1")), ("a", 0.0, Some("1")), ("a", 5.0, Some("2")), ("c", 0.0, Some("2"))]);
        let DivisionOutcome::Scored(division) = divided(&estimate, &truth) else { panic!() };
        assert_eq!((division.compared, division.only_in_estimate, division.only_in_truth), (3, 1, 1));
        assert_eq!((division.score.f1, division.score.duplicates), (1.0, 0));
        // Two detections in one place are two.
        let twice = scene(&[("a", 0.0, Some("cup")), ("a", 0.0, Some("mug"))]);
        let DivisionOutcome::Scored(division) = divided(&twice, &twice) else { panic!() };
        assert_eq!((division.compared, division.score.adjusted_rand_index), (2, 1.0));
    }

    #[test]
    fn what_cannot_be_compared_is_said() {
        let truth = scene(&[("a", 0.0, Some("cup"))]);
        assert_eq!(divided(&SceneFile::default(), &truth), DivisionOutcome::Absent);
        assert_eq!(divided(&truth, &scene(&[("a", 0.0, None)])), DivisionOutcome::Absent);
        let elsewhere = divided(&scene(&[("a", 0.5, Some("cup"))]), &truth);
        assert!(matches!(&elsewhere, DivisionOutcome::NoneCommon(why) if why.contains("no detection of e is in t")));
        let mut two = scene(&[("a", 0.0, Some("cup")), ("b", 0.0, Some("cup"))]);
        two.detections[0].source = Some("yolo".into());
        assert!(matches!(divided(&two, &truth), DivisionOutcome::SeveralSources(why) if why.contains("(none, yolo)")));
        let unknown = score((Path::new("e"), &two), (Path::new("t"), &truth), Some("yolo")).unwrap_err();
        assert_eq!(unknown.to_string(), "t: there are no detections of the source \"yolo\"");
    }
}

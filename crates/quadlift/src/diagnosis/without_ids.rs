//! The consistency check of a scene without object ids: the detections are associated under each hypothesis.
//!
//! Association also finds objects in corrupted scenes, but with less evidence. If an association has little evidence,
//! common mistakes are undone one by one and a part of the scene is associated again; the mistake whose correction
//! yields much more evidence is the cause.

use super::agreement::{Agreement, MIN_BOXES};
use super::cause::Cause;
use super::correction::{BoxFormat, Correction};
use super::hypotheses::{FAMILIES, discrete};
use super::rig_time;
use super::sample::{Sample, loose_boxes};
use super::some_frames::{MAX_BOXES, are_many, some_frames_of_loose};
use super::trials::{Trial, Tried, evidence, evidence_of};
use super::verdict::Diagnosis;
use super::with_ids::of_boxes;
use crate::association::{AssociateError, AssociateOptions, Association};
use crate::parallel::map_indices;
use crate::scene::{Detection, Scene};

/// Maximum number of refinements of a parameter with the associated objects.
const REFINEMENTS: usize = 3;

/// Evidence per detection (nats) above which an association is not checked further.
const PLENTY_OF_EVIDENCE: f64 = 6.0;

/// Typical miss of the objects of an association, in half sizes, up to which it is not checked further.
const SMALL_MISS: f64 = 0.12;

/// The evidence for each detection must grow by so many nats...
const MORE_NATS: f64 = 1.5;

/// ...and by this factor.
const MORE_TIMES: f64 = 1.6;

/// Evidence below which no detections agree.
const NO_EVIDENCE: f64 = 0.3;

/// Minimum number of frames with boxes in which objects should be found.
const ENOUGH_FRAMES: usize = 5;

/// Checks the association of a scene whose detections name no objects, or whose ids are only evidence.
///
/// Takes a few milliseconds if the association has much evidence; otherwise a part of the scene is associated under
/// each hypothesis, which may take seconds.
///
/// # Errors
/// Those of [`crate::associate()`] with the same options.
pub fn diagnose_association(
    scene: &Scene,
    association: &Association,
    options: &AssociateOptions,
) -> Result<Diagnosis, AssociateError> {
    let source = scene.source_index(options.source.as_deref())?;
    let is_used = |d: &Detection| source.is_none() || d.source_index == source;
    let named = association.applied_to(scene, source);
    let mut found = of_boxes(&named, is_used);
    if let (true, Some(agreement)) = (found.consistent && found.causes.is_empty(), found.agreement) {
        let loose = loose_boxes(&named, is_used);
        let of_loose = || some_frames_of_loose(&Sample::with_at_most(&named, is_used, MAX_BOXES), &loose, agreement);
        if let Some(cause) = rig_time::of_scene(&named, is_used, false, agreement) {
            found.consistent = false;
            found.causes.push(cause);
        } else if let Some(cause) = (!loose.is_empty()).then(of_loose).flatten() {
            found.consistent = !are_many(&cause);
            found.causes.push(cause);
        }
    }
    Ok(with_hypotheses(scene, found, association, is_used, options)?.and_up(scene))
}

/// The diagnosis of an association, compared with associations after each correction.
fn with_hypotheses(
    scene: &Scene,
    found: Diagnosis,
    association: &Association,
    is_used: impl Fn(&Detection) -> bool,
    options: &AssociateOptions,
) -> Result<Diagnosis, AssociateError> {
    if !found.consistent && !found.causes.is_empty() {
        return Ok(found);
    }
    let used = scene.detections.iter().filter(|d| is_used(d)).count();
    if is_convincing(association, found.agreement) || used < MIN_BOXES {
        return Ok(found);
    }
    let tried = Tried::new(scene, &is_used, options);
    let before = tried.given()?;
    let ids: Vec<&str> = scene.frames.iter().map(|frame| frame.id.as_str()).collect();
    let mut discrete = discrete(&ids);
    // Larger boxes agree with anything.
    discrete.retain(|correction| {
        !matches!(correction, Correction::Boxes(BoxFormat::SizeReadAsCorners | BoxFormat::CenterSizeReadAsCorners))
    });
    let mut results = map_indices(discrete.len(), |k| tried.with(discrete[k]));
    results.extend(map_indices(FAMILIES.len(), |k| tried.narrowed(&FAMILIES[k])));
    let best = results.into_iter().fold(None, better);
    let Some(mut best) = best.filter(|best| {
        best.evidence > (before.evidence + MORE_NATS).max(before.evidence * MORE_TIMES) && best.evidence > NO_EVIDENCE
    }) else {
        // In a few frames an object may be seen too seldom.
        let is_told = tried.frames.iter().filter(|used| **used).count() >= ENOUGH_FRAMES;
        let consistent = found.consistent && (before.evidence > NO_EVIDENCE || !is_told);
        return Ok(Diagnosis { consistent, ..found });
    };
    // The objects associated with the coarse parameter refine it, which in turn improves the association.
    for _ in 0..REFINEMENTS {
        let refined = tried.with(best.refined(&is_used));
        if evidence_of(&refined) <= best.evidence {
            break;
        }
        best = refined.unwrap_or(best);
    }
    let cause = Cause::new(best.refined(&is_used), before.agreement, best.agreement);
    Ok(Diagnosis { consistent: false, agreement: Some(before.agreement), causes: vec![cause] })
}

/// Whether an association has so much evidence that it is not compared with others, which takes long.
pub(crate) fn is_convincing(association: &Association, agreement: Option<Agreement>) -> bool {
    let agrees = agreement.is_some_and(|agreement| agreement.miss < SMALL_MISS);
    agrees && evidence(association) >= PLENTY_OF_EVIDENCE * association.boxes as f64
}

/// The trial with more evidence, the first of equals.
fn better(first: Option<Trial>, second: Option<Trial>) -> Option<Trial> {
    if evidence_of(&second) > evidence_of(&first) { second } else { first }
}

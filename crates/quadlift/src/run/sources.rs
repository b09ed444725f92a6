//! Measurements beside the boxes that contradict them are left out.

use crate::diagnosis::{Cause, CauseName};
use crate::localize::{Localization, LocalizeError, LocalizeOptions, solve_objects};
use crate::observer::Observer;
use crate::scene::Scene;
use crate::solve::Status;

/// A kind of measurement beside the boxes.
#[derive(Debug, Clone, Copy)]
enum Extra {
    Outlines,
    Depths,
    Boxes3d,
}

impl Extra {
    const ALL: [Self; 3] = [Self::Outlines, Self::Depths, Self::Boxes3d];

    /// Whether detections with a box or an ellipse have it.
    fn is_in(self, scene: &Scene) -> bool {
        scene.detections.iter().filter(|d| d.is_measured()).any(|detection| match self {
            Self::Outlines => detection.tangent_lines.is_some(),
            Self::Depths => detection.cues.as_ref().is_some_and(|cues| cues.depth.is_some()),
            Self::Boxes3d => detection.cues.as_ref().is_some_and(|cues| cues.box3d.is_some()),
        })
    }

    fn leave_out(self, scene: &mut Scene) {
        for detection in &mut scene.0.detections {
            match (self, detection.cues.as_deref_mut()) {
                (Self::Outlines, _) => detection.tangent_lines = None,
                (Self::Depths, Some(cues)) => cues.depth = None,
                (Self::Boxes3d, Some(cues)) => cues.box3d = None,
                (_, None) => {}
            }
            detection.cues.take_if(|cues| cues.is_empty());
        }
    }

    fn cause(self) -> CauseName {
        match self {
            Self::Outlines => CauseName::Outlines,
            Self::Depths => CauseName::Depths,
            Self::Boxes3d => CauseName::Boxes3d,
        }
    }
}

/// [`solve_objects`]; where the result is inconsistent for no reason in boxes and poses, or less than half of the objects are
/// usable, without the outlines, depths or 3D boxes if that mends it. The diagnosis names what was left out.
///
/// # Errors
/// Those of [`solve_objects`].
pub(super) fn solve_consistent(
    scene: &Scene,
    options: &LocalizeOptions,
    observer: &dyn Observer,
) -> Result<Localization, LocalizeError> {
    let found = solve_objects(scene, options, observer)?;
    let is_explained = |cause: &Cause| cause.correction.is_some() || !cause.frames.is_empty();
    let (consistent, usable) = (found.diagnosis.consistent, localized(&found));
    if (consistent && 2 * usable >= found.estimates.len()) || found.diagnosis.causes.iter().any(is_explained) {
        return Ok(found);
    }
    let present: Vec<Extra> = Extra::ALL.into_iter().filter(|extra| extra.is_in(scene)).collect();
    // Each alone, then all of them.
    let mut trials: Vec<Vec<Extra>> = present.iter().map(|extra| vec![*extra]).collect();
    trials.extend((present.len() > 1).then_some(present));
    for extras in trials {
        let mut rest = scene.clone();
        extras.iter().for_each(|extra| extra.leave_out(&mut rest));
        let mut other = solve_objects(&rest, options, observer)?;
        if other.diagnosis.consistent && localized(&other) > if consistent { usable } else { usable.saturating_sub(1) }
        {
            let agreement = other.diagnosis.agreement.unwrap_or_default();
            let causes = extras.into_iter().map(|extra| Cause::unexplained(extra.cause(), agreement));
            other.diagnosis.causes.splice(0..0, causes);
            return Ok(other);
        }
    }
    Ok(found)
}

/// How many objects have a usable estimate.
fn localized(found: &Localization) -> usize {
    found.estimates.iter().filter(|estimate| estimate.status == Status::Ok).count()
}

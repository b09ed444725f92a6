//! Two simultaneous mistakes: if none alone explains why a scene is inconsistent, conventions of poses and boxes are corrected
//! one by one, and the check searches for a second mistake.

use super::input::Input;
use crate::diagnosis::{BoxFormat, Cause, Correction, Diagnosis};
use crate::scene::Scene;

/// The mistakes that are tried as one of two: those that are all or nothing. Factors and shifts of frames are found by the
/// check once such a mistake is corrected.
const FIRST: [Correction; 10] = [
    Correction::InvertPoses,
    Correction::OpenGlAxes,
    Correction::InvertOpenGlPoses,
    Correction::CenterAsTranslation,
    Correction::InvertBodyPoses,
    Correction::NormalizedBoxes,
    Correction::Boxes(BoxFormat::SizeReadAsCorners),
    Correction::Boxes(BoxFormat::CenterReadAsCorner),
    Correction::Boxes(BoxFormat::SwappedAxes),
    Correction::NormalizedIntrinsics,
];

/// Two causes that together explain an inconsistent scene; `check` is the diagnosis. The second is found after the
/// correction of the first. `None` if the scene stays inconsistent or no pair is found.
pub(super) fn pair_of_causes<I: Input>(
    input: &I,
    before: &Diagnosis,
    check: impl Fn(&Scene) -> Diagnosis,
) -> Option<[Cause; 2]> {
    let mut best: Option<[Cause; 2]> = None;
    for first in FIRST {
        let Some(once) = input.corrected(&[first]) else { continue };
        let found = check(&once);
        if found.consistent {
            // Alone it would have been named if it explained anything.
            continue;
        }
        let Some(second) = found.causes.first() else { continue };
        let Some(correction) = second.correction else { continue };
        let Some(twice) = input.corrected(&[first, correction]) else { continue };
        let after = check(&twice);
        let (Some(agreement), true) = (after.agreement, after.consistent) else { continue };
        if best.as_ref().is_some_and(|[_, known]| known.after.miss <= agreement.miss) {
            continue;
        }
        let uncorrected = before.agreement.unwrap_or(second.before);
        let cause = Cause::new(first, uncorrected, second.before);
        best = Some([cause, Cause { after: agreement, ..second.clone() }]);
    }
    best
}

//! Two simultaneous mistakes: if none alone explains why a scene is inconsistent, conventions of poses and boxes are
//! corrected one by one, and the self-check searches for a second mistake.

use quadlift::diagnosis::{BoxFormat, Cause, Correction, Diagnosis};
use quadlift::scene::Scene;
use quadlift_io::SceneFile;
use quadlift_io::correct::{RecordCorrection, correct};
use quadlift_io::diagnosis::Context;

/// The mistakes that are tried as one of two: those that are all or nothing. Factors and shifts of frames are found by the
/// self-check once such a mistake is undone.
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

/// Searches for two mistakes that together explain an inconsistent scene; `check` is the self-check. The second one is
/// found after the correction of the first. `None` if the scene stays inconsistent or no pair is found.
pub fn two_mistakes(
    file: &SceneFile,
    before: &Diagnosis,
    context: &Context,
    check: impl Fn(&Scene) -> Diagnosis,
) -> Option<[Cause; 2]> {
    let mut best: Option<[Cause; 2]> = None;
    for first in FIRST {
        let Some((once, half)) = corrected(file, &first, context).and_then(|file| Some((file.to_scene().ok()?, file)))
        else {
            continue;
        };
        let found = check(&once);
        if found.consistent {
            // Alone it would have been named if it explained anything: there is nothing left to look at.
            continue;
        }
        let Some(second) = found.causes.first() else { continue };
        let Some(correction) = second.correction else { continue };
        let Some(mended) = corrected(&half, &correction, context).and_then(|file| file.to_scene().ok()) else {
            continue;
        };
        let after = check(&mended);
        let (Some(agreement), true) = (after.agreement, after.consistent) else { continue };
        if best.as_ref().is_some_and(|[_, known]| known.after.miss <= agreement.miss) {
            continue;
        }
        let unmended = before.agreement.unwrap_or(second.before);
        let cause = Cause {
            name: first.cause(),
            value: first.value(),
            correction: Some(first),
            before: unmended,
            after: second.before,
        };
        best = Some([cause, Cause { after: agreement, ..*second }]);
    }
    best
}

fn corrected(file: &SceneFile, correction: &Correction, context: &Context) -> Option<SceneFile> {
    let mut file = file.clone();
    correct(&mut file, &[RecordCorrection::of(correction, context.image_size)]).ok()?;
    Some(file)
}

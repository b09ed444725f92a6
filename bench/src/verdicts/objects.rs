//! Scenes whose objects are localized at once (`quadlift localize`): with ids, without, and with refined poses.

use quadlift::diagnosis::{BoxFormat, CauseName, Correction, Diagnosis};
use quadlift::geometry::Ellipsoid;
use quadlift::metrics::pair_by_overlap;
use quadlift::run::{Check, RunError, RunOptions};
use quadlift::scene::Scene;
use quadlift::solve::{PoseMotion, PosteriorOptions, Status};
use quadlift::synthetic::{SyntheticOptions, Trajectory};
use quadlift::{LocalizeOptions, Unobserved};
use rayon::prelude::*;

use super::tally::{Verdict, Verdicts};
use crate::diagnosis::mistakes::{NamedMistake, all};
use crate::diagnosis::scenes::{RandomScene, without_ids};

/// First seed of the scenes: none of them has set a threshold.
const FIRST_SCENE: u64 = 200_000;

/// Fewest views and objects of scenes with a mistake.
const FEWEST: [usize; 2] = [8, 5];

/// Most boxes of a scene: larger ones take long.
const MAX_BOXES: usize = 600;

/// Fewest boxes of a true object that counts.
const MIN_BOXES: usize = 3;

/// Most views of a street in which the camera hardly turns.
const SHORT_DRIVE: usize = 20;

/// Volume IoU above which an object is found.
const FOUND: f64 = 0.2;

/// What is a wrong answer, in words.
pub(super) const WRONG: &str = "fewer than half of the true objects that have 3 boxes, or of the objects that the answer has with the \
                                status `ok`, overlap each other with an IoU above 0.2. Scenes whose answer is wrong without a mistake \
                                are left out";

/// What a command said about a scene, and the bodies of its answer.
pub(super) struct Answer {
    /// Whether it says that something is wrong, or refuses most objects that the views determine.
    pub noticed: bool,
    /// The causes that explain it, the best first.
    pub causes: Vec<CauseName>,
    /// Bodies that count as localized.
    pub bodies: Vec<Ellipsoid>,
}

impl Answer {
    /// Nothing but a diagnosis.
    pub(super) fn refused(diagnosis: &Diagnosis) -> Self {
        let causes = if diagnosis.consistent { Vec::new() } else { names(diagnosis) };
        Self { noticed: true, causes, bodies: Vec::new() }
    }
}

/// The names of the causes of a diagnosis, the best first.
pub(super) fn names(diagnosis: &Diagnosis) -> Vec<CauseName> {
    diagnosis.causes.iter().map(|cause| cause.name).collect()
}

/// The true bodies with [`MIN_BOXES`].
fn truth(drawn: &RandomScene) -> Vec<Option<Ellipsoid>> {
    let synthetic = &drawn.synthetic;
    let mut boxes = vec![0; synthetic.truth.len()];
    synthetic.true_objects.iter().flatten().for_each(|&object| boxes[object] += 1);
    let seen = synthetic.truth.iter().zip(boxes).filter(|(_, boxes)| *boxes >= MIN_BOXES);
    seen.map(|((_, body), _)| Some(body.closest_ellipsoid())).collect()
}

/// Whether an answer is wrong; see [`WRONG`].
fn is_wrong(truth: &[Option<Ellipsoid>], bodies: &[Ellipsoid]) -> bool {
    let bodies: Vec<Option<Ellipsoid>> = bodies.iter().copied().map(Some).collect();
    2 * pair_by_overlap(&bodies, truth, FOUND).len() < truth.len().max(bodies.len())
}

/// Whether the wrong scene is about as consistent as the right one, because of where the cameras stand.
fn is_hidden(mistake: &NamedMistake, options: &SyntheticOptions) -> bool {
    let is_street = options.trajectory == Trajectory::Street;
    let also = match mistake {
        // Boxes that are off by half their size are those of objects that are off by half theirs, while the camera does not turn.
        NamedMistake::Undone(Correction::Boxes(BoxFormat::CornerReadAsCenter | BoxFormat::CenterReadAsCorner)) => {
            is_street
        }
        // Cameras that only shift see another world with any other intrinsics: a short drive is one of them.
        NamedMistake::Undone(Correction::Letterbox(_) | Correction::NormalizedLetterbox) => {
            is_street && options.views <= SHORT_DRIVE
        }
        _ => false,
    };
    also || mistake.is_hidden_by(options.trajectory)
}

/// How a scene is localized.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Localized {
    WithIds,
    WithoutIds,
    RefinedPoses,
}

impl Localized {
    /// The answer for a scene with ids.
    pub(super) fn answer(self, scene: &Scene, seed: u64) -> Option<Answer> {
        let refine_poses = (self == Self::RefinedPoses).then_some(PoseMotion::Auto);
        let map = PosteriorOptions { refine_poses, ..Default::default() };
        let options = RunOptions { localize: LocalizeOptions { seed, ..map.into() }, ..Default::default() };
        let mut input = if self == Self::WithoutIds { without_ids(scene)? } else { scene.clone() };
        let run = match quadlift::run(&mut input, &options, &Unobserved) {
            Ok(run) => run,
            Err(RunError::NothingFound { check, .. }) => return Some(Answer::refused(&check.diagnosis)),
            Err(_) => return Some(Answer::refused(&Diagnosis::default())),
        };
        let estimates = &run.localization.estimates;
        let ok = estimates.iter().filter(|estimate| estimate.status == Status::Ok);
        let bodies: Vec<Ellipsoid> = ok.filter_map(|estimate| estimate.closest_ellipsoid()).collect();
        let undetermined = estimates.iter().filter(|estimate| estimate.status == Status::Undetermined).count();
        let Check { diagnosis, together, .. } = run.check;
        let both = together.iter().flatten().map(|cause| cause.name);
        let causes = names(&diagnosis).into_iter().chain(both).collect();
        Some(Answer {
            noticed: !diagnosis.consistent || 2 * bodies.len() < estimates.len() - undetermined,
            causes,
            bodies,
        })
    }
}

/// The scenes of a command, with the number of their draw, that it answers rightly.
pub(super) struct Drawn {
    seed: u64,
    scene: RandomScene,
    truth: Vec<Option<Ellipsoid>>,
}

/// Large scenes, one after another from a seed on; `views` is their smallest number of views.
fn draws(first: u64, views: usize) -> impl Iterator<Item = Drawn> {
    (first..).filter_map(move |seed| {
        let scene = RandomScene::draw(seed)?;
        let truth = truth(&scene);
        let is_large = scene.options.views >= views && truth.len() >= FEWEST[1];
        (is_large && scene.synthetic.scene.detections.len() <= MAX_BOXES).then_some(Drawn { seed, scene, truth })
    })
}

/// The verdicts of a command on scenes with objects; `answer` gives what it says about a scene with ids, from a seed.
pub(super) fn verdicts(
    [seed, seeds, right]: [u64; 3],
    views: usize,
    is_made: impl Fn(&NamedMistake) -> bool,
    answer: impl Fn(&Scene, u64) -> Option<Answer> + Sync,
) -> Verdicts {
    let first = FIRST_SCENE + seed * 1_000_000;
    let right_first = first + 500_000;
    let of_right = |drawn: Drawn| -> Option<(u64, Verdict)> {
        let found = answer(&drawn.scene.synthetic.scene, drawn.seed)?;
        let wrong = is_wrong(&drawn.truth, &found.bodies);
        Some((drawn.seed, Verdict { noticed: found.noticed, named: !found.causes.is_empty(), wrong, hidden: false }))
    };
    let chosen: Vec<Drawn> = draws(right_first, views).take(right as usize).collect();
    let of_right = chosen.into_par_iter().filter_map(of_right).collect();

    let is_right = |drawn: &Drawn| {
        let found = answer(&drawn.scene.synthetic.scene, drawn.seed);
        found.is_some_and(|found| !found.noticed && !is_wrong(&drawn.truth, &found.bodies))
    };
    let chosen: Vec<Drawn> = draws(first, views).filter(is_right).take(seeds as usize).collect();
    let mistakes: Vec<NamedMistake> = all().into_iter().filter(is_made).collect();
    let cases: Vec<(&Drawn, NamedMistake)> =
        mistakes.iter().flat_map(|&mistake| chosen.iter().map(move |drawn| (drawn, mistake))).collect();
    let of_case = |(drawn, mistake): (&Drawn, NamedMistake)| -> Option<(NamedMistake, u64, Verdict)> {
        let wrong = mistake.make(&drawn.scene.synthetic.scene)?;
        let found = answer(&wrong, drawn.seed)?;
        let verdict = Verdict {
            noticed: found.noticed,
            named: found.causes.first() == Some(&mistake.cause()),
            wrong: is_wrong(&drawn.truth, &found.bodies),
            hidden: is_hidden(&mistake, &drawn.scene.options),
        };
        Some((mistake, drawn.seed, verdict))
    };
    let found: Vec<_> = cases.into_par_iter().map(of_case).collect();
    let mut verdicts = Verdicts { right: of_right, ..Default::default() };
    for (mistake, seed, verdict) in found.into_iter().flatten() {
        let some = if matches!(mistake, NamedMistake::SomeFrames(..)) { " in some frames" } else { "" };
        verdicts.push(&format!("{}{some}", mistake.cause().name()), true, (seed, format!("{mistake:?}"), verdict));
    }
    verdicts
}

/// The verdicts of `quadlift localize`; without ids fewer mistakes can be made.
pub(super) fn localized(how: Localized, numbers: [u64; 3]) -> Verdicts {
    let is_made = |mistake: &NamedMistake| how != Localized::WithoutIds || !matches!(mistake, NamedMistake::MixedIds);
    verdicts(numbers, FEWEST[0], is_made, |scene, seed| how.answer(scene, seed))
}

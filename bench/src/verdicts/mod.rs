//! What each command says about mistakes of its input, and about right scenes (ours).

mod tally;
mod objects;
mod stream;
mod relocalize;
mod align;
mod calibrate_rig;

use self::objects::Localized;
use self::tally::Verdicts;
use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};

/// A command, as it is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Part {
    /// `localize` with ids.
    Localize,
    /// `localize` without ids.
    WithoutIds,
    /// `localize --refine-poses`, with ids.
    RefinePoses,
    /// `stream`, without ids.
    Stream,
    /// `relocalize`, of one image.
    RelocalizeOne,
    /// `relocalize`, of four images.
    Relocalize,
    /// `align`.
    Align,
    /// `calibrate-rig`, of two cameras.
    CalibrateRigTwo,
    /// `calibrate-rig`, of four cameras.
    CalibrateRig,
}

/// What is judged, and how much of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::Args)]
pub struct Extent {
    /// Scenes of each mistake
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub seeds: u64,

    /// Right scenes of a command; fewer where one takes long
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub right: u64,

    /// One command alone
    #[arg(long, value_name = "COMMAND")]
    pub only: Option<Part>,
}

impl Part {
    const ALL: [Self; 9] = [
        Self::Localize,
        Self::WithoutIds,
        Self::RefinePoses,
        Self::Stream,
        Self::RelocalizeOne,
        Self::Relocalize,
        Self::Align,
        Self::CalibrateRigTwo,
        Self::CalibrateRig,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Localize => "localize, with ids",
            Self::WithoutIds => "localize, without ids",
            Self::RefinePoses => "localize, refined poses",
            Self::Stream => "stream",
            Self::RelocalizeOne => "relocalize, one image",
            Self::Relocalize => "relocalize, four images",
            Self::Align => "align",
            Self::CalibrateRigTwo => "calibrate-rig, two cameras",
            Self::CalibrateRig => "calibrate-rig, four cameras",
        }
    }

    /// The ids of its figures: noticed, wrong and ok, refused.
    fn ids(self) -> [&'static str; 3] {
        match self {
            Self::Localize => ["localize_noticed", "localize_wrong_and_ok", "localize_refused"],
            Self::WithoutIds => ["without_ids_noticed", "without_ids_wrong_and_ok", "without_ids_refused"],
            Self::RefinePoses => ["refine_poses_noticed", "refine_poses_wrong_and_ok", "refine_poses_refused"],
            Self::Stream => ["stream_noticed", "stream_wrong_and_ok", "stream_refused"],
            Self::RelocalizeOne => ["relocalize_one_noticed", "relocalize_one_wrong_and_ok", "relocalize_one_refused"],
            Self::Relocalize => ["relocalize_noticed", "relocalize_wrong_and_ok", "relocalize_refused"],
            Self::Align => ["align_noticed", "align_wrong_and_ok", "align_refused"],
            Self::CalibrateRigTwo => {
                ["calibrate_rig_two_noticed", "calibrate_rig_two_wrong_and_ok", "calibrate_rig_two_refused"]
            }
            Self::CalibrateRig => ["calibrate_rig_noticed", "calibrate_rig_wrong_and_ok", "calibrate_rig_refused"],
        }
    }

    /// Which answers are wrong, in words.
    fn wrong(self) -> &'static str {
        match self {
            Self::Localize | Self::WithoutIds | Self::RefinePoses | Self::Stream => objects::WRONG,
            Self::RelocalizeOne | Self::Relocalize => relocalize::WRONG,
            Self::Align => align::WRONG,
            Self::CalibrateRigTwo | Self::CalibrateRig => calibrate_rig::WRONG,
        }
    }

    /// Right scenes are so many times fewer, where one takes long.
    fn fewer(self) -> u64 {
        match self {
            Self::Localize => 1,
            Self::RelocalizeOne | Self::Align => 2,
            _ => 5,
        }
    }

    /// What it says, from the seed, and the numbers of scenes of each mistake and of right scenes.
    fn verdicts(self, numbers: [u64; 3]) -> Result<Verdicts, Error> {
        match self {
            Self::Localize => Ok(objects::localized(Localized::WithIds, numbers)),
            Self::WithoutIds => Ok(objects::localized(Localized::WithoutIds, numbers)),
            Self::RefinePoses => Ok(objects::localized(Localized::RefinedPoses, numbers)),
            Self::Stream => Ok(stream::streamed(numbers)),
            Self::RelocalizeOne => relocalize::relocalized(numbers, 1),
            Self::Relocalize => relocalize::relocalized(numbers, 4),
            Self::Align => align::aligned(numbers),
            Self::CalibrateRigTwo => calibrate_rig::calibrated(numbers, 2),
            Self::CalibrateRig => calibrate_rig::calibrated(numbers, 4),
        }
    }
}

/// Scenes of each mistake, and right scenes, in the short form.
const SHORT: [u64; 2] = [1, 10];

/// Runs the experiment.
///
/// # Errors
/// [`Error`]: a scene that cannot be made.
pub(crate) fn run(Extent { seeds, right, only }: Extent, run: &Run) -> Result<Report, Error> {
    let [seeds, right] = if run.short { [seeds.min(SHORT[0]), right.min(SHORT[1])] } else { [seeds, right] };
    let parts: Vec<Part> = Part::ALL.into_iter().filter(|part| only.is_none_or(|only| *part == only)).collect();
    let steps = Steps::new("verdicts", parts.len(), run.progress);
    let mut report = Report::new("verdicts", "What commands say about mistakes, and about right scenes (ours)");
    report.text(
        "Noticed: the scene is called inconsistent, or the answer is refused. Named: noticed, and the first cause is the right one (of \
         right scenes: a mistake is named although there is none). Wrong and ok: the answer is wrong, and nothing is said; \"hidden\": the \
         same, where the cameras stand so that the wrong scene is as consistent as the right one. Synthetic scenes, drawn as in \
         `diagnosis`, with 8 views and 5 objects or more, of streams 40 frames, and at most 600 boxes; rooms and halls as in `cameras`.",
    );
    for part in parts {
        let verdicts = part.verdicts([run.seed, seeds, right.div_ceil(part.fewer())])?;
        report.table(verdicts.table(part.name(), part.wrong()));
        let (all, of_right) = (verdicts.all(), verdicts.of_right());
        let [noticed, wrong_and_ok, refused] = part.ids();
        let figure = |id, what, value| Headline::ours(id, what, part.name(), value);
        report.headlines.extend([
            figure(noticed, "share of scenes with a mistake that are noticed", all.share(all.noticed)),
            figure(wrong_and_ok, "share of them that are wrong and ok", all.share(all.wrong_and_ok)),
            figure(refused, "share of right scenes that are refused", of_right.share(of_right.noticed)),
        ]);
        steps.done();
    }
    Ok(report)
}

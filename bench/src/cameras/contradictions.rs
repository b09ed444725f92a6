//! Fixed cameras of which one is wrong (`quadlift calibrate`): which are named, and which get a pose.

use quadlift::calibrate::{CalibrateOptions, Calibration, Rig, calibrate};
use quadlift::geometry::{BoundingBox, Intrinsics};
use quadlift::synthetic::{HallOptions, generate_hall};
use rayon::prelude::*;

use crate::error::Error;
use crate::progress::{Run, Steps};
use crate::report::{Headline, Report};
use crate::table::{Cell, Table};

/// Halls of each mistake, and of none.
const HALLS: u64 = 40;
const RIGHT_HALLS: u64 = 100;
const FIRST_SEED: u64 = 20_000;

/// What is wrong with camera 1.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mistake {
    Nothing,
    /// Cameras 2 and 3 are in another hall.
    TwoHalls,
    /// It is in another hall.
    Foreign,
    /// Factor on its focal length.
    FocalLength(f64),
    /// Its boxes are those of images of half the size.
    HalfSize,
    /// Its images are mirrored.
    Mirrored,
}

impl Mistake {
    const ALL: [(Self, &str); 8] = [
        (Self::Nothing, "none"),
        (Self::TwoHalls, "two halls"),
        (Self::Foreign, "camera of another hall"),
        (Self::FocalLength(1.6), "focal length 1.6"),
        (Self::FocalLength(1.0 / 1.6), "focal length 0.625"),
        (Self::FocalLength(1.25), "focal length 1.25"),
        (Self::HalfSize, "half-size images"),
        (Self::Mirrored, "mirrored images"),
    ];

    /// Cameras that are not where the others are, or not as they are described.
    fn wrong(self) -> &'static [usize] {
        match self {
            Self::Nothing => &[],
            Self::TwoHalls => &[2, 3],
            _ => &[1],
        }
    }
}

/// A hall with a mistake.
fn rig(mistake: Mistake, cameras: usize, seed: u64) -> Result<Rig, Error> {
    let of_seed = |values: [f64; 3]| values[(seed % 3) as usize];
    let options = HallOptions {
        seed,
        cameras,
        walkers: 1 + (seed / 3 % 3) as usize,
        instants: [50, 100, 200][(seed / 9 % 3) as usize],
        edge_sd: of_seed([0.02, 0.03, 0.05]),
        misses: 0.2,
        false_boxes: 0.05,
        ids: seed.is_multiple_of(2),
        ..HallOptions::default()
    };
    let mut rig = generate_hall(&options)?.rig(None);
    if matches!(mistake, Mistake::TwoHalls | Mistake::Foreign) {
        let others = generate_hall(&HallOptions { seed: seed + FIRST_SEED, ..options })?.rig(None).boxes;
        let is_wrong = |camera: usize| mistake.wrong().contains(&camera);
        rig.boxes.retain(|b| !is_wrong(b.camera));
        rig.boxes.extend(others.into_iter().filter(|b| is_wrong(b.camera)));
    }
    if let Mistake::FocalLength(factor) = mistake {
        let k = rig.cameras[1].intrinsics;
        rig.cameras[1].intrinsics = Intrinsics::new(factor * k.fx, factor * k.fy, k.cx, k.cy)?;
    }
    let width = rig.cameras[1].image_size.map_or(0.0, |size| size.x);
    for b in rig.boxes.iter_mut().filter(|b| b.camera == 1) {
        let edges @ [left, top, right, bottom] = b.bounding_box.edges();
        let changed = match mistake {
            Mistake::HalfSize => edges.map(|x| 0.5 * x),
            Mistake::Mirrored => [width - right, top, width - left, bottom],
            _ => edges,
        };
        b.bounding_box = BoundingBox::new(changed).unwrap_or(b.bounding_box);
    }
    Ok(rig)
}

/// Counts of halls.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    halls: usize,
    /// Exactly the wrong cameras are named.
    named: usize,
    /// A contradiction is reported.
    told: usize,
    /// A wrong camera has a pose beside one of the others.
    wrong_and_ok: usize,
    /// A right camera has none.
    right_and_refused: usize,
}

impl Counts {
    fn of(mistake: Mistake, found: &Calibration) -> Self {
        let cameras = found.cameras.len();
        let named: Vec<usize> = (0..cameras).filter(|&k| found.cameras[k].contradiction.is_some()).collect();
        let has_pose = |camera: usize| found.cameras[camera].status.has_pose();
        let (wrong, right): (Vec<usize>, Vec<usize>) = (0..cameras).partition(|k| mistake.wrong().contains(k));
        let mut expected = vec![wrong.clone()];
        if cameras == 2 && !wrong.is_empty() {
            expected.push(vec![0, 1]);
        }
        if mistake == Mistake::TwoHalls {
            expected.push(right.clone());
        }
        let any = |all: &[usize]| all.iter().any(|&camera| has_pose(camera));
        // Of two cameras, and of two halls, either may be the right one.
        let either = cameras == 2 || mistake == Mistake::TwoHalls;
        let count = usize::from;
        Self {
            halls: 1,
            named: count(expected.contains(&named)),
            told: count(!named.is_empty()),
            wrong_and_ok: count(any(&wrong) && any(&right)),
            right_and_refused: count(if either && !wrong.is_empty() {
                !any(&right) && !any(&wrong)
            } else {
                !right.iter().all(|&camera| has_pose(camera))
            }),
        }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            halls: self.halls + other.halls,
            named: self.named + other.named,
            told: self.told + other.told,
            wrong_and_ok: self.wrong_and_ok + other.wrong_and_ok,
            right_and_refused: self.right_and_refused + other.right_and_refused,
        }
    }
}

/// Adds the table.
pub(super) fn run(run: &Run, report: &mut Report) -> Result<(), Error> {
    let mut rows: Vec<(Mistake, &str, usize)> = Vec::new();
    for (mistake, name) in Mistake::ALL {
        rows.push((mistake, name, 4));
        if mistake != Mistake::TwoHalls {
            rows.push((mistake, name, 2));
        }
    }
    let steps = Steps::new("contradictions", rows.len(), run.progress);
    report.text(
        "Halls in which one camera is wrong: edges with a noise of 2, 3 or 5 %, one to three people, 50 to 200 instants, half of the halls \
         with ids. Named: exactly the wrong cameras (of two cameras both, of two halls either). Wrong and ok: a wrong camera gets a pose \
         beside a right one. Refused: a right camera gets none (of two cameras and two halls: nobody does).",
    );
    let titles = ["mistake", "cameras", "halls", "contradiction", "named", "wrong and ok", "refused"];
    let mut table = Table::new("Fixed cameras that contradict each other", titles);
    let (mut false_alarms, mut wrong_and_ok) = (0.0_f64, 0.0_f64);
    for (mistake, name, cameras) in rows {
        let halls = run.scenes(if mistake == Mistake::Nothing { RIGHT_HALLS } else { HALLS });
        let of_hall = |number: u64| -> Result<Counts, Error> {
            let seed = run.seed.wrapping_add(FIRST_SEED + number);
            let found = calibrate(&rig(mistake, cameras, seed)?, &CalibrateOptions { seed, ..Default::default() });
            Ok(Counts::of(mistake, &found))
        };
        let all = (0..halls).into_par_iter().map(of_hall).collect::<Result<Vec<_>, _>>()?;
        let sum = all.into_iter().fold(Counts::default(), Counts::plus);
        let share = |count: usize| count as f64 / sum.halls.max(1) as f64;
        match mistake {
            Mistake::Nothing => false_alarms = false_alarms.max(share(sum.told)),
            // Boxes of two cameras, and small mistakes, do not show it.
            Mistake::FocalLength(factor) if (factor - 1.25).abs() < 1e-9 => {}
            _ if cameras > 2 => wrong_and_ok = wrong_and_ok.max(share(sum.wrong_and_ok)),
            _ => {}
        }
        let counts = [sum.told, sum.named, sum.wrong_and_ok, sum.right_and_refused];
        let labels = [name.to_owned(), cameras.to_string(), sum.halls.to_string()].map(Cell::from);
        table.push(labels.into_iter().chain(counts.map(|count| Cell::from(count.to_string()))).collect());
        steps.done();
    }
    report.table(table);
    let headline = |id, what, value| Headline::ours(id, what, "calibrate", value);
    report.headlines.push(headline(
        "calibrate_false_alarms",
        "share of right halls in which a camera is said to contradict the others, the higher of two and four cameras",
        false_alarms,
    ));
    report.headlines.push(headline(
        "calibrate_wrong_and_ok",
        "share of halls of four cameras in which a wrong camera gets a pose, the highest",
        wrong_and_ok,
    ));
    Ok(())
}

//! Fixed cameras of which one is wrong (`quadlift calibrate`).

use quadlift::calibrate_rig::{CalibrateOptions, Calibration, Contradiction, Rig, calibrate_rig};
use quadlift::geometry::{BoundingBox, CamFromWorld, Intrinsics};
use quadlift::nalgebra::Rotation3;
use quadlift::synthetic::{HallOptions, generate_hall};
use rayon::prelude::*;

use super::tally::{Verdict, Verdicts};
use crate::cameras::calibration::relative;
use crate::error::Error;
use crate::scores::median;

/// First seed of the halls, and the distance to those of other halls.
const FIRST_SEED: u64 = 20_000;

/// Errors of a right camera relative to a reference: rotation, degrees, and position, as a share of the distance between the two.
const MAX_DEGREES: f64 = 5.0;
const MAX_SHARE: f64 = 0.1;

/// What is a wrong answer, in words.
pub(super) const WRONG: &str = "a camera of another hall has a pose beside those of this one, or the pose of a camera relative to the \
                                first right one is off by more than 5 degrees or 10 % of their distance (the scale is that of most \
                                cameras). Noticed: a contradiction, or a camera without a pose";

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
    const ALL: [(Self, &str); 7] = [
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

    fn is_of_another_hall(self) -> bool {
        matches!(self, Self::TwoHalls | Self::Foreign)
    }

    /// Whether this is what is wrong.
    fn is_told_by(self, contradiction: Contradiction) -> bool {
        match self {
            Self::Nothing => true,
            Self::TwoHalls | Self::Foreign => matches!(contradiction, Contradiction::OtherBodies),
            Self::FocalLength(_) | Self::HalfSize => matches!(contradiction, Contradiction::FocalLength(_)),
            Self::Mirrored => matches!(contradiction, Contradiction::Mirrored),
        }
    }
}

/// A hall with a mistake, and its true cameras.
fn rig(mistake: Mistake, cameras: usize, seed: u64) -> Result<(Rig, Vec<CamFromWorld>), Error> {
    let of_seed = |values: [f64; 3]| values[(seed % 3) as usize];
    let options = HallOptions {
        seed,
        cameras,
        pedestrians: 1 + (seed / 3 % 3) as usize,
        time_steps: [50, 100, 200][(seed / 9 % 3) as usize],
        edge_noise: of_seed([0.02, 0.03, 0.05]),
        misses: 0.2,
        false_boxes: 0.05,
        ids: seed.is_multiple_of(2),
        ..HallOptions::default()
    };
    let hall = generate_hall(&options)?;
    let mut rig = hall.rig(None);
    if mistake.is_of_another_hall() {
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
    Ok((rig, hall.cameras))
}

/// Whether the poses contradict the true ones; see [`WRONG`].
fn is_wrong(mistake: Mistake, found: &Calibration, truth: &[CamFromWorld]) -> bool {
    let is_of_another = |camera: &usize| mistake.is_of_another_hall() && mistake.wrong().contains(camera);
    let posed = |camera: &usize| found.cameras[*camera].cam_from_world;
    let has_pose: Vec<usize> = (0..truth.len()).filter(|camera| posed(camera).is_some()).collect();
    let (others, own): (Vec<usize>, Vec<usize>) = has_pose.into_iter().partition(is_of_another);
    let right = own.iter().find(|camera| !mistake.wrong().contains(camera)).or(own.first());
    let Some((&reference, given)) = right.and_then(|camera| Some((camera, posed(camera)?))) else { return false };
    if !others.is_empty() {
        return true;
    }
    let of_camera =
        |camera: usize| Some((relative(&posed(&camera)?, &given), relative(&truth[camera], &truth[reference])));
    let both: Vec<_> =
        own.iter().filter(|camera| **camera != reference).filter_map(|&camera| of_camera(camera)).collect();
    let scales = both.iter().map(|((_, found), (_, truth))| truth.norm() / found.norm().max(f64::MIN_POSITIVE));
    let scale = median(scales.collect()).unwrap_or(1.0);
    both.iter().any(|((turn, center), (true_turn, true_center))| {
        let turn = Rotation3::from_matrix_eps(&(turn * true_turn.transpose()), 1e-12, 100, Rotation3::identity());
        let off = (center * scale - true_center).norm();
        turn.angle().to_degrees() > MAX_DEGREES || off > MAX_SHARE * true_center.norm()
    })
}

/// What is said about a hall.
fn verdict(mistake: Mistake, found: &Calibration, truth: &[CamFromWorld]) -> Verdict {
    let cameras = found.cameras.len();
    let told: Vec<usize> = (0..cameras).filter(|&k| found.cameras[k].contradiction.is_some()).collect();
    let (wrong, right): (Vec<usize>, Vec<usize>) = (0..cameras).partition(|k| mistake.wrong().contains(k));
    // Of two cameras, and of two halls, either may be the right one.
    let mut expected = vec![wrong];
    expected.extend((cameras == 2).then(|| vec![0, 1]));
    expected.extend((mistake == Mistake::TwoHalls).then_some(right));
    let causes = || found.cameras.iter().filter_map(|camera| camera.contradiction);
    let is_named = !told.is_empty() && expected.contains(&told) && causes().all(|cause| mistake.is_told_by(cause));
    Verdict {
        noticed: !told.is_empty() || !found.cameras.iter().all(|camera| camera.status.has_pose()),
        named: if mistake == Mistake::Nothing { !told.is_empty() } else { is_named },
        wrong: is_wrong(mistake, found, truth),
        hidden: false,
    }
}

/// The verdicts about halls with so many cameras.
///
/// # Errors
/// [`Error::Synthetic`].
pub(super) fn calibrated([seed, seeds, right]: [u64; 3], cameras: usize) -> Result<Verdicts, Error> {
    let first = FIRST_SEED + seed * 1_000_000;
    let of_hall = |mistake: Mistake, seed: u64| -> Result<(u64, Verdict), Error> {
        let (rig, truth) = rig(mistake, cameras, seed)?;
        let found = calibrate_rig(&rig, &CalibrateOptions { seed, ..Default::default() });
        Ok((seed, verdict(mistake, &found, &truth)))
    };
    let right = (0..right).into_par_iter().map(|k| of_hall(Mistake::Nothing, first + 500_000 + k));
    let mut verdicts = Verdicts { right: right.collect::<Result<_, _>>()?, ..Default::default() };
    for (mistake, name) in Mistake::ALL {
        if cameras > 2 || mistake != Mistake::TwoHalls {
            let halls =
                (0..seeds).into_par_iter().map(|k| of_hall(mistake, first + k)).collect::<Result<Vec<_>, _>>()?;
            halls.into_iter().for_each(|(seed, verdict)| verdicts.push(name, true, (seed, name.to_owned(), verdict)));
        }
    }
    Ok(verdicts)
}

//! Which motion moves which camera: each frame has its own, or those that a rig took at one time step share one, beside a small constant
//! motion of each camera in the rig (docs/method.md, section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};

use super::pose_terms::{FrameTerm, Motion, PoseTerms, SceneTerms};
use crate::geometry::rotation_vector;
use crate::scene::Frame;

/// The correction of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Correction {
    pub(super) turn: Rotation3<f64>,
    pub(super) shift: Vector3<f64>,
}

impl Correction {
    pub(super) fn of(motion: &Motion) -> Self {
        Self {
            turn: Rotation3::new(motion.fixed_rows::<3>(0).into_owned()),
            shift: motion.fixed_rows::<3>(3).into_owned(),
        }
    }

    pub(super) fn motion(&self) -> Motion {
        let turn = rotation_vector(&self.turn);
        Motion::new(turn.x, turn.y, turn.z, self.shift.x, self.shift.y, self.shift.z)
    }

    pub(super) fn after(&self, before: Option<&Self>) -> Self {
        before.map_or(*self, |b| Self { turn: self.turn * b.turn, shift: self.shift + b.shift })
    }

    pub(super) fn inverse(&self) -> Self {
        Self { turn: self.turn.inverse(), shift: -self.shift }
    }
}

/// A camera of a rig.
#[derive(Debug, Clone, Copy)]
struct Member {
    /// Number of the time step.
    time_step: usize,
    /// Number of the camera among the unknowns, if its place in the rig is refined.
    camera: Option<usize>,
    /// From the middle of the rig's cameras to the camera, world axes.
    offset: Vector3<f64>,
    /// Axes of the camera in the world.
    axes: Matrix3<f64>,
}

/// The unknown motions: of frames or time steps, numbered in their order, and of the cameras of a rig behind them.
#[derive(Debug, Clone)]
pub(crate) struct PoseUnknowns {
    /// By frame index; empty if each frame has its own motion.
    members: Vec<Member>,
    /// The number of the first camera; those before are time steps.
    pub(super) first_camera: usize,
}

impl Default for PoseUnknowns {
    fn default() -> Self {
        Self { members: Vec::new(), first_camera: usize::MAX }
    }
}

impl PoseUnknowns {
    /// The unknowns of frames, some of which a rig may have taken. Time steps are in the order of their numbers if every frame has one, and
    /// otherwise of their first frames.
    pub(crate) fn of(frames: &[Frame], refine_extrinsics: bool) -> Self {
        let numbers: Vec<Option<u64>> = frames.iter().map(|frame| frame.rig.map(|rig| rig.time_step)).collect();
        let mut sorted: Vec<u64> = numbers.iter().copied().flatten().collect();
        sorted.sort_unstable();
        if sorted.windows(2).all(|pair| pair[0] != pair[1]) {
            return Self::default();
        }
        sorted.dedup();
        let mut known: BTreeMap<u64, usize> = BTreeMap::new();
        if numbers.iter().all(Option::is_some) {
            known = sorted.iter().enumerate().map(|(k, number)| (*number, k)).collect();
        }
        let mut count = known.len();
        let mut time_step = |number: Option<u64>| {
            let next = count;
            let time_step = number.map_or(next, |number| *known.entry(number).or_insert(next));
            count = count.max(time_step + 1);
            time_step
        };
        let time_steps: Vec<usize> = numbers.iter().map(|number| time_step(*number)).collect();
        let mut middles: BTreeMap<usize, (Vector3<f64>, f64)> = BTreeMap::new();
        let center =
            |frame: &Frame| frame.projection.center_in_world().map_or_else(Vector3::zeros, |center| center.coords);
        for (frame, time_step) in frames.iter().zip(&time_steps) {
            let (sum, weight) = middles.entry(*time_step).or_default();
            *sum += center(frame);
            *weight += 1.0;
        }
        let camera = |frame: &Frame| frame.rig.filter(|_| refine_extrinsics)?.camera;
        let member = |(frame, time_step): (&Frame, usize)| {
            let (sum, weight) = middles[&time_step];
            Member {
                time_step,
                camera: camera(frame).map(|camera| count + camera as usize),
                offset: center(frame) - sum / weight,
                axes: frame.projection.world_from_cam_rotation().unwrap_or_else(Matrix3::identity),
            }
        };
        Self { members: frames.iter().zip(time_steps).map(member).collect(), first_camera: count }
    }

    /// The unknowns that move a frame's camera, with the derivative of its motion by each.
    pub(super) fn of_frame(&self, frame: usize) -> Vec<(usize, Matrix6<f64>)> {
        let Some(member) = self.members.get(frame) else { return vec![(frame, Matrix6::identity())] };
        let mut of_rig = Matrix6::identity();
        of_rig.fixed_view_mut::<3, 3>(3, 0).copy_from(&-member.offset.cross_matrix());
        let mut all = vec![(member.time_step, of_rig)];
        if let Some(camera) = member.camera {
            let mut of_camera = Matrix6::zeros();
            of_camera.fixed_view_mut::<3, 3>(0, 0).copy_from(&member.axes);
            of_camera.fixed_view_mut::<3, 3>(3, 3).copy_from(&member.axes);
            all.push((camera, of_camera));
        }
        all
    }

    /// What an object or a point tells about the unknowns, from what it tells about frames.
    pub(super) fn of_terms<const N: usize>(&self, terms: PoseTerms<N>) -> PoseTerms<N> {
        if self.members.is_empty() {
            return terms;
        }
        let mut frames: BTreeMap<usize, FrameTerm<N>> = BTreeMap::new();
        let mut cross: BTreeMap<(usize, usize), Matrix6<f64>> = BTreeMap::new();
        for term in &terms.frames {
            let unknowns = self.of_frame(term.frame);
            for (unknown, by) in &unknowns {
                frames.entry(*unknown).or_insert_with(|| FrameTerm::new(*unknown)).merge(&term.by(by));
            }
            if let [(time_step, by), (camera, by_camera)] = unknowns.as_slice() {
                *cross.entry((*camera, *time_step)).or_default() += by_camera.transpose() * term.information * by;
            }
        }
        PoseTerms { frames: frames.into_values().collect(), cross: cross.into_iter().collect(), ..terms }
    }

    /// The same of all objects and points.
    pub(super) fn of_scene(&self, SceneTerms { objects, points }: SceneTerms) -> SceneTerms {
        SceneTerms {
            objects: objects.into_iter().map(|terms| self.of_terms(terms)).collect(),
            points: points.into_iter().map(|terms| self.of_terms(terms)).collect(),
        }
    }

    /// The number of a frame's motion, or of its time step's, in the order of time.
    pub(crate) fn time_step(&self, frame: usize) -> usize {
        self.members.get(frame).map_or(frame, |member| member.time_step)
    }

    /// The corrections of the frames whose unknowns have these.
    pub(super) fn corrections(&self, unknowns: &BTreeMap<usize, Correction>) -> BTreeMap<usize, Correction> {
        if self.members.is_empty() {
            return unknowns.clone();
        }
        let of = |(frame, member): (usize, &Member)| {
            let none = Correction { turn: Rotation3::identity(), shift: Vector3::zeros() };
            let of_camera = member.camera.and_then(|camera| unknowns.get(&camera));
            let rig = match (unknowns.get(&member.time_step), of_camera) {
                (None, None) => return None,
                (rig, _) => rig.unwrap_or(&none),
            };
            let Correction { turn, shift } = of_camera.unwrap_or(&none);
            let axes = Rotation3::from_matrix_unchecked(member.axes);
            let offset = member.offset + member.axes * shift;
            let shift = rig.shift + rig.turn * offset - member.offset;
            Some((frame, Correction { turn: rig.turn * (axes * turn * axes.inverse()), shift }))
        };
        self.members.iter().enumerate().filter_map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Projection;
    use crate::scene::RigCamera;
    use nalgebra::{Matrix3x4, Vector6};

    fn frame(rig: Option<(u64, u32)>, k: usize) -> Frame {
        let turn = Rotation3::new(Vector3::new(0.2, 0.5 * k as f64, -0.1));
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(turn.matrix());
        matrix.set_column(3, &Vector3::new(k as f64, 0.3, 2.0 - 0.5 * k as f64));
        let projection = Projection::from_matrix(matrix).unwrap();
        let rig = rig.map(|(time_step, camera)| RigCamera { time_step, camera: Some(camera) });
        Frame { id: k.to_string(), projection, image_size: None, lens: None, rig }
    }

    #[test]
    fn instants_are_in_the_order_of_their_numbers() {
        let numbers = |rigs: &[Option<(u64, u32)>], extrinsics| {
            let frames: Vec<Frame> = rigs.iter().zip(0..).map(|(rig, k)| frame(*rig, k)).collect();
            let unknowns = PoseUnknowns::of(&frames, extrinsics);
            (0..frames.len()).map(|k| unknowns.of_frame(k).iter().map(|(n, _)| *n).collect()).collect::<Vec<Vec<_>>>()
        };
        let rigs = [Some((9, 0)), Some((4, 0)), Some((9, 1)), Some((4, 1))];
        assert_eq!(numbers(&rigs, true), [vec![1, 2], vec![0, 2], vec![1, 3], vec![0, 3]]);
        assert_eq!(numbers(&rigs, false), [[1], [0], [1], [0]]);
        assert_eq!(numbers(&[Some((9, 0)), None, Some((9, 1)), Some((4, 0))], false), [[0], [1], [0], [2]]);
        // No two frames of one time step: no rig.
        assert_eq!(numbers(&[Some((9, 0)), Some((4, 0)), None], true), [[0], [1], [2]]);
    }

    #[test]
    fn derivatives_of_a_rig_are_those_of_its_corrections() {
        let frames: Vec<Frame> = (0..2).map(|k| frame(Some((0, k as u32)), k)).collect();
        let unknowns = PoseUnknowns::of(&frames, true);
        for k in 0..2 {
            for (number, by) in unknowns.of_frame(k) {
                for i in 0..6 {
                    let step = 1e-4;
                    let motion: Motion = Vector6::from_fn(|j, _| if i == j { step } else { 0.0 });
                    let corrections = unknowns.corrections(&BTreeMap::from([(number, Correction::of(&motion))]));
                    let derivative = corrections[&k].motion() / step;
                    assert!((derivative - by.column(i)).norm() < 1e-3, "{k} {number} {i}: {derivative} {by}");
                }
            }
        }
    }
}

//! The normal equations of pose corrections, from which the objects are eliminated (Schur complement).

use std::collections::BTreeMap;

use nalgebra::{Matrix6, SMatrix, Vector6};

use super::envelope::{Envelope, Factor};
use super::pose_prior::PoseLevels;
use super::poses::{Motion, ObjectPoseTerms};
use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::options::PoseNoise;

/// Block multiplications of one factor, at most. With more (thousands of frames that all see the same objects) frames are divided into
/// segments, whose factors precondition conjugate gradients; covariances are then those within a segment.
const MOST_WORK: f64 = 6e6;

/// Most iterations of conjugate gradients, and the norm of the residual, relative to that of the right side, at which they end.
const ITERATIONS: usize = 60;
const TOLERANCE: f64 = 1e-8;

/// Smallest and largest estimated level, relative to the first one.
const SMALLEST: f64 = 1e-4;
const LARGEST: f64 = 4.0;

/// Number of parameters for which the usual ratio of the levels of rotations and shifts counts: as few as keep both from zero.
const TIED: f64 = 1.0;

/// Factor by which a level changes in one step, at most: noise levels and objects follow.
pub(super) const LARGEST_STEP: f64 = 2.0;

/// The solved equations.
#[derive(Debug, Clone)]
pub(crate) struct PoseSystem {
    /// Numbers of the motions, ascending.
    numbers: Vec<usize>,
    step: Vec<Motion>,
    /// The corrections after the step.
    motions: Vec<Motion>,
    covariance: Envelope,
    /// Logarithm of the evidence for the levels, against that for poses that are exact.
    log_evidence: f64,
}

/// What an object couples: positions of frames, and their couplings in units in which the object's information is 1.
struct Coupling {
    frames: Vec<(usize, SMatrix<f64, 6, PARAMETERS>)>,
}

impl PoseSystem {
    /// Builds and solves the equations; `None` where they are singular or nothing is seen. `before` is the correction of a frame so far.
    pub(crate) fn new(
        objects: &[ObjectPoseTerms],
        levels: PoseLevels,
        before: impl Fn(usize) -> Motion,
    ) -> Option<Self> {
        let mut numbers: Vec<usize> = objects.iter().flat_map(|o| o.frames.iter().map(|term| term.frame)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let position: BTreeMap<usize, usize> = numbers.iter().enumerate().map(|(k, number)| (*number, k)).collect();
        let mut diagonal = vec![Matrix6::zeros(); numbers.len()];
        let mut right = vec![Motion::zeros(); numbers.len()];
        // The prior.
        let precision = levels.precision(&numbers);
        let motions: Vec<Motion> = numbers.iter().map(|number| before(*number)).collect();
        for (k, (with_itself, with_before)) in precision.iter().enumerate() {
            let scale = levels.scale(numbers[k]);
            diagonal[k] += Matrix6::from_diagonal(&(scale * *with_itself));
            right[k] -= scale.component_mul(&motions[k]) * *with_itself;
            if *with_before != 0.0 {
                right[k] -= scale.component_mul(&motions[k - 1]) * *with_before;
                right[k - 1] -= scale.component_mul(&motions[k]) * *with_before;
            }
        }
        let mut cross: BTreeMap<(usize, usize), Matrix6<f64>> = BTreeMap::new();
        let mut couplings = Vec::with_capacity(objects.len());
        for object in objects {
            let Some(root) = nalgebra::Cholesky::new(object.covariance) else { continue };
            let mut coupled = Vec::with_capacity(object.frames.len());
            for term in &object.frames {
                let k = position[&term.frame];
                diagonal[k] += term.information;
                right[k] -= term.gradient + term.coupling * object.step;
                coupled.push((k, term.coupling * root.l()));
            }
            coupled.sort_by_key(|(k, _)| *k);
            couplings.push(Coupling { frames: coupled });
            for ((row, column), block) in &object.cross {
                *cross.entry((position[row], position[column])).or_default() += block;
            }
        }
        let scale = levels.scale(0);
        let correlated = if levels.is_correlated() { levels.instants(&numbers).len() } else { 0 };
        let cross = cross.into_iter().collect();
        let equations = Equations { diagonal, precision, scale, couplings, cross, correlated };
        let Solution { step, covariance, log_determinant } = equations.solve(&right)?;
        // What the measurements say, as a normal distribution of the motions: integrated with the prior (method, section 11.2).
        let told = equations.times(&motions);
        let explained = (0..numbers.len()).map(|k| (right[k] + told[k]).dot(&(motions[k] + step[k]))).sum::<f64>();
        let log_evidence = 0.5 * (levels.log_determinant(&numbers) - log_determinant + explained);
        let is_finite = step.iter().all(|motion| motion.iter().all(|x| x.is_finite()));
        let motions = motions.iter().zip(&step).map(|(before, step)| before + step).collect();
        is_finite.then_some(Self { numbers, step, motions, covariance, log_evidence })
    }

    /// Logarithm of the evidence for the levels, against that for poses that are exact.
    pub(crate) fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// The numbers of the motions, ascending.
    pub(crate) fn numbers(&self) -> &[usize] {
        &self.numbers
    }

    /// The step of each.
    pub(crate) fn step(&self) -> &[Motion] {
        &self.step
    }

    /// Covariance of the motions with two numbers (rows, columns); `None` where no object couples them.
    pub(crate) fn covariance(&self, number: usize, other: usize) -> Option<Matrix6<f64>> {
        let place = |number: usize| self.numbers.binary_search(&number).ok();
        self.covariance.block(place(number)?, place(other)?)
    }

    /// The standard deviations that the corrections show (MacKay's rule), and the number of parameters that the measurements determine.
    /// `levels` are those of the equations; they change by a factor of `largest_step`, at most.
    pub(crate) fn levels(&self, levels: PoseLevels, largest_step: f64) -> (PoseLevels, f64) {
        let motions = &self.motions;
        let instants = levels.instants(&self.numbers);
        let precision = levels.precision(instants);
        let (mut squares, mut spread) = (Motion::zeros(), Motion::zeros());
        for (k, (with_itself, with_before)) in precision.iter().enumerate() {
            squares += motions[k].component_mul(&motions[k]) * *with_itself;
            spread += self.covariance.block(k, k).map_or_else(Motion::zeros, |z| z.diagonal()) * *with_itself;
            if k > 0 {
                squares += motions[k].component_mul(&motions[k - 1]) * (2.0 * with_before);
                let z = self.covariance.block(k, k - 1).map_or_else(Motion::zeros, |z| z.diagonal());
                spread += z * (2.0 * with_before);
            }
        }
        let all = 3.0 * instants.len() as f64;
        // Where cameras look at objects around one place, turns and shifts of a camera look alike: the measurements then say hardly more than one
        // of the two levels, and the other one would become zero.
        let of = |from: usize, level: f64, usual: f64, other: f64| {
            let sum = |of: &Motion| of.fixed_rows::<3>(from).sum();
            let determined = (all - sum(&spread) / (level * level)).clamp(0.0, all);
            let expected = other * usual;
            let updated = ((sum(&squares) + TIED * expected * expected) / (determined + TIED)).sqrt();
            let updated = updated.clamp(level / largest_step, largest_step * level);
            (updated.clamp(SMALLEST * usual, LARGEST * usual), determined)
        };
        let (usual, now) = (levels.first, levels.noise);
        let [rotation, translation] = [now.rotation_sd / usual.rotation_sd, now.translation_sd / usual.translation_sd];
        let (rotation_sd, rotations) = of(0, now.rotation_sd, usual.rotation_sd, translation);
        let (translation_sd, shifts) = of(3, now.translation_sd, usual.translation_sd, rotation);
        (PoseLevels { noise: PoseNoise { rotation_sd, translation_sd }, ..levels }, rotations + shifts)
    }
}

/// The solution of the equations, their inverse within the envelope, and the logarithm of their determinant.
struct Solution {
    step: Vec<Motion>,
    covariance: Envelope,
    log_determinant: f64,
}

/// The equations: information of measurements and prior less what the objects take.
struct Equations {
    diagonal: Vec<Matrix6<f64>>,
    precision: Vec<(f64, f64)>,
    scale: Motion,
    couplings: Vec<Coupling>,
    /// Positions, row and column, with what the motions of a rig and of its camera have in common.
    cross: Vec<((usize, usize), Matrix6<f64>)>,
    /// So many motions, the first ones, follow each other.
    correlated: usize,
}

impl Equations {
    /// The first column of each row if only rows of the same segment are coupled.
    fn first_columns(&self, segment: usize) -> Vec<usize> {
        let start = |k: usize| k / segment * segment;
        let mut first: Vec<usize> = (0..self.diagonal.len()).collect();
        for (k, first) in first.iter_mut().enumerate() {
            if k < self.correlated && k > start(k) {
                *first = k - 1;
            }
        }
        for ((row, column), _) in &self.cross {
            first[*row] = first[*row].min((*column).max(start(*row)));
        }
        for coupling in &self.couplings {
            let mut least = usize::MAX;
            for (k, _) in &coupling.frames {
                if least == usize::MAX || least < start(*k) {
                    least = *k;
                }
                first[*k] = first[*k].min(least);
            }
        }
        first
    }

    fn envelope(&self, segment: usize) -> Envelope {
        let first = self.first_columns(segment);
        let mut matrix = Envelope::zeros(&first);
        for (k, block) in self.diagonal.iter().enumerate() {
            matrix.add(k, k, block);
            if k < self.correlated && first[k] < k {
                matrix.add(k, k - 1, &Matrix6::from_diagonal(&(self.scale * self.precision[k].1)));
            }
        }
        for ((row, column), block) in self.cross.iter().filter(|((row, column), _)| column / segment == row / segment) {
            matrix.add(*row, *column, block);
        }
        for Coupling { frames } in &self.couplings {
            for (place, (row, a)) in frames.iter().enumerate() {
                for (column, b) in frames[..=place].iter().filter(|(column, _)| *column / segment == *row / segment) {
                    matrix.add(*row, *column, &-(a * b.transpose()));
                }
            }
        }
        matrix
    }

    fn times(&self, x: &[Motion]) -> Vec<Motion> {
        let mut product: Vec<Motion> = self.diagonal.iter().zip(x).map(|(block, x)| block * x).collect();
        for k in 1..self.correlated {
            let with_before = self.scale * self.precision[k].1;
            product[k] += with_before.component_mul(&x[k - 1]);
            product[k - 1] += with_before.component_mul(&x[k]);
        }
        for ((row, column), block) in &self.cross {
            product[*row] += block * x[*column];
            product[*column] += block.tr_mul(&x[*row]);
        }
        for Coupling { frames } in &self.couplings {
            let sum: nalgebra::SVector<f64, PARAMETERS> = frames.iter().map(|(k, block)| block.tr_mul(&x[*k])).sum();
            frames.iter().for_each(|(k, block)| product[*k] -= block * sum);
        }
        product
    }

    fn solve(&self, right: &[Motion]) -> Option<Solution> {
        let mut segment = self.diagonal.len().max(1);
        while Envelope::work(&self.first_columns(segment)) > MOST_WORK {
            segment = segment.div_ceil(2);
        }
        let factor = self.envelope(segment).factor()?;
        let step =
            if segment >= self.diagonal.len() { factor.solve(right) } else { self.conjugate_gradients(&factor, right) };
        Some(Solution { step, covariance: factor.inverse(), log_determinant: factor.log_determinant() })
    }

    fn conjugate_gradients(&self, preconditioner: &Factor, right: &[Motion]) -> Vec<Motion> {
        let dot = |a: &[Motion], b: &[Motion]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        let mut x = vec![Vector6::zeros(); right.len()];
        let mut residual = right.to_vec();
        let mut z = preconditioner.solve(&residual);
        let mut direction = z.clone();
        let mut rho = dot(&residual, &z);
        let enough = TOLERANCE * TOLERANCE * rho;
        for _ in 0..ITERATIONS {
            if rho <= enough || rho.is_nan() {
                break;
            }
            let product = self.times(&direction);
            let length = rho / dot(&direction, &product);
            for (k, x) in x.iter_mut().enumerate() {
                *x += direction[k] * length;
                residual[k] -= product[k] * length;
            }
            z = preconditioner.solve(&residual);
            let next = dot(&residual, &z);
            direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + *d * (next / rho));
            rho = next;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::map::shared::poses::FrameTerm;
    use crate::synthetic::random::{normal, stream};
    use nalgebra::{Cholesky, DMatrix, DVector, SVector};

    const FRAMES: [usize; 3] = [2, 3, 7];
    const ROWS: usize = 10;

    /// Logarithm of the density of the residuals, with motions and parameters integrated out: those have a wide prior.
    fn marginal(residuals: &DVector<f64>, by: &DMatrix<f64>, by_object: &DMatrix<f64>, levels: PoseLevels) -> f64 {
        let sd = levels.scale(0).map(|scale| scale.powf(-0.5));
        let covariance = DMatrix::from_fn(6 * FRAMES.len(), 6 * FRAMES.len(), |i, j| {
            let gap = FRAMES[i / 6].abs_diff(FRAMES[j / 6]) as f64;
            let correlation = if i / 6 == j / 6 { 1.0 } else { (-gap / levels.memory).exp() };
            if i % 6 == j % 6 { sd[i % 6] * sd[j % 6] * correlation } else { 0.0 }
        });
        let of_noise = DMatrix::identity(residuals.len(), residuals.len());
        let all = of_noise + by * covariance * by.transpose() + by_object * by_object.transpose() * 1e7;
        let root = Cholesky::new(all).unwrap();
        -root.l().diagonal().map(f64::ln).sum() - 0.5 * residuals.dot(&root.solve(residuals))
    }

    #[test]
    fn the_evidence_is_the_density_of_the_residuals() {
        let mut rng = stream(3, 1);
        let count = ROWS * FRAMES.len();
        let mut by = DMatrix::zeros(count, 6 * FRAMES.len());
        for row in 0..count {
            for k in 0..6 {
                by[(row, 6 * (row / ROWS) + k)] = normal(&mut rng);
            }
        }
        let by_object = DMatrix::from_fn(count, PARAMETERS, |_, _| normal(&mut rng));
        let residuals = DVector::from_fn(count, |_, _| 1.5 * normal(&mut rng));
        let mut frames = Vec::new();
        for (k, frame) in FRAMES.into_iter().enumerate() {
            let mut term = FrameTerm::new(frame);
            for row in k * ROWS..(k + 1) * ROWS {
                let by_motion = Motion::from_fn(|i, _| by[(row, 6 * k + i)]);
                let parameters = std::array::from_fn(|i| by_object[(row, i)]);
                term.add(residuals[row], &by_motion, &parameters, 1.0);
            }
            frames.push(term);
        }
        let information =
            SMatrix::<f64, PARAMETERS, PARAMETERS>::from_fn(|i, j| by_object.column(i).dot(&by_object.column(j)));
        let covariance = information.try_inverse().unwrap();
        let step = -(covariance * SVector::<f64, PARAMETERS>::from_fn(|i, _| by_object.column(i).dot(&residuals)));
        let objects = [ObjectPoseTerms { frames, cross: Vec::new(), covariance, step }];
        let of = |rotation_sd, translation_sd, memory| {
            let noise = PoseNoise { rotation_sd, translation_sd };
            let levels = PoseLevels { noise, memory, extrinsics: noise, first: noise, first_camera: usize::MAX };
            let system = PoseSystem::new(&objects, levels, |_| Motion::zeros()).unwrap();
            (system.log_evidence(), marginal(&residuals, &by, &by_object, levels))
        };
        let (first, expected_first) = of(0.3, 0.5, 1e-9);
        for (rotation_sd, translation_sd, memory) in [(0.3, 0.5, 10.0), (0.1, 0.7, 3.0), (2.0, 0.01, 100.0)] {
            let (found, expected) = of(rotation_sd, translation_sd, memory);
            let (found, expected) = (found - first, expected - expected_first);
            assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{memory}: {found} {expected}");
        }
    }
}

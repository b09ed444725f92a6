//! The normal equations of pose corrections, from which objects and points are eliminated (Schur complement).

use nalgebra::{Matrix6, SMatrix, SVector, Vector6};

use super::envelope::{Envelope, Factor};
use super::pose_prior::PoseLevels;
use super::pose_terms::{Motion, PoseTerms, SceneTerms};
use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::options::PoseNoise;
use crate::sorting::StableSort;

/// Block multiplications of one factor, at most. With more (thousands of frames that all see the same objects) frames are divided into
/// segments, whose factors precondition conjugate gradients; covariances are then those within a segment.
const MAX_FACTOR_WORK: f64 = 6e6;

/// Most iterations of conjugate gradients, and the norm of the residual, relative to that of the right side, at which they end.
const ITERATIONS: usize = 60;
const TOLERANCE: f64 = 1e-8;

/// Smallest and largest estimated level, relative to the first one.
const MIN_LEVEL_FACTOR: f64 = 1e-4;
const MAX_LEVEL_FACTOR: f64 = 4.0;

/// Number of parameters for which the usual ratio of the levels of rotations and shifts counts: as few as keep both from zero.
const TIED: f64 = 1.0;

/// Factor by which a level changes in one step, at most: noise levels and objects follow.
pub(super) const MAX_STEP: f64 = 2.0;

/// What the measurements say about the motions, with objects and points eliminated.
#[derive(Debug, Clone)]
pub(crate) struct PoseEquations {
    /// Numbers of the motions, ascending. The first ones, of frames or time steps, follow each other.
    numbers: Vec<usize>,
    time_steps: usize,
    /// So many motions have a factor of their own.
    segment: usize,
    /// The information within the segments, and of that what points say.
    information: Envelope,
    of_points: Envelope,
    /// Minus the gradient at the corrections so far.
    right: Vec<Motion>,
    /// What objects say beyond the segments, if there are several.
    beyond: Option<Whole>,
}

/// The information of the objects without an envelope.
#[derive(Debug, Clone)]
struct Whole {
    diagonal: Vec<Matrix6<f64>>,
    /// Positions, row and column, with what the motions of a rig and of its camera have in common.
    cross: Vec<((usize, usize), Matrix6<f64>)>,
    couplings: Vec<Coupling<PARAMETERS>>,
}

/// What an object or a point couples: positions of motions, and their couplings in units in which its own information is 1.
#[derive(Debug, Clone)]
struct Coupling<const N: usize> {
    motions: Vec<(usize, SMatrix<f64, 6, N>)>,
}

/// Positions of motions that belong together, ascending.
type Coupled = Vec<usize>;

impl PoseEquations {
    /// The equations from what objects and points say. `first_camera` is the number of the first motion that does not follow another one.
    /// Points that were observed in several segments of frames are left out.
    pub(crate) fn new(terms: &SceneTerms, first_camera: usize) -> Self {
        let numbers = terms.numbers();
        let time_steps = numbers.partition_point(|number| *number < first_camera);
        let (objects, points) = (coupled(&terms.objects, &numbers), coupled(&terms.points, &numbers));
        let mut segment = numbers.len().max(1);
        let first_columns = |segment: usize| first_columns(numbers.len(), time_steps, segment, &objects, &points);
        while Envelope::work(&first_columns(segment)) > MAX_FACTOR_WORK {
            segment = segment.div_ceil(2);
        }
        let mut of_points = Envelope::zeros(&first_columns(segment));
        let mut information = of_points.clone();
        let mut right = vec![Motion::zeros(); numbers.len()];
        for (terms, at) in terms.points.iter().zip(&points).filter(|(_, at)| lies_within(at, segment)) {
            Coupling::add(terms, at, segment, &mut of_points, &mut right);
        }
        let couplings = (terms.objects.iter().zip(&objects))
            .filter_map(|(terms, at)| Coupling::add(terms, at, segment, &mut information, &mut right))
            .collect();
        information.add_all(&of_points);
        let beyond = (segment < numbers.len()).then(|| Whole::new(terms, &numbers, couplings));
        Self { numbers, time_steps, segment, information, of_points, right, beyond }
    }

    /// The numbers of the motions, ascending.
    pub(crate) fn numbers(&self) -> &[usize] {
        &self.numbers
    }

    /// The product of the information with motions.
    fn times(&self, x: &[Motion]) -> Vec<Motion> {
        let Some(Whole { diagonal, cross, couplings }) = &self.beyond else { return self.information.times(x) };
        let mut product = self.of_points.times(x);
        for (k, block) in diagonal.iter().enumerate() {
            product[k] += block * x[k];
        }
        for ((row, column), block) in cross {
            product[*row] += block * x[*column];
            product[*column] += block.tr_mul(&x[*row]);
        }
        for Coupling { motions } in couplings {
            let sum: SVector<f64, PARAMETERS> = motions.iter().map(|(k, block)| block.tr_mul(&x[*k])).sum();
            motions.iter().for_each(|(k, block)| product[*k] -= block * sum);
        }
        product
    }
}

/// The positions of the motions that each couples; those of the camera in a rig are coupled with its time steps, too.
fn coupled<const N: usize>(terms: &[PoseTerms<N>], numbers: &[usize]) -> Vec<Coupled> {
    let position = |number: usize| numbers.partition_point(|other| *other < number);
    let of = |terms: &PoseTerms<N>| {
        let mut positions: Coupled = terms.frames.iter().map(|term| position(term.frame)).collect();
        positions.sort_unstable();
        positions
    };
    terms.iter().map(of).collect()
}

/// Whether all positions lie in one segment.
fn lies_within(positions: &[usize], segment: usize) -> bool {
    positions.first().zip(positions.last()).is_none_or(|(first, last)| first / segment == last / segment)
}

/// The first column of each row if only rows of the same segment are coupled.
fn first_columns(
    count: usize,
    time_steps: usize,
    segment: usize,
    objects: &[Coupled],
    points: &[Coupled],
) -> Vec<usize> {
    let start = |k: usize| k / segment * segment;
    let mut first: Vec<usize> = (0..count).collect();
    for (k, first) in first.iter_mut().enumerate().take(time_steps) {
        if k > start(k) {
            *first = k - 1;
        }
    }
    for positions in objects.iter().chain(points.iter().filter(|positions| lies_within(positions, segment))) {
        let mut least = usize::MAX;
        for k in positions {
            if least == usize::MAX || least < start(*k) {
                least = *k;
            }
            first[*k] = first[*k].min(least);
        }
    }
    first
}

impl<const N: usize> Coupling<N> {
    /// Adds what an object or a point says, itself eliminated, within the segments; `None` where it says nothing.
    fn add(
        terms: &PoseTerms<N>,
        positions: &Coupled,
        segment: usize,
        information: &mut Envelope,
        right: &mut [Motion],
    ) -> Option<Self> {
        let root = nalgebra::Cholesky::new(terms.covariance)?.l();
        let numbers: Vec<usize> = {
            let mut numbers: Vec<usize> = terms.frames.iter().map(|term| term.frame).collect();
            numbers.sort_unstable();
            numbers
        };
        let place = |number: &usize| positions[numbers.partition_point(|other| other < number)];
        let mut motions = Vec::with_capacity(terms.frames.len());
        for term in &terms.frames {
            let k = place(&term.frame);
            information.add(k, k, &term.information);
            right[k] -= term.gradient + term.coupling * terms.step;
            motions.push((k, term.coupling * root));
        }
        motions.stable_sort_by_key(|(k, _)| *k);
        for ((row, column), block) in &terms.cross {
            let (row, column) = (place(row), place(column));
            if row / segment == column / segment {
                information.add(row, column, block);
            }
        }
        for (at, (row, a)) in motions.iter().enumerate() {
            for (column, b) in motions[..=at].iter().filter(|(column, _)| *column / segment == *row / segment) {
                information.add(*row, *column, &-(a * b.transpose()));
            }
        }
        Some(Self { motions })
    }
}

impl Whole {
    fn new(terms: &SceneTerms, numbers: &[usize], couplings: Vec<Coupling<PARAMETERS>>) -> Self {
        let position = |number: usize| numbers.partition_point(|other| *other < number);
        let mut diagonal = vec![Matrix6::zeros(); numbers.len()];
        let mut cross = Vec::new();
        for object in terms.objects.iter().filter(|object| nalgebra::Cholesky::new(object.covariance).is_some()) {
            object.frames.iter().for_each(|term| diagonal[position(term.frame)] += term.information);
            cross.extend(
                object.cross.iter().map(|((row, column), block)| ((position(*row), position(*column)), *block)),
            );
        }
        Self { diagonal, cross, couplings }
    }
}

/// The solved equations.
#[derive(Debug, Clone)]
pub(crate) struct PoseSystem {
    step: Vec<Motion>,
    /// The corrections after the step.
    motions: Vec<Motion>,
    covariance: Envelope,
    /// Logarithm of the evidence for the levels, against that for poses that are exact.
    log_evidence: f64,
}

impl PoseSystem {
    /// Solves the equations with the prior; `None` where they are singular or nothing is seen. `before` is the correction of a motion so
    /// far.
    pub(crate) fn new(equations: &PoseEquations, levels: PoseLevels, before: impl Fn(usize) -> Motion) -> Option<Self> {
        let PoseEquations { numbers, time_steps, segment, information, right, .. } = equations;
        let prior = Prior::new(numbers, *time_steps, levels);
        let motions: Vec<Motion> = numbers.iter().map(|number| before(*number)).collect();
        let mut matrix = information.clone();
        prior.add_to(&mut matrix, *segment);
        let factor = matrix.factor()?;
        let mut with_prior = vec![Motion::zeros(); numbers.len()];
        prior.add_product(&motions, &mut with_prior);
        with_prior.iter_mut().zip(right).for_each(|(product, right)| *product = right - *product);
        let step = if *segment >= numbers.len() {
            factor.solve(&with_prior)
        } else {
            conjugate_gradients(equations, &prior, &factor, &with_prior)
        };
        // What the measurements say, as a normal distribution of the motions: integrated with the prior (method, section 11.2).
        let told = equations.times(&motions);
        let explained = (0..numbers.len()).map(|k| (right[k] + told[k]).dot(&(motions[k] + step[k]))).sum::<f64>();
        let log_evidence = 0.5 * (levels.log_determinant(numbers) - factor.log_determinant() + explained);
        let is_finite = step.iter().all(|motion| motion.iter().all(|x| x.is_finite()));
        let motions = motions.iter().zip(&step).map(|(before, step)| before + step).collect();
        is_finite.then(|| Self { step, motions, covariance: factor.inverse(), log_evidence })
    }

    /// Logarithm of the evidence for the levels, against that for poses that are exact.
    pub(crate) fn log_evidence(&self) -> f64 {
        self.log_evidence
    }

    /// The step of each motion.
    pub(crate) fn step(&self) -> &[Motion] {
        &self.step
    }

    /// Covariance of the motions with two numbers (rows, columns); `None` where no object or point couples them.
    pub(crate) fn covariance(&self, equations: &PoseEquations, number: usize, other: usize) -> Option<Matrix6<f64>> {
        let place = |number: usize| equations.numbers.binary_search(&number).ok();
        self.covariance.block(place(number)?, place(other)?)
    }

    /// Of the parameters that the measurements determine, the share that points do.
    pub(crate) fn share_of_points(&self, equations: &PoseEquations) -> f64 {
        let all = equations.information.trace_of_product(&self.covariance);
        let of_points = equations.of_points.trace_of_product(&self.covariance);
        if all > 0.0 { (of_points / all).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The standard deviations that the corrections show (MacKay's rule), and the number of parameters that the measurements determine.
    /// `levels` are those of the equations; they change by a factor of `largest_step`, at most.
    pub(crate) fn levels(&self, equations: &PoseEquations, levels: PoseLevels, largest_step: f64) -> (PoseLevels, f64) {
        let motions = &self.motions;
        let time_steps = levels.time_steps(&equations.numbers);
        let precision = levels.precision(time_steps);
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
        let all = 3.0 * time_steps.len() as f64;
        // Where cameras look at objects around one place, turns and shifts of a camera look alike: the measurements then say hardly more than one
        // of the two levels, and the other one would become zero.
        let of = |from: usize, level: f64, usual: f64, other: f64| {
            let sum = |of: &Motion| of.fixed_rows::<3>(from).sum();
            let determined = (all - sum(&spread) / (level * level)).clamp(0.0, all);
            let expected = other * usual;
            let updated = ((sum(&squares) + TIED * expected * expected) / (determined + TIED)).sqrt();
            let updated = updated.clamp(level / largest_step, largest_step * level);
            (updated.clamp(MIN_LEVEL_FACTOR * usual, MAX_LEVEL_FACTOR * usual), determined)
        };
        let (usual, now) = (levels.first, levels.noise);
        let [rotation, translation] = [now.rotation_sd / usual.rotation_sd, now.translation_sd / usual.translation_sd];
        let (rotation_sd, rotations) = of(0, now.rotation_sd, usual.rotation_sd, translation);
        let (translation_sd, shifts) = of(3, now.translation_sd, usual.translation_sd, rotation);
        (PoseLevels { noise: PoseNoise { rotation_sd, translation_sd }, ..levels }, rotations + shifts)
    }
}

/// The precision of the prior.
struct Prior {
    precision: Vec<(f64, f64)>,
    /// Of each component, of the motion at this position.
    scales: Vec<Motion>,
    /// So many motions, the first ones, follow each other.
    correlated: usize,
}

impl Prior {
    fn new(numbers: &[usize], time_steps: usize, levels: PoseLevels) -> Self {
        let scales = numbers.iter().map(|number| levels.scale(*number)).collect();
        let correlated = if levels.is_correlated() { time_steps } else { 0 };
        Self { precision: levels.precision(numbers), scales, correlated }
    }

    /// The couplings of the motions that follow each other: position, and the diagonal of the block with the one before.
    fn couplings(&self) -> impl Iterator<Item = (usize, Motion)> {
        (1..self.correlated).map(|k| (k, self.scales[k] * self.precision[k].1))
    }

    fn add_to(&self, matrix: &mut Envelope, segment: usize) {
        for (k, (scale, (with_itself, _))) in self.scales.iter().zip(&self.precision).enumerate() {
            matrix.add(k, k, &Matrix6::from_diagonal(&(scale * *with_itself)));
        }
        for (k, with_before) in self.couplings().filter(|(k, _)| !k.is_multiple_of(segment)) {
            matrix.add(k, k - 1, &Matrix6::from_diagonal(&with_before));
        }
    }

    fn add_product(&self, x: &[Motion], product: &mut [Motion]) {
        for (k, (scale, (with_itself, _))) in self.scales.iter().zip(&self.precision).enumerate() {
            product[k] += scale.component_mul(&x[k]) * *with_itself;
        }
        for (k, with_before) in self.couplings() {
            product[k] += with_before.component_mul(&x[k - 1]);
            product[k - 1] += with_before.component_mul(&x[k]);
        }
    }
}

fn conjugate_gradients(
    equations: &PoseEquations,
    prior: &Prior,
    preconditioner: &Factor,
    right: &[Motion],
) -> Vec<Motion> {
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
        let mut product = equations.times(&direction);
        prior.add_product(&direction, &mut product);
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

#[cfg(test)]
impl PoseSystem {
    /// The square of what the measurements show, in units of its covariance.
    pub(crate) fn explained(&self, equations: &PoseEquations) -> f64 {
        equations.right.iter().zip(&self.step).map(|(a, b)| a.dot(b)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{normal, stream};
    use crate::solve::posterior::shared::pose_terms::FrameTerm;
    use nalgebra::{Cholesky, DMatrix, DVector, SVector};

    const FRAMES: [usize; 3] = [2, 3, 7];
    const ROWS: usize = 10;

    /// Logarithm of the density of the residuals, with motions and parameters integrated out: those have a wide prior.
    fn marginal(residuals: &DVector<f64>, by: &DMatrix<f64>, by_object: &DMatrix<f64>, levels: PoseLevels) -> f64 {
        let sd = levels.scale(0).map(|scale| scale.powf(-0.5));
        let covariance = DMatrix::from_fn(6 * FRAMES.len(), 6 * FRAMES.len(), |i, j| {
            let gap = FRAMES[i / 6].abs_diff(FRAMES[j / 6]) as f64;
            let correlation = if i / 6 == j / 6 { 1.0 } else { (-gap / levels.correlation_length).exp() };
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
        let objects = vec![PoseTerms { frames, cross: Vec::new(), covariance, step }];
        let equations = PoseEquations::new(&SceneTerms { objects, points: Vec::new() }, usize::MAX);
        let of = |rotation_sd, translation_sd, correlation_length| {
            let noise = PoseNoise { rotation_sd, translation_sd };
            let levels =
                PoseLevels { noise, correlation_length, extrinsics: noise, first: noise, first_camera: usize::MAX };
            let system = PoseSystem::new(&equations, levels, |_| Motion::zeros()).unwrap();
            (system.log_evidence(), marginal(&residuals, &by, &by_object, levels))
        };
        let (first, expected_first) = of(0.3, 0.5, 1e-9);
        for (rotation_sd, translation_sd, correlation_length) in [(0.3, 0.5, 10.0), (0.1, 0.7, 3.0), (2.0, 0.01, 100.0)]
        {
            let (found, expected) = of(rotation_sd, translation_sd, correlation_length);
            let (found, expected) = (found - first, expected - expected_first);
            assert!(
                (found - expected).abs() < 1e-4 * expected.abs().max(1.0),
                "{correlation_length}: {found} {expected}"
            );
        }
    }
}

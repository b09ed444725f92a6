//! The normal equations of the scales of cues, from which the objects are eliminated: few scales of sources and many of frames.
//!
//! Objects couple the scales of all frames in which they are seen, so that the matrix is full. With many frames it is not built:
//! conjugate gradients multiply with it object by object, in time linear in the measurements, preconditioned by its arrow part, the
//! scales of sources with each other and with those of frames, and each frame with itself.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SVector};

use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::estimate::Matrix9;

/// Most scales of which the matrix is built.
const MAX_DENSE_SCALES: usize = 200;

/// Most iterations of conjugate gradients.
const ITERATIONS: usize = 50;

/// Norm of the residual, relative to that of the right side, at which they end.
const TOLERANCE: f64 = 1e-8;

/// What an object tells about one scale.
#[derive(Debug, Clone)]
pub(super) struct Told {
    /// Position of the scale.
    pub index: usize,
    /// Sum of weighted squares of the derivatives.
    pub information: f64,
    /// Gradient when the object follows.
    pub gradient: f64,
    /// Products of derivatives by the scale and by the object's parameters.
    pub coupling: SVector<f64, PARAMETERS>,
    /// Positions of constants of the source that the same measurements contain, with the sums of weighted products of both
    /// derivatives. Each pair is with one of its two.
    pub with: Vec<(usize, f64)>,
}

/// The equations.
#[derive(Debug)]
pub(super) struct ScaleSystem {
    /// Position of each scale among those of its kind, and whether it is one of many frames.
    places: Vec<(usize, bool)>,
    /// Priors and information.
    diagonal: DVector<f64>,
    gradient: DVector<f64>,
    objects: Vec<(Vec<Told>, Matrix9)>,
}

/// The covariance of the scales: exact with few frames. With many it leaves out what they have in common beyond the scales of sources, whose
/// rows are exact.
#[derive(Debug, Clone)]
pub(super) struct ScaleCovariance {
    /// Covariance of the scales of sources.
    sources: DMatrix<f64>,
    /// For each scale, the row that makes it of those of the sources, and the variance that is left.
    rows: Vec<(DVector<f64>, f64)>,
}

impl Default for ScaleCovariance {
    fn default() -> Self {
        Self { sources: DMatrix::zeros(0, 0), rows: Vec::new() }
    }
}

/// The arrow part, factorized.
struct Arrow {
    /// Cholesky factors of the sources' block, without the frames.
    sources: Cholesky<f64, Dyn>,
    /// For each frame, its inverse diagonal and its entries in the rows of the sources.
    frames: Vec<(f64, DVector<f64>)>,
}

impl ScaleSystem {
    /// No equations for scales, of which these are those of frames.
    pub(super) fn new(of_frames: Vec<bool>) -> Self {
        Self::with_dense(of_frames, MAX_DENSE_SCALES)
    }

    fn with_dense(of_frames: Vec<bool>, most: usize) -> Self {
        let count = of_frames.len();
        let mut next = [0, 0];
        let mut place = |is_frame: bool| {
            next[usize::from(is_frame)] += 1;
            (next[usize::from(is_frame)] - 1, is_frame)
        };
        let places = of_frames.into_iter().map(|is_frame| place(is_frame && count > most)).collect();
        Self { places, diagonal: DVector::zeros(count), gradient: DVector::zeros(count), objects: Vec::new() }
    }

    /// Adds a prior on a scale.
    pub(super) fn add_prior(&mut self, index: usize, precision: f64, gradient: f64) {
        self.diagonal[index] += precision;
        self.gradient[index] += gradient;
    }

    /// Adds what an object tells; `covariance` is that of its parameters were the scales known.
    pub(super) fn add_object(&mut self, told: Vec<Told>, covariance: Matrix9) {
        for term in &told {
            self.diagonal[term.index] += term.information;
            self.gradient[term.index] += term.gradient;
        }
        self.objects.push((told, covariance));
    }

    /// The solution for the gradient and the covariance of the scales; `None` if the matrix is not positive definite.
    pub(super) fn solve(&self) -> Option<(DVector<f64>, ScaleCovariance)> {
        let arrow = self.arrow()?;
        let solution = self.solved(&arrow, &self.gradient);
        let mut covariance = ScaleCovariance { sources: arrow.sources.inverse(), rows: Vec::new() };
        // The columns of the sources, and what makes each row of those of the sources.
        let mut columns = Vec::new();
        if !arrow.frames.is_empty() {
            let unit = |k: usize| DVector::from_fn(self.places.len(), |l, _| f64::from(u8::from(k == l)));
            let sources: Vec<usize> = (0..self.places.len()).filter(|&k| !self.places[k].1).collect();
            columns = sources.iter().map(|&k| self.solved(&arrow, &unit(k))).collect();
            covariance.sources = DMatrix::from_fn(sources.len(), sources.len(), |i, j| columns[j][sources[i]]);
        }
        let inverse = covariance.sources.clone().cholesky();
        for (k, &(position, is_frame)) in self.places.iter().enumerate() {
            covariance.rows.push(if is_frame {
                let row = DVector::from_iterator(columns.len(), columns.iter().map(|column| column[k]));
                (inverse.as_ref()?.solve(&row), arrow.frames[position].0)
            } else {
                (DVector::from_fn(covariance.sources.nrows(), |k, _| f64::from(u8::from(k == position))), 0.0)
            });
        }
        Some((solution, covariance))
    }

    /// The solution for a right side.
    fn solved(&self, arrow: &Arrow, right: &DVector<f64>) -> DVector<f64> {
        let mut solution = self.precondition(arrow, right);
        if !arrow.frames.is_empty() {
            self.iterate(arrow, right, &mut solution);
        }
        solution
    }

    /// Conjugate gradients from where the arrow part ends.
    fn iterate(&self, arrow: &Arrow, right: &DVector<f64>, solution: &mut DVector<f64>) {
        let mut residual = right - self.times(solution);
        let mut improved = self.precondition(arrow, &residual);
        let mut direction = improved.clone();
        let mut product = residual.dot(&improved);
        for _ in 0..ITERATIONS {
            if residual.norm() <= TOLERANCE * right.norm() {
                break;
            }
            let image = self.times(&direction);
            let length = product / direction.dot(&image);
            if !(length.is_finite() && length > 0.0) {
                break;
            }
            *solution += &direction * length;
            residual -= image * length;
            improved = self.precondition(arrow, &residual);
            let next = residual.dot(&improved);
            direction = &improved + direction * (next / product);
            product = next;
        }
    }

    /// The matrix times a vector.
    fn times(&self, x: &DVector<f64>) -> DVector<f64> {
        let mut image = self.diagonal.component_mul(x);
        for (told, covariance) in &self.objects {
            let parameters: SVector<f64, PARAMETERS> = told.iter().map(|term| term.coupling * x[term.index]).sum();
            let moved = covariance * parameters;
            for term in told {
                image[term.index] -= term.coupling.dot(&moved);
                for &(source, information) in &term.with {
                    image[term.index] += information * x[source];
                    image[source] += information * x[term.index];
                }
            }
        }
        image
    }

    /// The arrow part of the matrix.
    fn arrow(&self) -> Option<Arrow> {
        let of_frames = self.places.iter().filter(|(_, is_frame)| *is_frame).count();
        let of_sources = self.places.len() - of_frames;
        let mut normal = DMatrix::<f64>::zeros(of_sources, of_sources);
        let mut frames = vec![(0.0, DVector::<f64>::zeros(of_sources)); of_frames];
        for (k, &(position, is_frame)) in self.places.iter().enumerate() {
            if is_frame {
                frames[position].0 = self.diagonal[k]
            } else {
                normal[(position, position)] = self.diagonal[k]
            }
        }
        for (told, covariance) in &self.objects {
            let (sources, of_frame): (Vec<&Told>, Vec<&Told>) =
                told.iter().partition(|term| !self.places[term.index].1);
            let position = |term: &Told| self.places[term.index].0;
            for term in &sources {
                let seen = covariance * term.coupling;
                for other in &sources {
                    normal[(position(other), position(term))] -= other.coupling.dot(&seen);
                }
                for other in &of_frame {
                    frames[position(other)].1[position(term)] -= other.coupling.dot(&seen);
                }
                for &(source, information) in &term.with {
                    let source = self.places[source].0;
                    normal[(position(term), source)] += information;
                    normal[(source, position(term))] += information;
                }
            }
            for term in &of_frame {
                let (diagonal, entries) = &mut frames[position(term)];
                *diagonal -= term.coupling.dot(&(covariance * term.coupling));
                for &(source, information) in &term.with {
                    entries[self.places[source].0] += information;
                }
            }
        }
        let mut sources = (&normal + normal.transpose()) * 0.5;
        for (diagonal, entries) in &frames {
            // Priors keep it positive.
            sources.ger(-1.0 / diagonal, entries, entries, 1.0);
        }
        let frames = frames.into_iter().map(|(diagonal, entries)| (1.0 / diagonal, entries)).collect();
        Some(Arrow { sources: sources.cholesky()?, frames })
    }

    /// The inverse of the arrow part times a vector.
    fn precondition(&self, arrow: &Arrow, x: &DVector<f64>) -> DVector<f64> {
        let mut of_sources = DVector::zeros(arrow.sources.l_dirty().nrows());
        for (value, &(position, is_frame)) in x.iter().zip(&self.places) {
            if is_frame {
                let (inverse, entries) = &arrow.frames[position];
                of_sources.axpy(-inverse * value, entries, 1.0);
            } else {
                of_sources[position] += value;
            }
        }
        let of_sources = arrow.sources.solve(&of_sources);
        let value = |(value, &(position, is_frame)): (&f64, &(usize, bool))| {
            if !is_frame {
                return of_sources[position];
            }
            let (inverse, entries) = &arrow.frames[position];
            inverse * (value - entries.dot(&of_sources))
        };
        DVector::from_iterator(x.len(), x.iter().zip(&self.places).map(value))
    }
}

impl ScaleCovariance {
    /// An entry of the covariance; 0 before there is one.
    pub(super) fn entry(&self, k: usize, l: usize) -> f64 {
        let (Some((a, own)), Some((b, _))) = (self.rows.get(k), self.rows.get(l)) else { return 0.0 };
        a.dot(&(&self.sources * b)) + if k == l { *own } else { 0.0 }
    }

    /// The covariance of an object's parameters that move by these gains with the scales, by their positions.
    pub(super) fn between(&self, gains: &[(usize, SVector<f64, PARAMETERS>)]) -> Matrix9 {
        let mut covariance = Matrix9::zeros();
        let mut by_source = DMatrix::zeros(PARAMETERS, self.sources.nrows());
        for (position, gain) in gains {
            let Some((row, own)) = self.rows.get(*position) else { continue };
            covariance += gain * gain.transpose() * *own;
            by_source += gain * row.transpose();
        }
        covariance + &by_source * &self.sources * by_source.transpose()
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Two sources, and objects that are each seen in some of the frames of the second one.
    fn system(frames: usize, share: f64, most_dense: usize) -> (ScaleSystem, DMatrix<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let count = frames + 2;
        let mut system = ScaleSystem::with_dense((0..count).map(|k| k >= 2).collect(), most_dense);
        let mut matrix = DMatrix::zeros(count, count);
        for k in 0..count {
            let precision = rng.random_range(5.0..100.0);
            system.add_prior(k, precision, rng.random_range(-1.0..1.0));
            matrix[(k, k)] += precision;
        }
        for _ in 0..3 * frames {
            let mut told = Vec::new();
            let mut sum = (0.0, SVector::zeros());
            for index in 2..count {
                if rng.random_range(0.0..1.0) > 0.4 {
                    continue;
                }
                let information = rng.random_range(10.0..200.0f64);
                // All of an object's depths move with its position.
                let mut coupling = SVector::zeros();
                coupling[0] = (share * information).sqrt();
                coupling[1 + index % 4] = (0.2 * share * information).sqrt();
                told.push(Told {
                    index,
                    information,
                    gradient: rng.random_range(-3.0..3.0),
                    coupling,
                    with: vec![(1, information)],
                });
                sum = (sum.0 + information, sum.1 + coupling);
            }
            told.push(Told { index: 1, information: sum.0, gradient: 0.5, coupling: sum.1, with: Vec::new() });
            let scale: f64 = told.iter().map(|term| term.coupling.norm_squared() / term.information).sum();
            let covariance = Matrix9::identity() * (0.5 / scale.max(1.0));
            for a in &told {
                matrix[(a.index, a.index)] += a.information;
                for b in &told {
                    matrix[(a.index, b.index)] -= a.coupling.dot(&(covariance * b.coupling));
                }
            }
            // The source's scale is in every row of a frame.
            for a in told.iter().filter(|term| term.index >= 2) {
                matrix[(a.index, 1)] += a.information;
                matrix[(1, a.index)] += a.information;
            }
            system.add_object(told, covariance);
        }
        (system, matrix)
    }

    #[test]
    fn conjugate_gradients_solve_the_full_equations() {
        for (frames, share) in [(0, 0.5), (1, 0.5), (4, 0.1), (4, 0.6), (60, 0.1), (60, 0.6)] {
            for most_dense in [0, MAX_DENSE_SCALES] {
                let (system, matrix) = system(frames, share, most_dense);
                let (solution, covariance) = system.solve().unwrap();
                let exact = matrix.clone().cholesky().unwrap();
                let off = (&solution - exact.solve(&system.gradient)).amax();
                assert!(off < 1e-7 * solution.amax(), "{frames} frames: {off} {}", solution.amax());
                let inverse = exact.inverse();
                for k in 0..frames + 2 {
                    for l in 0..frames + 2 {
                        let off =
                            (covariance.entry(k, l) - inverse[(k, l)]) / (inverse[(k, k)] * inverse[(l, l)]).sqrt();
                        // The arrow leaves out what is coupled by objects.
                        let is_exact = most_dense > 0 || k < 2 || l < 2;
                        let most = if is_exact { 1e-6 } else { 0.3 };
                        assert!(off.abs() < most, "{frames} frames, share {share}, {k}, {l}: {off}");
                    }
                }
                let gains = [(0, SVector::from_element(0.3)), (frames + 1, SVector::from_element(-0.2))];
                let between = covariance.between(&gains)[(4, 5)];
                let entry = |k, l| covariance.entry(k, l);
                let expected = 0.09 * entry(0, 0) - 0.12 * entry(0, frames + 1) + 0.04 * entry(frames + 1, frames + 1);
                assert!((between - expected).abs() < 1e-12, "{between} {expected}");
            }
        }
    }
}

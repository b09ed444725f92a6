//! The E step: which stel each pixel belongs to, given everything else.

use super::model::Model;
use crate::palette::{LogDensity, mixture_row, part};
use crate::vector_math::{dot, exp, ln};

/// What the E step finds out about one row of the grid; one list for each stel, one after the other.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Number of pixels.
    pub length: usize,
    /// The first pixel.
    pub start: usize,
    /// `p(s)`, blended from the components.
    pub prior: Vec<f32>,
    /// `log b_s(z)`; 0 for pixels outside of the image.
    pub log_likelihood: Vec<f32>,
    /// `q(s) ~ p(s) b_s(z)^eta`.
    pub posterior: Vec<f32>,
    /// Part of each Gaussian in its stel's palette; a list for each of them, the stel's first.
    pub responsibilities: Vec<f32>,
    /// Numbers for use inside.
    top: Vec<f32>,
    total: Vec<f32>,
    log_evidence: Vec<f32>,
}

impl Row {
    pub(super) fn new(length: usize, stels: usize, gaussians: usize) -> Self {
        let zeros = |count: usize| vec![0.0; count * length];
        Self {
            length,
            start: 0,
            prior: zeros(stels),
            log_likelihood: zeros(stels),
            posterior: zeros(stels),
            responsibilities: zeros(stels * gaussians),
            top: zeros(1),
            total: zeros(1),
            log_evidence: zeros(1),
        }
    }

    /// The part of a list that belongs to a stel.
    pub(super) fn of(&self, s: usize) -> std::ops::Range<usize> {
        s * self.length..(s + 1) * self.length
    }
}

impl Model<'_> {
    /// Memory for the E step of one row.
    pub(super) fn row(&self) -> Row {
        Row::new(self.frames.grid, self.options.stels, self.options.gaussians)
    }

    /// Visits the rows of a frame with their posteriors; returns the frame's part of F.
    pub(super) fn expect(&self, t: usize, row: &mut Row, mut visit: impl FnMut(&mut Row)) -> f64 {
        let densities: Vec<LogDensity> = self.palettes[t].iter().flatten().map(LogDensity::new).collect();
        let mut free_energy = 0.0;
        for start in (0..self.frames.pixels()).step_by(row.length) {
            row.start = start;
            free_energy += self.expect_row(t, &densities, row);
            visit(row);
        }
        free_energy
    }

    fn expect_row(&self, t: usize, densities: &[LogDensity], row: &mut Row) -> f64 {
        let n = row.length;
        let range = row.start..row.start + n;
        let frame = &self.frames.frames[t];
        let (colors, seen) = (part(&frame.colors, range.clone()), &frame.seen[range.clone()]);
        let per_stel = self.options.gaussians;

        let stels = densities.chunks_exact(per_stel).zip(row.responsibilities.chunks_exact_mut(per_stel * n));
        for ((densities, responsibilities), log_likelihood) in stels.zip(row.log_likelihood.chunks_exact_mut(n)) {
            mixture_row(densities, colors, responsibilities, log_likelihood);
            for (value, seen) in log_likelihood.iter_mut().zip(seen) {
                *value *= seen;
            }
        }
        for (s, prior) in row.prior.chunks_exact_mut(n).enumerate() {
            prior.fill(0.0);
            for (k, &y) in self.mixing[t].iter().enumerate() {
                for (p, r) in prior.iter_mut().zip(&self.stels.map(k, s)[range.clone()]) {
                    *p += y * r;
                }
            }
        }

        // q ~ p b^eta, relative to the stel with the largest b that the pixel may belong to.
        let allowed = &self.allowed[range];
        for (s, log_likelihood) in row.log_likelihood.chunks_exact(n).enumerate() {
            if s == 0 {
                for ((top, &value), &allowed) in row.top.iter_mut().zip(log_likelihood).zip(allowed) {
                    *top = value - (1.0 - allowed) * NEVER;
                }
            } else {
                for (top, &value) in row.top.iter_mut().zip(log_likelihood) {
                    *top = if value > *top { value } else { *top };
                }
            }
        }
        let (top, total) = (&row.top[..n], &mut row.total[..n]);
        total.fill(0.0);
        let eta = self.tempering;
        let lists = row.prior.chunks_exact(n).zip(row.log_likelihood.chunks_exact(n));
        for (s, (posterior, (prior, log_likelihood))) in row.posterior.chunks_exact_mut(n).zip(lists).enumerate() {
            for i in 0..n {
                // An excluded pixel may lie far above the top; exp is finite for any argument.
                posterior[i] = prior[i] * exp(eta * (log_likelihood[i] - top[i]));
            }
            if s == 0 {
                posterior.iter_mut().zip(allowed).for_each(|(q, allowed)| *q *= allowed);
            }
            total.iter_mut().zip(&*posterior).for_each(|(total, q)| *total += q);
        }
        let log_evidence = &mut row.log_evidence[..n];
        for i in 0..n {
            log_evidence[i] = ln(total[i]) + eta * top[i];
            total[i] = 1.0 / total[i];
        }
        let free_energy = -dot(log_evidence, seen);
        for posterior in row.posterior.chunks_exact_mut(n) {
            for (q, inverse) in posterior.iter_mut().zip(&row.total) {
                *q *= inverse;
            }
        }
        f64::from(free_energy)
    }
}

/// Larger than any log likelihood, small enough for f32.
const NEVER: f32 = 1e30;

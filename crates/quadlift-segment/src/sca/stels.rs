//! Where the stels are: the maps of the components.

use crate::blur::Blur;
use crate::box_prior::BoxPrior;
use crate::vector_math::{dot, ln};

/// Probabilities `r[k][s][i]` of stel s at pixel i in component k; they sum to 1 over the stels.
#[derive(Debug, Clone)]
pub(super) struct Stels {
    pub components: usize,
    pub count: usize,
    pub pixels: usize,
    maps: Vec<f32>,
}

impl Stels {
    /// One component: the prior of the box, shared out evenly over the background's stels.
    pub(super) fn from_prior(prior: &BoxPrior, count: usize) -> Self {
        let pixels = prior.object.len();
        let mut maps = Vec::with_capacity(count * pixels);
        for s in 0..count {
            maps.extend(prior.object.iter().map(|&p| stel_prior(p, s, count)));
        }
        Self { components: 1, count, pixels, maps }
    }

    /// All zeros: to count votes in.
    pub(super) fn zeros(components: usize, count: usize, pixels: usize) -> Self {
        Self { components, count, pixels, maps: vec![0.0; components * count * pixels] }
    }

    /// The map of stel s in component k.
    pub(super) fn map(&self, k: usize, s: usize) -> &[f32] {
        let start = (k * self.count + s) * self.pixels;
        &self.maps[start..start + self.pixels]
    }

    pub(super) fn map_mut(&mut self, k: usize, s: usize) -> &mut [f32] {
        let start = (k * self.count + s) * self.pixels;
        &mut self.maps[start..start + self.pixels]
    }

    /// Multiplies entry by entry.
    pub(super) fn multiply(&mut self, other: &Self) {
        self.maps.iter_mut().zip(&other.maps).for_each(|(a, b)| *a *= b);
    }

    /// Turns counts (in frames) into probabilities: blurred, the prior added as `prior_frames` further frames,
    /// normalized.
    pub(super) fn normalize_counts(&mut self, prior: &BoxPrior, prior_frames: f32, blur: &Blur, grid: usize) {
        // So that no probability is zero, whatever the weight of the prior.
        const TRACE: f32 = 1e-6;
        let count = self.count;
        let mut scratch = Vec::new();
        let mut total = vec![0.0f32; self.pixels];
        for k in 0..self.components {
            total.fill(0.0);
            for s in 0..count {
                let map = self.map_mut(k, s);
                blur.apply(map, grid, &mut scratch);
                for ((value, total), &p) in map.iter_mut().zip(&mut total).zip(&prior.object) {
                    *value += prior_frames * stel_prior(p, s, count) + TRACE;
                    *total += *value;
                }
            }
            for s in 0..count {
                for (value, total) in self.map_mut(k, s).iter_mut().zip(&total) {
                    *value /= total;
                }
            }
        }
    }

    /// `sum p0 log r` over all components.
    pub(super) fn log_prior(&self, prior: &BoxPrior) -> f64 {
        let mut logs = vec![0.0; self.pixels];
        let mut total = 0.0;
        for k in 0..self.components {
            for s in 0..self.count {
                for (log, &r) in logs.iter_mut().zip(self.map(k, s)) {
                    *log = ln(r);
                }
                let share = if s == 0 { 0.0 } else { 1.0 / (self.count - 1) as f32 };
                let object = f64::from(dot(&prior.object, &logs));
                let all = logs.iter().map(|&x| f64::from(x)).sum::<f64>();
                total += if s == 0 { object } else { f64::from(share) * (all - object) };
            }
        }
        total
    }
}

/// `p0` of stel s where the object has the probability p.
fn stel_prior(p: f32, s: usize, count: usize) -> f32 {
    if s == 0 { p } else { (1.0 - p) / (count - 1) as f32 }
}

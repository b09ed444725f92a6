//! What the residuals of objects say about noise levels: sums over a scene.

use super::groups::{CORRELATIONS, GROUPS, NoiseGroup};

/// Weighted sums of squared whitened residuals and their degrees of freedom, by group.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct NoiseStatistics {
    pub(super) squares: [f64; GROUPS],
    pub(super) dof: [f64; GROUPS],
    /// Correlation of residuals in views that follow each other, times the number of pairs; that number. Of edges, of
    /// ellipses, of cues.
    pub(super) neighbors: [[f64; 2]; CORRELATIONS],
    /// Parameters that the measurements determine, and parameters.
    determined: [f64; 2],
    /// Sum over the objects of one over the number of views, and their number.
    inverse_views: [f64; 2],
}

impl NoiseStatistics {
    /// Adds a whitened residual with its weight, and what it adds to the degrees of freedom (one without robust losses,
    /// less its leverage: what the fit itself took of it).
    pub(crate) fn add(&mut self, group: NoiseGroup, residual: f64, weight: f64, dof: f64) {
        self.squares[group as usize] += weight * residual * residual;
        self.dof[group as usize] += dof;
    }

    /// Adds an object's correlation between its residuals in views that follow each other, of edges, of ellipses or of
    /// cues ([`NoiseGroup::correlated_with`]), over `pairs` of them.
    pub(crate) fn add_neighbors(&mut self, group: usize, correlation: f64, pairs: usize) {
        let [sum, number] = &mut self.neighbors[group];
        *sum += correlation * pairs as f64;
        *number += pairs as f64;
    }

    /// Adds an object: the sum of the leverages of its measurements is the number of parameters that they determine,
    /// the priors do the rest. It was seen in so many views.
    pub(crate) fn add_object(&mut self, leverage: f64, parameters: usize, views: usize) {
        self.determined[0] += leverage;
        self.determined[1] += parameters as f64;
        self.inverse_views[0] += 1.0 / views.max(1) as f64;
        self.inverse_views[1] += 1.0;
    }

    /// Takes off so many degrees of freedom, which what the objects share has taken of the residuals, of all groups by their shares; at most
    /// nine in ten.
    pub(crate) fn take(&mut self, parameters: f64) {
        let all: f64 = self.dof.iter().sum();
        if all > 0.0 {
            let left = (1.0 - parameters / all).max(0.1);
            self.dof.iter_mut().for_each(|dof| *dof *= left);
        }
    }

    /// Number of views of an object: the harmonic mean, so that one object of many views among others of few counts little.
    pub(super) fn usual_views(&self) -> f64 {
        if self.inverse_views[0] > 0.0 { self.inverse_views[1] / self.inverse_views[0] } else { 0.0 }
    }

    /// Fraction of the parameters that the measurements determine.
    pub(crate) fn determined(&self) -> f64 {
        self.determined[0] / self.determined[1].max(1.0)
    }

    /// Adds another object's statistics.
    pub(crate) fn merge(&mut self, other: &Self) {
        for g in 0..GROUPS {
            self.squares[g] += other.squares[g];
            self.dof[g] += other.dof[g];
        }
        for k in 0..2 {
            self.neighbors.iter_mut().zip(&other.neighbors).for_each(|(sum, more)| sum[k] += more[k]);
            self.determined[k] += other.determined[k];
            self.inverse_views[k] += other.inverse_views[k];
        }
    }
}

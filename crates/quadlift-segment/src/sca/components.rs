//! The first components: clusters of frames in which the object looks similar.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::expectation::Row;
use super::model::{Model, normalized};
use super::stels::Stels;
use crate::blur::Blur;
use crate::palette::draw_indices;

/// Restarts of k-means.
const RESTARTS: usize = 8;
/// Maximum number of k-means iterations.
const ROUNDS: usize = 15;

impl Model<'_> {
    /// Replaces the one component of the warm start by `count` that are learned from groups of frames with similar
    /// posteriors of the object.
    pub(super) fn split_into_components(&mut self, count: usize, rng: &mut ChaCha8Rng) {
        let frames = self.frames.frames.len();
        // With as many components as frames, each frame has its own.
        let groups = if count >= frames { (0..frames).collect() } else { alike(&self.coarse_posteriors(), count, rng) };
        let total = count.min(frames);
        self.mixing =
            groups.iter().map(|&g| normalized((0..total).map(|k| if k == g { 1.1 } else { 0.1 }).collect())).collect();
        let warm_mixing = vec![1.0];
        let mixing = std::mem::replace(&mut self.mixing, vec![warm_mixing; frames]);
        let mut counts = Stels::zeros(total, self.options.stels, self.frames.pixels());
        let mut row = Row::new(self.frames.grid, self.options.stels, self.options.gaussians);
        for (t, mixing) in mixing.iter().enumerate() {
            self.expect(t, &mut row, |row| {
                for (k, y) in mixing.iter().enumerate() {
                    for s in 0..self.options.stels {
                        let map = &mut counts.map_mut(k, s)[row.start..row.start + row.length];
                        for (count, q) in map.iter_mut().zip(&row.posterior[row.of(s)]) {
                            *count += y * q;
                        }
                    }
                }
            });
        }
        counts.normalize_counts(&self.frames.prior, self.prior_frames(), &self.blur, self.frames.grid);
        self.stels = counts;
        self.mixing = mixing;
    }

    /// The posterior of the object in each frame: blurred, every third pixel of every third row.
    fn coarse_posteriors(&self) -> Vec<Vec<f32>> {
        let grid = self.frames.grid;
        let mut row = Row::new(grid, self.options.stels, self.options.gaussians);
        let blur = Blur::new(2.0);
        let mut scratch = Vec::new();
        (0..self.frames.frames.len())
            .map(|t| {
                let mut object = vec![0.0; self.frames.pixels()];
                self.expect(t, &mut row, |row| {
                    object[row.start..row.start + row.length].copy_from_slice(&row.posterior[row.of(0)]);
                });
                blur.apply(&mut object, grid, &mut scratch);
                object.chunks_exact(grid).step_by(3).flat_map(|row| row.iter().step_by(3).copied()).collect()
            })
            .collect()
    }
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from((a - b) * (a - b))).sum()
}

/// The group of each point: k-means, the best of several starts by k-means++.
fn alike(points: &[Vec<f32>], count: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut best = (f64::INFINITY, vec![0; points.len()]);
    for _ in 0..RESTARTS {
        let candidate = k_means(points, count, rng);
        if candidate.0 < best.0 {
            best = candidate;
        }
    }
    best.1
}

/// The sum of squared distances to the nearest center, and the group of each point.
fn k_means(points: &[Vec<f32>], count: usize, rng: &mut ChaCha8Rng) -> (f64, Vec<usize>) {
    let mut centers = vec![points[rng.random_range(0..points.len())].clone()];
    let mut nearest = vec![f64::INFINITY; points.len()];
    while centers.len() < count {
        let last = &centers[centers.len() - 1];
        for (d, point) in nearest.iter_mut().zip(points) {
            *d = d.min(distance(point, last));
        }
        let drawn = draw_indices(nearest.iter().map(|d| d + 1e-9), 1, rng);
        centers.push(points[drawn.first().copied().unwrap_or(0)].clone());
    }
    let mut groups = vec![usize::MAX; points.len()];
    let mut cost = 0.0;
    for _ in 0..ROUNDS {
        let mut changed = false;
        cost = 0.0;
        for (group, point) in groups.iter_mut().zip(points) {
            let (mut index, mut least) = (0, f64::INFINITY);
            for (k, center) in centers.iter().enumerate() {
                let d = distance(point, center);
                if d < least {
                    (index, least) = (k, d);
                }
            }
            changed |= *group != index;
            *group = index;
            cost += least;
        }
        if !changed {
            break;
        }
        for (k, center) in centers.iter_mut().enumerate() {
            let members: Vec<&Vec<f32>> =
                groups.iter().zip(points).filter(|(group, _)| **group == k).map(|(_, point)| point).collect();
            if !members.is_empty() {
                for (i, value) in center.iter_mut().enumerate() {
                    *value = members.iter().map(|point| point[i]).sum::<f32>() / members.len() as f32;
                }
            }
        }
    }
    (cost, groups)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn clear_groups_are_found() {
        let points: Vec<Vec<f32>> = (0..30u8).map(|i| vec![f32::from(i % 3), f32::from(i) * 1e-3]).collect();
        let groups = alike(&points, 3, &mut ChaCha8Rng::seed_from_u64(2));
        for i in 3..30 {
            assert_eq!(groups[i], groups[i % 3]);
        }
        assert_ne!(groups[0], groups[1]);
        assert_ne!(groups[1], groups[2]);
        // The same points throughout: any groups will do.
        assert_eq!(alike(&vec![vec![1.0; 4]; 5], 3, &mut ChaCha8Rng::seed_from_u64(2)).len(), 5);
    }
}

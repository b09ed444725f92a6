//! Smooth labels: the graph cut of log-odds with a contrast term.

use std::ops::Range;

use crate::graph_cut::{GraphCut, NEIGHBORS};
use crate::palette::{Colors, part};
use crate::vector_math::exp;

/// The labelling of the grid's pixels that costs least, when neighbors with different labels cost
/// `strength / distance * exp(-|difference of colors|^2 / (2 mean))`, the mean taken over all neighbors of the crop
/// (GrabCut: Rother, Kolmogorov, Blake, 2004).
pub(crate) fn smooth_labels(log_odds: &[f32], colors: &Colors, grid: usize, strength: f32) -> Vec<bool> {
    // Squared differences of colors, each pair of neighbors once: to the right, and to the three below. For each of
    // these directions the pixels of a row that have such a neighbor are `columns`.
    let columns = |direction: usize| {
        let dx = NEIGHBORS[direction].0;
        usize::from(dx < 0)..grid - usize::from(dx > 0)
    };
    let rows = |direction: usize| 0..grid - NEIGHBORS[direction].1 as usize;
    let mut squares = Vec::with_capacity(4 * grid * grid);
    for direction in 4..8 {
        let (dx, dy) = NEIGHBORS[direction];
        let step = (dy as usize * grid).wrapping_add_signed(dx as isize);
        for y in rows(direction) {
            let Range { start, end } = columns(direction);
            let (here, there) = (y * grid + start..y * grid + end, y * grid + start + step..y * grid + end + step);
            let ([a, b, c], [d, e, f]) = (part(colors, here), part(colors, there));
            squares.extend((0..end - start).map(|i| {
                let (x, y, z) = (a[i] - d[i], b[i] - e[i], c[i] - f[i]);
                x * x + y * y + z * z
            }));
        }
    }
    let mean = squares.iter().map(|&d| f64::from(d)).sum::<f64>() / squares.len().max(1) as f64;
    // The small number: crops of one color.
    let beta = (1.0 / (2.0 * mean + 1e-12)) as f32;
    squares.iter_mut().for_each(|square| *square = strength * exp(-beta * *square));
    let mut cut = GraphCut::new(grid, grid);
    let mut weights = squares.iter();
    for direction in 4..8 {
        // Along the axes, or along a diagonal.
        let inverse_distance = if direction == 4 || direction == 6 { 1.0 } else { std::f32::consts::FRAC_1_SQRT_2 };
        for y in rows(direction) {
            for (x, weight) in columns(direction).zip(&mut weights) {
                cut.set_weight(x, y, direction, inverse_distance * weight);
            }
        }
    }
    cut.solve(log_odds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_follow_the_edge_of_the_colors() {
        // Two halves of different colors, evidence for the object left of column 8 only weakly and with errors.
        let grid = 16;
        let left = |i: usize| i % grid < 8;
        let axis: Vec<f32> = (0..grid * grid).map(|i| if left(i) { 0.2 } else { 0.7 }).collect();
        let colors = [axis.clone(), vec![0.0; grid * grid], vec![0.0; grid * grid]];
        let log_odds: Vec<f32> = (0..grid * grid).map(|i| if left(i) == (i % 7 != 0) { 0.8 } else { -0.8 }).collect();
        let labels = smooth_labels(&log_odds, &colors, grid, 2.0);
        assert!((0..grid * grid).all(|i| labels[i] == left(i)));
        // Without smoothing, the signs.
        let labels = smooth_labels(&log_odds, &colors, grid, 0.0);
        assert!((0..grid * grid).all(|i| labels[i] == (log_odds[i] > 0.0)));
    }
}

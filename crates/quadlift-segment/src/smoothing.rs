//! Labels that keep together where colours do: the graph cut of log-odds.

use crate::graph_cut::{GraphCut, NEIGHBORS};
use crate::palette::Colors;

/// The labelling of the grid's pixels that costs least, when neighbours with different labels cost
/// `strength / distance * exp(-|difference of colours|^2 / (2 mean))`, the mean taken over all neighbours of the crop
/// (GrabCut: Rother, Kolmogorov, Blake, 2004).
pub(crate) fn smooth_labels(log_odds: &[f32], colors: &Colors, grid: usize, strength: f32) -> Vec<bool> {
    // Each pair of neighbours once: right, and the three below.
    let pairs = || {
        (0..grid * grid).flat_map(move |i| {
            (4..8).filter_map(move |direction| {
                let (dx, dy) = NEIGHBORS[direction];
                let (x, y) = ((i % grid) as i32 + dx, (i / grid) as i32 + dy);
                let inside = (0..grid as i32).contains(&x) && (0..grid as i32).contains(&y);
                inside.then(|| (i, direction, y as usize * grid + x as usize))
            })
        })
    };
    let squares: Vec<f32> =
        pairs().map(|(i, _, j)| colors.iter().map(|axis| (axis[i] - axis[j]) * (axis[i] - axis[j])).sum()).collect();
    let mean = squares.iter().map(|&d| f64::from(d)).sum::<f64>() / squares.len().max(1) as f64;
    // The small number: crops of one colour.
    let beta = (1.0 / (2.0 * mean + 1e-12)) as f32;
    let mut cut = GraphCut::new(grid, grid);
    for ((i, direction, _), square) in pairs().zip(&squares) {
        // Along the axes, or along a diagonal.
        let inverse_distance = if direction == 4 || direction == 6 { 1.0 } else { std::f32::consts::FRAC_1_SQRT_2 };
        cut.set_weight(i % grid, i / grid, direction, strength * inverse_distance * (-beta * square).exp());
    }
    cut.solve(log_odds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_follow_the_edge_of_the_colours() {
        // Two halves of different colours, evidence for the object left of column 8 only weakly and with errors.
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

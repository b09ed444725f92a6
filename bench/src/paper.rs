//! The published figures of *3D Pose from Detections* (Rubino, Crocco, Perina, Murino, Del Bue, ICCV 2015), as
//! printed, with their place in the paper. Nothing here is computed, the averages are the paper's own.

/// One curve of the figure of the synthetic experiments (figure `fig:synth`; the numbers stand in the text of section
/// 5.1).
#[derive(Debug, Clone, Copy)]
pub struct CurveEnds {
    /// The paper's name of the method.
    pub method: &'static str,
    /// O3D without noise.
    pub without_noise: f64,
    /// O3D at the largest rotation error (45 degrees).
    pub rotation: f64,
    /// O3D at the largest size error (0.3).
    pub size: f64,
    /// O3D at the largest translation error (0.3).
    pub translation: f64,
}

/// Ends of the curves of the synthetic experiments.
pub const SYNTHETIC: [CurveEnds; 2] = [
    CurveEnds { method: "PfD", without_noise: 1.0, rotation: 0.15, size: 0.05, translation: 0.02 },
    CurveEnds { method: "PfD+REG", without_noise: 0.52, rotation: 0.39, size: 0.33, translation: 0.16 },
];

/// A row of a table: one figure for each sequence, and the printed average.
#[derive(Debug, Clone, Copy)]
pub struct Row<const N: usize> {
    /// The paper's name of the method.
    pub method: &'static str,
    /// One figure for each sequence; none where the paper has none.
    pub figures: [Option<f64>; N],
    /// The printed average.
    pub average: f64,
}

const fn row<const N: usize>(method: &'static str, figures: [f64; N], average: f64) -> Row<N> {
    let mut all = [None; N];
    let mut k = 0;
    while k < N {
        // NaN stands for what the paper does not give.
        if !figures[k].is_nan() {
            all[k] = Some(figures[k]);
        }
        k += 1;
    }
    Row { method, figures: all, average }
}

/// Sequences of the ACCV table (`tab:accv`), in its order.
pub const ACCV_SEQUENCES: [&str; 8] = ["iron", "duck", "ape", "can", "driller", "vise", "glue", "cat"];
/// O3D of the ACCV table.
pub const ACCV_O3D: Row<8> = row("PfD", [0.71, 0.83, 0.47, 0.74, 0.54, 0.67, 0.33, 0.56], 0.60);
/// theta_err of the ACCV table, radians.
pub const ACCV_THETA_ERR: Row<8> = row("PfD", [0.17, 0.13, 0.23, 0.13, 1.00, 0.43, 0.01, 0.57], 0.33);

/// Sequences of the TUW table (`tab:iros`).
pub const TUW_SEQUENCES: [&str; 5] = ["Seq. 1", "Seq. 7", "Seq. 8", "Seq. 10", "Seq. 11"];
/// O3D of the TUW table.
pub const TUW_O3D: [Row<5>; 4] = [
    row("PfD", [0.09, 0.43, 0.00, 0.60, 0.16], 0.25),
    row("PfD+ES", [0.12, 0.38, 0.16, 0.65, 0.09], 0.28),
    row("PfD+REG", [0.48, 0.49, 0.48, 0.71, 0.40], 0.51),
    row("PfD+REG+ES", [0.50, 0.56, 0.52, 0.74, 0.43], 0.55),
];
/// theta_err of the TUW table, radians (`NN` of sequence 8: no ellipsoid).
pub const TUW_THETA_ERR: [Row<5>; 2] =
    [row("PfD", [0.69, 0.73, f64::NAN, 0.97, 1.34], 0.93), row("PfD+ES", [0.69, 0.86, 0.77, 0.68, 1.1], 0.82)];

/// Sequences of the KITTI tables (`tab:kitti`, `tab:distances`).
pub const KITTI_SEQUENCES: [&str; 6] = ["S05", "S09", "S22", "S23", "S35", "S36"];
/// O3D of the KITTI table.
pub const KITTI_O3D: [Row<6>; 2] = [
    row("PfD", [0.13, 0.05, 0.13, 0.48, 0.17, 0.08], 0.17),
    row("PfD+REG", [0.21, 0.49, 0.45, 0.37, 0.30, 0.35], 0.36),
];
/// theta_err of the KITTI table, radians.
pub const KITTI_THETA_ERR: Row<6> = row("PfD", [0.24, 0.22, 0.16, 0.21, 0.55, 0.07], 0.24);
/// What the text of section 5.4 gives for the average theta_err, where the table has 0.24.
pub const KITTI_THETA_ERR_IN_TEXT: f64 = 0.36;
/// Share of the centers within 1 m, per cent (`tab:distances`; Choi et al. as the paper cites them).
pub const KITTI_WITHIN_1M: [Row<6>; 3] = [
    row("PfD", [80.0, 71.0, 86.0, 100.0, 50.0, 100.0], 81.0),
    row("PfD+REG", [60.0, 86.0, 100.0, 75.0, 50.0, 86.0], 76.0),
    row("Choi et al.", [20.0, 0.0, 10.0, 27.0, 0.0, 0.0], 10.0),
];
/// Share of the centers within 2 m, per cent.
pub const KITTI_WITHIN_2M: [Row<6>; 3] = [
    row("PfD", [80.0, 71.0, 100.0, 100.0, 50.0, 100.0], 83.0),
    row("PfD+REG", [80.0, 100.0, 100.0, 100.0, 75.0, 100.0], 93.0),
    row("Choi et al.", [40.0, 33.0, 30.0, 45.0, 0.0, 0.0], 25.0),
];

/// Data sets of the table of minimal configurations (`tab:Min`).
pub const MINIMAL_DATA_SETS: [&str; 3] = ["ACCV", "TUW", "KITTI"];
/// Average O3D with two and three views: number of views, method, one figure for each data set.
pub const MINIMAL: [(usize, &str, [f64; 3]); 3] =
    [(3, "PfD", [0.46, 0.20, 0.12]), (3, "PfD+REG", [0.47, 0.51, 0.34]), (2, "PfD+REG", [0.46, 0.25, 0.34])];

#[cfg(test)]
mod tests {
    use super::*;

    /// The figures are printed with two digits, so their mean is the printed average to a digit.
    fn assert_mean<const N: usize>(row: &Row<N>, tolerance: f64) {
        let figures: Vec<f64> = row.figures.iter().copied().flatten().collect();
        let mean = figures.iter().sum::<f64>() / figures.len() as f64;
        assert!((mean - row.average).abs() <= tolerance, "{}: {mean} {}", row.method, row.average);
    }

    #[test]
    fn the_printed_averages_are_the_means_over_the_sequences() {
        assert_mean(&ACCV_O3D, 0.0101);
        assert_mean(&ACCV_THETA_ERR, 0.0101);
        TUW_O3D.iter().chain([&TUW_THETA_ERR[0], &TUW_THETA_ERR[1]]).for_each(|row| assert_mean(row, 0.0101));
        KITTI_O3D.iter().for_each(|row| assert_mean(row, 0.0101));
        assert_mean(&KITTI_THETA_ERR, 0.0101);
        KITTI_WITHIN_1M.iter().chain(&KITTI_WITHIN_2M).for_each(|row| assert_mean(row, 0.51));
    }
}

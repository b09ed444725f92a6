//! Where an object roughly is, and how large.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::geometry::{Ellipse, Projection, linalg::solve_spd};

/// Linear triangulation of the ellipse centres; `None` when they do not fix a point.
pub(crate) fn triangulate(observations: &[(Projection, Ellipse)]) -> Option<Point3<f64>> {
    let shift = observations.first()?.0.center_in_world()?;
    let mut point = Vector3::zeros();
    let mut depths = vec![1.0; observations.len()];
    for _ in 0..3 {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for ((projection, ellipse), depth) in observations.iter().zip(&depths) {
            let p = projection.matrix();
            let m = p.fixed_columns::<3>(0);
            let last = m * shift.coords + p.column(3);
            for i in 0..2 {
                let n = (m.row(i) - m.row(2) * ellipse.center[i]).transpose() / *depth;
                let d = (last[i] - last[2] * ellipse.center[i]) / depth;
                normal += n * n.transpose();
                right -= n * d;
            }
        }
        point = solve_spd(&normal, &right)?;
        for ((projection, _), depth) in observations.iter().zip(&mut depths) {
            *depth = projection.depth(&(shift + point)).abs().max(f64::MIN_POSITIVE);
        }
    }
    point.iter().all(|x| x.is_finite()).then(|| shift + point)
}

/// Geometric mean over the views of the radius that the ellipse suggests at the depth of `center`.
pub(crate) fn object_radius(observations: &[(Projection, Ellipse)], center: &Point3<f64>) -> Option<f64> {
    let sum: f64 = observations
        .iter()
        .map(|(projection, ellipse)| {
            let size = (ellipse.semi_axes.x * ellipse.semi_axes.y).sqrt();
            (size * projection.depth(center).abs() / projection.focal_length()).ln()
        })
        .sum();
    let radius = (sum / observations.len() as f64).exp();
    (radius.is_finite() && radius > 0.0).then_some(radius)
}

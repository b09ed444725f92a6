//! Transforms from pairs of points.

use quadlift::geometry::Similarity;
use quadlift::nalgebra::{Matrix3, Rotation3, Vector3};

/// The transform that takes the second points to the first ones with the least squares (Umeyama 1991). A known scale is kept.
pub(super) fn similarity_of_points(points: &[(Vector3<f64>, Vector3<f64>)], scale: Option<f64>) -> Option<Similarity> {
    let count = points.len() as f64;
    let a = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.0 / count);
    let b = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.1 / count);
    let moment =
        points.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, p| sum + (p.0 - a) * (p.1 - b).transpose() / count);
    let spread: f64 = points.iter().map(|p| (p.1 - b).norm_squared() / count).sum();
    let svd = moment.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let signs = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(u * signs * v_t);
    let scale = scale.unwrap_or((Matrix3::from_diagonal(&svd.singular_values) * signs).trace() / spread);
    let found = Similarity { scale, rotation, translation: a - rotation * b * scale };
    found.is_valid().then_some(found)
}

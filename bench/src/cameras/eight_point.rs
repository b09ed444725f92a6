//! The plain way to a pair of cameras: the essential matrix of the centers of boxes, by eight points with RANSAC (Hartley and Zisserman,
//! *Multiple View Geometry*, 2nd edition, sections 9.6 and 11.2), written for the comparison.

use quadlift::nalgebra::{DMatrix, Matrix3, Vector3};
use quadlift::random::stream;
use rand::RngExt;

/// Samples of RANSAC, and the distance from the epipolar line up to which a pair of centers agrees (coordinates X / Z).
const SAMPLES: usize = 500;
const NEAR: f64 = 0.01;

const STREAM: u64 = 70;

/// A pair of rays with Z = 1.
pub(super) type Rays = (Vector3<f64>, Vector3<f64>);

/// Rotation and direction of the translation from the first camera to the second one.
pub(super) fn relative_pose(rays: &[Rays], seed: u64) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    if rays.len() < 8 {
        return None;
    }
    let mut rng = stream(seed, STREAM);
    let inliers =
        |e: &Matrix3<f64>| -> Vec<Rays> { rays.iter().filter(|pair| sampson(e, pair) < NEAR).copied().collect() };
    let mut best: Vec<Rays> = Vec::new();
    for _ in 0..SAMPLES {
        let sample: Vec<Rays> = (0..8).map(|_| rays[rng.random_range(0..rays.len())]).collect();
        let Some(found) = essential(&sample) else { continue };
        let agree = inliers(&found);
        if agree.len() > best.len() {
            best = agree;
        }
    }
    let e = essential(&best)?;
    let svd = e.try_svd(true, true, 1e-12, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let turn = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let mut poses = Vec::new();
    for w in [turn, turn.transpose()] {
        let rotation = u * w * v_t;
        let rotation = rotation * rotation.determinant().signum();
        for sign in [1.0, -1.0] {
            poses.push((rotation, u.column(2) * sign));
        }
    }
    let in_front = |(rotation, translation): &(Matrix3<f64>, Vector3<f64>)| {
        best.iter().filter(|pair| depths(rotation, translation, pair).is_some_and(|d| d[0] > 0.0 && d[1] > 0.0)).count()
    };
    poses.into_iter().max_by_key(in_front)
}

/// The essential matrix of eight pairs or more, with two equal singular values.
fn essential(rays: &[Rays]) -> Option<Matrix3<f64>> {
    if rays.len() < 8 {
        return None;
    }
    let row = |(a, b): &Rays| -> [f64; 9] { std::array::from_fn(|k| b[k / 3] * a[k % 3]) };
    let rows: Vec<f64> = rays.iter().flat_map(row).collect();
    let all = DMatrix::from_row_slice(rays.len(), 9, &rows);
    let eigen = (all.transpose() * &all).symmetric_eigen();
    let smallest = (0..9).min_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]))?;
    let vector = eigen.eigenvectors.column(smallest);
    let svd = Matrix3::from_fn(|i, j| vector[3 * i + j]).try_svd(true, true, 1e-12, 100)?;
    Some(svd.u? * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * svd.v_t?)
}

/// Distance of a pair from an essential matrix (Sampson's, the root).
fn sampson(e: &Matrix3<f64>, (a, b): &Rays) -> f64 {
    let (line, other) = (e * a, e.transpose() * b);
    b.dot(&line).abs() / (line.xy().norm_squared() + other.xy().norm_squared()).sqrt()
}

/// Depths of the point between two rays.
fn depths(rotation: &Matrix3<f64>, translation: &Vector3<f64>, (a, b): &Rays) -> Option<[f64; 2]> {
    let a = rotation * a;
    let cross = b.cross(&a);
    let square = cross.norm_squared();
    (square > 0.0).then(|| {
        let first = translation.cross(b).dot(&cross) / square;
        let second = translation.cross(&a).dot(&cross) / square;
        [first, second]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::nalgebra::Rotation3;

    #[test]
    fn exact_points_give_the_pose() {
        let rotation = *Rotation3::new(Vector3::new(0.1, -0.8, 0.05)).matrix();
        let translation = Vector3::new(3.0, 0.2, 1.5);
        let mut rng = stream(4, 0);
        let ray = |p: Vector3<f64>| p / p.z;
        let rays: Vec<Rays> = (0..40)
            .map(|_| Vector3::from_fn(|k, _| rng.random_range(-1.0..1.0) + if k == 2 { 6.0 } else { 0.0 }))
            .map(|p| (ray(p), ray(rotation * p + translation)))
            .collect();
        let (found, direction) = relative_pose(&rays, 1).unwrap();
        assert!((found - rotation).norm() < 1e-6, "{found}");
        assert!((direction - translation.normalize()).norm() < 1e-6, "{direction}");
        assert!(relative_pose(&rays[..7], 1).is_none());
    }
}

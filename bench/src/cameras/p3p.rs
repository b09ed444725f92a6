//! The pose of a camera from three points: Grunert's equations, as in Haralick et al., *Review and analysis of solutions of the three
//! point perspective pose estimation problem* (IJCV 1994).

use quadlift::nalgebra::{Matrix3, Matrix4, Vector3};

use super::point_pairs::similarity_of_points;

/// A camera: rotation and translation from the world.
pub(super) type Pose = (Matrix3<f64>, Vector3<f64>);

/// Imaginary parts up to this share of the real ones are errors of rounding.
const REAL: f64 = 1e-6;

/// The poses from which three points of the world are seen in three directions (unit vectors); up to four.
pub(super) fn p3p(directions: &[Vector3<f64>; 3], points: &[Vector3<f64>; 3]) -> Vec<Pose> {
    let side = |i: usize, j: usize| (points[i] - points[j]).norm_squared();
    let cosine = |i: usize, j: usize| directions[i].dot(&directions[j]);
    let (a, b, c) = (side(1, 2), side(0, 2), side(0, 1));
    let (cos_a, cos_b, cos_c) = (cosine(1, 2), cosine(0, 2), cosine(0, 1));
    if b <= 0.0 {
        return Vec::new();
    }
    let (minus, plus, ab, cb) = ((a - c) / b, (a + c) / b, a / b, c / b);
    // The quartic in v, the ratio of the third distance to the first one.
    let quartic = [
        (1.0 + minus).powi(2) - 4.0 * ab * cos_c * cos_c,
        4.0 * (-minus * (1.0 + minus) * cos_b + 2.0 * ab * cos_c * cos_c * cos_b - (1.0 - plus) * cos_a * cos_c),
        2.0 * (minus * minus - 1.0 + 2.0 * minus * minus * cos_b * cos_b + 2.0 * (1.0 - cb) * cos_a * cos_a
            - 4.0 * plus * cos_a * cos_b * cos_c
            + 2.0 * (1.0 - ab) * cos_c * cos_c),
        4.0 * (minus * (1.0 - minus) * cos_b - (1.0 - plus) * cos_a * cos_c + 2.0 * cb * cos_a * cos_a * cos_b),
        (minus - 1.0).powi(2) - 4.0 * cb * cos_a * cos_a,
    ];
    let mut poses = Vec::new();
    for v in real_roots(&quartic).into_iter().filter(|v| *v > 0.0) {
        let divisor = 2.0 * (cos_c - v * cos_a);
        let u = ((-1.0 + minus) * v * v - 2.0 * minus * cos_b * v + 1.0 + minus) / divisor;
        let first = (b / (1.0 + v * v - 2.0 * v * cos_b)).sqrt();
        let depths = [first, u * first, v * first];
        if depths.iter().all(|depth| depth.is_finite() && *depth > 0.0) {
            let pairs: [_; 3] = std::array::from_fn(|k| (directions[k] * depths[k], points[k]));
            let motion = similarity_of_points(&pairs, Some(1.0));
            poses.extend(motion.map(|motion| (*motion.rotation.matrix(), motion.translation)));
        }
    }
    poses
}

/// The real roots of a polynomial of the fourth degree, its constant coefficient first: eigenvalues of its companion matrix.
fn real_roots(coefficients: &[f64; 5]) -> Vec<f64> {
    let scale = coefficients.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let last = coefficients[4];
    if !scale.is_finite() || last.abs() <= 1e-12 * scale {
        return Vec::new();
    }
    let mut companion = Matrix4::zeros();
    for k in 0..4 {
        companion[(k, 3)] = -coefficients[k] / last;
        if k > 0 {
            companion[(k, k - 1)] = 1.0;
        }
    }
    let values = companion.complex_eigenvalues();
    values.iter().filter(|x| x.im.abs() <= REAL * x.re.abs()).map(|x| x.re).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::nalgebra::Rotation3;

    #[test]
    fn the_pose_of_three_points_is_found() {
        for k in 0..20 {
            let angle = f64::from(k);
            let rotation = *Rotation3::from_euler_angles(0.3 * angle, -0.2, 0.7 * angle).matrix();
            let translation = Vector3::new(0.2, -0.1 * angle, 6.0 + 0.3 * angle);
            let points = [
                Vector3::new(1.0, 0.2 * angle.sin(), 0.3),
                Vector3::new(-0.8, 0.4, angle.cos()),
                Vector3::new(0.1, -0.9, 0.5),
            ];
            let directions = points.map(|point| (rotation * point + translation).normalize());
            let found = p3p(&directions, &points);
            let nearest = found.iter().map(|(r, t)| (r - rotation).norm() + (t - translation).norm());
            assert!(nearest.fold(f64::INFINITY, f64::min) < 1e-6, "{k}: {found:?}");
        }
        let same = [Vector3::z(); 3];
        assert!(p3p(&same, &same).is_empty());
    }
}

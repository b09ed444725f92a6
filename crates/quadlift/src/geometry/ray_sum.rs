//! The point nearest to rays, as normal equations.

use nalgebra::{Matrix3, Vector3};

/// The information matrix of the point nearest to rays, and its sum weighted with the starts of the rays: `information x = toward`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RaySum {
    pub information: Matrix3<f64>,
    pub toward: Vector3<f64>,
}

impl RaySum {
    /// Without rays.
    pub(crate) fn zero() -> Self {
        Self { information: Matrix3::zeros(), toward: Vector3::zeros() }
    }

    /// Adds a ray from `start` with a direction of this squared length: distances from it count `weight` times.
    pub(crate) fn add(&mut self, start: &Vector3<f64>, direction: &Vector3<f64>, squared_length: f64, weight: f64) {
        let across = (Matrix3::identity() - direction * direction.transpose() / squared_length) * weight;
        self.information += across;
        self.toward += across * start;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rays_meet_and_a_third_pulls_by_its_weight() {
        let mut sum = RaySum::zero();
        sum.add(&Vector3::new(1.0, 0.0, 0.0), &Vector3::new(0.0, 0.0, 2.0), 4.0, 1.0);
        sum.add(&Vector3::new(0.0, 0.0, 5.0), &Vector3::new(3.0, 0.0, 0.0), 9.0, 1.0);
        let meet = sum.information.try_inverse().unwrap() * sum.toward;
        assert!((meet - Vector3::new(1.0, 0.0, 5.0)).norm() < 1e-12, "{meet}");
        // Parallel to the first one, at a distance of 4, and three times as heavy.
        sum.add(&Vector3::new(5.0, 0.0, 0.0), &Vector3::new(0.0, 0.0, -1.0), 1.0, 3.0);
        let meet = sum.information.try_inverse().unwrap() * sum.toward;
        assert!((meet - Vector3::new(4.0, 0.0, 5.0)).norm() < 1e-12, "{meet}");
    }
}

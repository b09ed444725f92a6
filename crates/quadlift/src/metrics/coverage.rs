//! Confidence regions calibrated on objects with ground truth (split conformal prediction).

use super::squared_errors::SquaredErrors;

/// A part of an estimate with a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum RegionPart {
    /// The center: 3 degrees of freedom.
    Center,
    /// The extents: 3 degrees of freedom.
    Extents,
    /// The whole body: 9 degrees of freedom.
    Body,
}

impl RegionPart {
    /// All parts.
    pub(crate) const ALL: [Self; 3] = [Self::Center, Self::Extents, Self::Body];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Center => "center",
            Self::Extents => "extents",
            Self::Body => "body",
        }
    }

    /// The squared distance of this part.
    pub(crate) fn of(self, errors: &SquaredErrors) -> f64 {
        match self {
            Self::Center => errors.center,
            Self::Extents => errors.extents,
            Self::Body => errors.whole,
        }
    }
}

/// Calibrated limits on squared distances from objects with ground truth (split conformal prediction: Vovk, Gammerman,
/// Shafer, *Algorithmic Learning in a Random World*, 2005).
///
/// A region contains all truths whose squared Mahalanobis distance from the estimate ([`super::squared_errors`]) is at
/// most [`Coverage::limit`]. For an object that is exchangeable with those of the calibration (same detector, same
/// kind of scenes, same options), the truth lies in the region of level p with a probability of at least p, even if the
/// covariances are wrong. This holds on average over objects, not for each kind of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Coverage {
    /// The squared distances of each part, in ascending order.
    sorted: [Vec<f64>; 3],
}

impl Coverage {
    /// Builds the limits from the errors of objects with ground truth. NaN distances count as infinite.
    pub fn new(errors: &[SquaredErrors]) -> Self {
        let sorted = RegionPart::ALL.map(|part| {
            let number = |x: f64| if x.is_nan() { f64::INFINITY } else { x };
            let mut distances: Vec<f64> = errors.iter().map(|one| number(part.of(one))).collect();
            distances.sort_by(f64::total_cmp);
            distances
        });
        Self { sorted }
    }

    /// Number of the objects.
    pub fn objects(&self) -> usize {
        self.sorted[0].len()
    }

    /// The squared distance that replaces the chi-square quantile at `level`, in (0, 1): the k-th smallest one of n
    /// objects, k = ceil(level (n + 1)). `None` if there are too few objects for the level (below 19 for 95 %), or the
    /// limit would be infinite.
    pub fn limit(&self, part: RegionPart, level: f64) -> Option<f64> {
        let sorted = &self.sorted[part as usize];
        // Rounding must not ask for one more object.
        let rank = (level * (sorted.len() + 1) as f64 - 1e-9).ceil().max(1.0);
        sorted.get(rank as usize - 1).copied().filter(|limit| limit.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn errors(distances: &[f64]) -> Vec<SquaredErrors> {
        distances.iter().map(|&x| SquaredErrors { center: x, extents: 2.0 * x, whole: 3.0 * x }).collect()
    }

    #[test]
    fn limits_are_order_statistics() {
        let distances: Vec<f64> = (1..=19).rev().map(f64::from).collect();
        let coverage = Coverage::new(&errors(&distances));
        assert_eq!(coverage.objects(), 19);
        assert_eq!(coverage.limit(RegionPart::Center, 0.95), Some(19.0));
        assert_eq!(coverage.limit(RegionPart::Extents, 0.5), Some(20.0));
        assert_eq!(coverage.limit(RegionPart::Body, 0.9), Some(54.0));
        assert_eq!(coverage.limit(RegionPart::Center, 0.99), None);
        assert_eq!(Coverage::default().limit(RegionPart::Center, 0.5), None);
        let with_nan = Coverage::new(&errors(&[1.0, f64::NAN, 2.0]));
        assert_eq!(with_nan.limit(RegionPart::Center, 0.5), Some(2.0));
        assert_eq!(with_nan.limit(RegionPart::Center, 0.75), None);
    }

    proptest! {
        /// The guarantee: every object of n + 1 is as likely as any other to be the new one, so its share is a count.
        #[test]
        fn the_truth_lies_inside_as_often_as_promised(
            distances in proptest::collection::vec(0.0f64..50.0, 2..60),
            level in 0.05f64..0.99,
        ) {
            let count = distances.len();
            prop_assume!((level * count as f64).ceil() <= (count - 1) as f64);
            let inside = (0..count).filter(|&new| {
                let mut others = distances.clone();
                let new = others.remove(new);
                let limit = Coverage::new(&errors(&others)).limit(RegionPart::Center, level);
                new <= limit.unwrap()
            }).count();
            prop_assert!(inside as f64 >= level * count as f64 - 1e-6, "{inside} of {count} at {level}");
            // Nor is it vast: without ties, one object more at most.
            let mut distinct = distances.clone();
            distinct.sort_by(f64::total_cmp);
            distinct.dedup();
            if distinct.len() == count {
                prop_assert!(inside as f64 <= level * count as f64 + 1.0 + 1e-6, "{inside} of {count} at {level}");
            }
        }
    }
}

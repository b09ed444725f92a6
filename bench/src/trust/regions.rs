//! Regions of an estimate and how often the truth lies in them.

use quadlift::geometry::Body;
use quadlift::metrics::{SquaredErrors, squared_errors};
use quadlift::nalgebra::{Unit, Vector3};
use quadlift::solve::Estimate;

use super::sizes::Sizes;
use crate::table::Cell;

/// The tested regions, in per cent.
pub(super) const LEVELS: [u32; 4] = [50, 90, 95, 99];

/// Quantiles of chi-square with 3 degrees of freedom at [`LEVELS`].
const CHI2_3: [f64; 4] = [2.366, 6.251, 7.815, 11.345];

/// Quantiles of chi-square with 9 degrees of freedom at [`LEVELS`].
const CHI2_9: [f64; 4] = [8.343, 14.684, 16.919, 21.666];

/// Which part of an estimate a region is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// Center, 3 degrees of freedom.
    Center,
    /// Extents, 3 degrees of freedom.
    Extents,
    /// All of the body, 9 degrees of freedom.
    Whole,
}

impl Part {
    /// All parts.
    pub(super) const ALL: [Self; 3] = [Self::Center, Self::Extents, Self::Whole];

    /// The name in tables.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Center => "center",
            Self::Extents => "extents",
            Self::Whole => "body",
        }
    }

    /// Quantiles of its squared distance at [`LEVELS`] for a calibrated covariance.
    pub(super) fn quantiles(self) -> [f64; 4] {
        if self == Self::Whole { CHI2_9 } else { CHI2_3 }
    }

    fn of(self, errors: &SquaredErrors) -> f64 {
        match self {
            Self::Center => errors.center,
            Self::Extents => errors.extents,
            Self::Whole => errors.whole,
        }
    }
}

/// One estimated object against the truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judged {
    /// Squared distances in units of the covariance.
    pub errors: SquaredErrors,
    /// Logarithm of the volume of the one-deviation region of the center, relative to the cube of the true size.
    pub log_volume: f64,
    /// Size and direction.
    pub sizes: Option<Sizes>,
}

impl Judged {
    /// Compares an estimate with the truth; `None` without a covariance. `up` is that of the scene.
    pub(super) fn new(estimate: &Estimate, truth: &Body, up: Option<&Unit<Vector3<f64>>>) -> Option<Self> {
        let covariance = estimate.covariance.as_ref()?;
        let errors = squared_errors(estimate.body.as_ref()?, covariance, truth)?;
        let center = covariance.matrix.fixed_view::<3, 3>(0, 0).into_owned();
        let size = truth.closest_ellipsoid().semi_axes.product();
        let sizes = Sizes::of(estimate, truth, up);
        Some(Self { errors, log_volume: 0.5 * center.determinant().ln() - size.ln(), sizes })
    }
}

/// Coverage of the regions of one part, over some objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coverage {
    /// Number of objects.
    pub count: usize,
    /// Share of the objects whose truth lies in the region, at each of [`LEVELS`], per cent.
    pub inside: [f64; 4],
    /// Median squared distance.
    pub median: f64,
    /// First and third quartile of it.
    pub quartiles: [f64; 2],
}

impl Coverage {
    /// Counts; all zero without objects.
    pub(super) fn of(judged: &[Judged], part: Part) -> Self {
        let mut squared: Vec<f64> = judged.iter().map(|one| part.of(&one.errors)).collect();
        squared.sort_by(f64::total_cmp);
        let at = |share: f64| quantile(&squared, share);
        let count = squared.len();
        let inside =
            part.quantiles().map(|limit| 100.0 * squared.partition_point(|x| *x <= limit) as f64 / count.max(1) as f64);
        Self { count, inside, median: at(0.5), quartiles: [at(0.25), at(0.75)] }
    }

    /// The cells of a table: the shares, median and quartiles.
    pub(super) fn cells(&self) -> Vec<Cell> {
        if self.count == 0 {
            return vec![Cell::Empty; 7];
        }
        let shares = self.inside.iter().map(|x| Cell::number(*x, 1));
        let distances = [self.median, self.quartiles[0], self.quartiles[1]].map(|x| Cell::number(x, 2));
        shares.chain(distances).collect()
    }
}

/// A quantile of sorted numbers; NaN without any.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let place = share * (sorted.len() - 1) as f64;
    let low = sorted[place.floor() as usize];
    low + (sorted[place.ceil() as usize] - low) * place.fract()
}

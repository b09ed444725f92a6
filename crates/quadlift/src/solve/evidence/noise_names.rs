//! What the objects of a scene share, as a noise model, and back: with one, an object depends on its own views only.

use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2};

use super::conditions::{Conditions, FIRST_NOISE, FIRST_WRONG_SHARE};
use super::covariance::Systematic;
use super::shares::Shares;
use super::solid::Family;
use crate::solve::noise_model::{
    COMMON_NAMES, CORRELATION_NAMES, NoiseModel, OPPOSITE_CORRELATION_NAME, SHARE_NAMES, SPREAD_NAMES, SYSTEMATIC_NAMES,
};

/// Everything that the objects of a scene share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shared {
    pub conditions: Conditions,
    pub shares: Shares,
    pub systematic: Systematic,
    /// Half size of a box, in pixels, at which the constant part of the noise of an edge equals the part that grows with the size.
    pub pixel_noise_size: f64,
}

impl Shared {
    /// By the names of the noise model. The noise of an edge has two equal parts at the half size `pixel_noise_size`: relative to the
    /// half size, and in pixels.
    pub(super) fn to_model(self, has_occluded: bool) -> NoiseModel {
        let Self { conditions, shares, systematic, pixel_noise_size } = self;
        let [free, occluded] = conditions.noise.map(|sd| sd * FRAC_1_SQRT_2);
        let weight = conditions.view_weight;
        let mut levels = vec![
            ("edge_noise", free),
            ("edge_noise_px", free * pixel_noise_size),
            (CORRELATION_NAMES[0], (1.0 - weight) / (1.0 + weight)),
            (OPPOSITE_CORRELATION_NAME, conditions.opposite_correlation),
            (SPREAD_NAMES[1], systematic.spread),
            // For who takes the errors that the views of an object share in units of the noise, such as relocalization.
            (COMMON_NAMES[0], systematic.field.hypot(systematic.side) / conditions.noise[0]),
        ];
        levels.extend(has_occluded.then_some(("occluded_edge_noise", occluded)));
        let [ellipsoids, rounded, cuboids, cylinders] = shares.families.map(f64::exp);
        let [part, precision] = conditions.cuboid_share;
        let of_shares = [conditions.wrong_share, ellipsoids, rounded, cuboids, cylinders, shares.upright, part];
        levels.extend(SHARE_NAMES.into_iter().zip(of_shares.map(|share| share.min(1.0))));
        let Systematic { field, side, drift, noise, robust, correlated, .. } = systematic;
        levels.extend(SYSTEMATIC_NAMES.into_iter().zip([precision, field, side, drift, noise, robust, correlated]));
        NoiseModel::of_report(levels)
    }

    /// From a noise model; what it does not name has its value before a scene has been looked at, and nothing is systematic.
    pub(super) fn from_model(model: &NoiseModel, family: Option<Family>, shape_sd: f64, pixel_noise_size: f64) -> Self {
        let or = |name: &str, otherwise: f64| model.get(name).unwrap_or(otherwise);
        let (relative, pixels) = (or("edge_noise", FIRST_NOISE * FRAC_1_SQRT_2), model.get("edge_noise_px"));
        let first = Conditions::first(relative * SQRT_2, shape_sd);
        let noise = [first.noise[0], model.get("occluded_edge_noise").map_or(first.noise[1], |sd| sd * SQRT_2)];
        let correlation = or(CORRELATION_NAMES[0], 0.0);
        let [part, precision] = first.cuboid_share;
        let cuboid_share = [or(SHARE_NAMES[6], part), or(SYSTEMATIC_NAMES[0], precision)];
        let mut shares = Shares::first(family);
        for (log, name) in shares.families.iter_mut().zip(&SHARE_NAMES[1..5]) {
            *log = model.get(name).filter(|_| family.is_none()).map_or(*log, |share| share.max(1e-12).ln());
        }
        shares.upright = or(SHARE_NAMES[5], shares.upright);
        let none = Systematic::NONE;
        Self {
            conditions: Conditions {
                noise,
                opposite_correlation: or(OPPOSITE_CORRELATION_NAME, 0.0),
                wrong_share: or(SHARE_NAMES[0], FIRST_WRONG_SHARE),
                view_weight: (1.0 - correlation) / (1.0 + correlation),
                cuboid_share,
                ..first
            },
            shares,
            systematic: Systematic {
                field: or(SYSTEMATIC_NAMES[1], none.field),
                side: or(SYSTEMATIC_NAMES[2], none.side),
                drift: or(SYSTEMATIC_NAMES[3], none.drift),
                noise: or(SYSTEMATIC_NAMES[4], none.noise),
                robust: or(SYSTEMATIC_NAMES[5], none.robust),
                correlated: or(SYSTEMATIC_NAMES[6], none.correlated),
                spread: or(SPREAD_NAMES[1], none.spread),
            },
            pixel_noise_size: pixels.map_or(pixel_noise_size, |pixels| pixels / relative),
        }
    }
}

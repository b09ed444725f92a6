//! Maximum a posteriori refinement: the default estimator (E5, ours).
//!
//! All objects of a scene are solved together, because they share the noise levels: each kind of measurement error has
//! a standard deviation that is estimated from the residuals of the whole scene (`noise`). One object's problem is
//! small: nine parameters, minimised by Levenberg-Marquardt (`levenberg_marquardt`) over residuals of tangent planes
//! and ellipses (`rows`, `ellipse_residual`) and priors (`objective`).
//!
//! Rounds: fit every object from its starts with default noise; look for outliers where the residuals show some
//! (`robust`); then alternate between new noise levels and refits until the levels stand.

pub(crate) mod body_model;
mod covariance;
mod ellipse_residual;
mod first_fit;
mod fit;
mod ground;
#[cfg(test)]
mod jacobian_tests;
pub(crate) mod levenberg_marquardt;
mod measurements;
mod noise;
pub(crate) mod normal_equations;
mod object;
mod objective;
mod robust;
mod rows;
mod starts;

use nalgebra::{Point3, Unit, Vector3};

use self::body_model::{BodyModel, EllipsoidModel, OrientedModel};
use self::first_fit::FirstFit;
use self::fit::Fit;
use self::ground::{GroundPlane, LowestPoint};
use self::noise::{NoiseLevels, NoiseStatistics};
use self::object::Prepared;
use super::estimate::Estimate;
use super::options::{BodyKind, MapOptions};
use crate::parallel::map_indices;
use crate::scene::ObjectViews;

/// Objects from which the noise levels are estimated; larger scenes use this many, evenly spread.
const NOISE_SAMPLE: usize = 2000;

/// Rounds of noise estimation, at most.
const ROUNDS: usize = 8;

/// Rounds in which fits that do not agree with the scene's noise are looked at again for outliers.
const RECONSIDERED: usize = 4;

/// Rounds that the ground plane and the objects on it take to agree.
const GROUND_ROUNDS: usize = 4;

/// Relative change of every noise level below which they stand.
const SETTLED: f64 = 0.02;

/// What the objects of a scene share.
#[derive(Debug, Clone)]
pub struct MapContext<'a> {
    /// Names of the categories, by index.
    pub categories: &'a [String],
    /// World direction against gravity.
    pub up: Option<Unit<Vector3<f64>>>,
    /// Centres of all cameras, for the ground plane.
    pub cameras: Vec<Point3<f64>>,
    /// Seed of the hypotheses and of the random starts.
    pub seed: u64,
    /// The estimator's options.
    pub options: &'a MapOptions,
}

/// The answer for a scene.
#[derive(Debug, Clone, Default)]
pub struct MapSolution {
    /// One estimate per object.
    pub estimates: Vec<Estimate>,
    /// Noise levels by name, relative to the detection's half size.
    pub noise: Vec<(&'static str, f64)>,
}

/// Solves for `count` objects; `views_of` gathers the views of one, on demand and from any thread. `done` is called
/// once for each finished object.
pub fn map(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &MapContext,
    done: &(dyn Fn() + Sync),
) -> MapSolution {
    match context.options.body {
        BodyKind::Ellipsoid => solve::<EllipsoidModel>(count, views_of, context, done),
        BodyKind::Cuboid | BodyKind::Superellipsoid(_) => solve::<OrientedModel>(count, views_of, context, done),
    }
}

fn solve<B: BodyModel + FirstFit>(
    count: usize,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    context: &MapContext,
    done: &(dyn Fn() + Sync),
) -> MapSolution {
    let stride = count.div_ceil(NOISE_SAMPLE).max(1);
    let sample: Vec<usize> = (0..count).step_by(stride).collect();
    let mut noise = NoiseLevels::new(context.options.pixel_noise_size);
    let mut fits: Vec<Result<Fit<B>, Box<Estimate>>> =
        map_indices(sample.len(), |k| Prepared::new(views_of(sample[k]), context)?.first_fit(&noise, context));
    let mut statistics = NoiseStatistics::default();
    let mut ground = None;
    for round in 0..ROUNDS {
        statistics = NoiseStatistics::default();
        // Summed in the order of the objects, so that the result does not depend on the number of threads.
        for fit in fits.iter().flatten() {
            statistics.merge(&fit.statistics(&noise, context));
        }
        let updated = noise.updated(&statistics);
        let settled = updated.change(&noise, &statistics) < SETTLED;
        noise = updated;
        ground = ground_plane(&fits, context);
        if let (Some(ground), Some(up)) = (&ground, &context.up) {
            fits.iter_mut().flatten().for_each(|fit| fit.stand_on(ground, up));
        }
        fits = map_indices(fits.len(), |k| {
            let fit = fits[k].as_ref().map_err(Clone::clone)?;
            // Now that the noise of the scene is known, a fit with much larger residuals stands out.
            Ok(if round < RECONSIDERED { fit.reconsidered(&noise, round, context) } else { fit.refined(&noise, false) })
        });
        if settled && (ground.is_none() || round >= GROUND_ROUNDS) {
            break;
        }
    }
    let fits = &fits;
    let estimates = map_indices(count, |index| {
        let estimate = if index % stride == 0 {
            match &fits[index / stride] {
                Ok(fit) => fit.refined(&noise, true).estimate(&noise, context),
                Err(failed) => (**failed).clone(),
            }
        } else {
            Prepared::new(views_of(index), context)
                .and_then(|prepared| prepared.first_fit::<B>(&noise, context))
                .map_or_else(
                    |failed| *failed,
                    |mut fit| {
                        if let (Some(ground), Some(up)) = (&ground, &context.up) {
                            fit.stand_on(ground, up);
                        }
                        fit.reconsidered(&noise, 0, context).refined(&noise, true).estimate(&noise, context)
                    },
                )
        };
        done();
        estimate
    });
    MapSolution { estimates, noise: noise.report(&statistics) }
}

/// The ground plane under the objects that stand on it.
fn ground_plane<B: FirstFit>(fits: &[Result<Fit<B>, Box<Estimate>>], context: &MapContext) -> Option<GroundPlane> {
    let up = context.up?;
    let lowest: Vec<LowestPoint> = fits.iter().flatten().filter_map(|fit| fit.lowest_point(&up)).collect();
    GroundPlane::fit(&up, &lowest, &context.cameras, context.options.camera_height)
}

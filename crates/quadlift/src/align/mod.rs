//! Where one map of objects lies in another: two maps of one place that were made apart, also from opposite sides, without a
//! common image (ours; docs/method.md, section 22).
//!
//! Only objects are compared: category, size, and how far they are from each other. Groups of objects whose distances agree give
//! transforms to try (`hypotheses`), which are refined with all objects that they bring together (`refine`) and compared by
//! their evidence (`score`). Where another transform explains the maps nearly as well, or something of it is left open, the answer is
//! [`AlignStatus::Ambiguous`].
//!
//! ```
//! use nalgebra::{Point3, Rotation3, Vector3};
//! use quadlift::align::{AlignOptions, AlignStatus, MapObject, align};
//! use quadlift::geometry::{Ellipsoid, Similarity};
//!
//! let object = |x: f64, y: f64, z: f64, size: f64| MapObject {
//!     ellipsoid: Ellipsoid {
//!         center: Point3::new(x, y, z),
//!         semi_axes: Vector3::new(size, 0.8 * size, 0.6 * size),
//!         rotation: Rotation3::identity(),
//!     },
//!     covariance: None,
//!     category: Some(format!("thing {size}")),
//! };
//! let b = vec![
//!     object(0.0, 0.0, 0.4, 0.2),
//!     object(3.0, 0.4, 0.3, 0.25),
//!     object(-2.2, 1.3, 1.2, 0.3),
//!     object(0.6, -2.8, 0.5, 0.35),
//!     object(-1.4, -1.1, 0.9, 0.4),
//!     object(2.1, 2.5, 1.6, 0.45),
//! ];
//! let truth = Similarity {
//!     scale: 2.0,
//!     rotation: Rotation3::from_euler_angles(0.1, 0.2, 3.0),
//!     translation: Vector3::new(5.0, 0.0, 1.0),
//! };
//! let a: Vec<MapObject> = b
//!     .iter()
//!     .map(|object| MapObject { ellipsoid: truth.ellipsoid(&object.ellipsoid), ..object.clone() })
//!     .collect();
//! let found = align(&a, &b, &AlignOptions::default());
//! assert_eq!(found.status, AlignStatus::Ok);
//! assert!((found.transforms[0].a_from_b.matrix() - truth.matrix()).norm() < 1e-6);
//! ```

mod log_shape;
mod prepared;
mod refine;
mod score;
mod hypotheses;
#[cfg(test)]
mod tests;

use nalgebra::{Point3, SMatrix, Unit, Vector3};

use self::prepared::PreparedMaps;
use crate::geometry::{Ellipsoid, Similarity};
use crate::solve::{Covariance, Estimate, Matrix9, Status};
pub use crate::tuning::CLEAR;

/// An object of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapObject {
    /// Its body, in the frame of its map.
    pub ellipsoid: Ellipsoid,
    /// Covariance of the body, in the frame of its map; without one only a share of its size counts as error.
    pub covariance: Option<Covariance>,
    /// Objects of other categories are not this one. Without one any object may be.
    pub category: Option<String>,
}

impl MapObject {
    /// An object that was localized; `None` where it was not (its status is not [`Status::Ok`]). Of a body that is no ellipsoid, the
    /// ellipsoid of the same reach.
    pub fn from_estimate(estimate: &Estimate, category: Option<String>) -> Option<Self> {
        (estimate.status == Status::Ok).then_some(())?;
        Some(Self { ellipsoid: estimate.closest_ellipsoid()?, covariance: estimate.covariance, category })
    }

    /// Its mirror image in the origin, which changes no shape: but for a rotation, where a map with left-handed axes has it.
    pub fn mirrored(&self) -> Self {
        let sign = |k: usize| if k < 3 { -1.0 } else { 1.0 };
        let of_covariance = |covariance: Covariance| {
            let matrix = Matrix9::from_fn(|i, j| sign(i) * sign(j) * covariance.matrix[(i, j)]);
            Covariance { matrix, ..covariance }
        };
        Self {
            ellipsoid: Ellipsoid { center: Point3::from(-self.ellipsoid.center.coords), ..self.ellipsoid },
            covariance: self.covariance.map(of_covariance),
            category: self.category.clone(),
        }
    }
}

/// The direction against gravity in both maps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CommonUp {
    /// Upwards in map A.
    pub up_in_a: Unit<Vector3<f64>>,
    /// Upwards in map B.
    pub up_in_b: Unit<Vector3<f64>>,
    /// Standard deviation of the angle between the two, each way, radians.
    pub sd: f64,
}

/// Options of [`align`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AlignOptions {
    /// How long a unit of map B is in units of map A, where that is known: 1 for a rigid motion. Otherwise it is estimated.
    pub scale: Option<f64>,
    /// Directions against gravity: two common objects may then be enough.
    pub up: Option<CommonUp>,
}

/// How two maps were aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum AlignStatus {
    /// The first transform is the only one that explains the maps.
    Ok,
    /// The maps do not decide it, for the reason that is given.
    Ambiguous(Ambiguity),
    /// Fewer than three objects (two with a common up) of a map have a category that the other one has, too.
    TooFewObjects,
    /// No transform explains the maps better than chance.
    NoAlignment,
}

/// Why an alignment is ambiguous.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ambiguity {
    /// Several different transforms explain the maps; they are all given, the most probable one first.
    Several,
    /// The objects that agree leave the rotation open, as those in one row do.
    RotationOpen,
    /// The objects that agree leave the scale open.
    ScaleOpen,
    /// Not all groups of objects could be examined, and the best transform rests on too few of those that were.
    NotSearched,
}

impl AlignStatus {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Ambiguous(_) => "ambiguous",
            Self::TooFewObjects => "too_few_objects",
            Self::NoAlignment => "no_alignment",
        }
    }
}

impl Ambiguity {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Several => "several",
            Self::RotationOpen => "rotation_open",
            Self::ScaleOpen => "scale_open",
            Self::NotSearched => "not_searched",
        }
    }
}

/// A 7x7 matrix.
pub type Matrix7 = SMatrix<f64, 7, 7>;

/// A transform that brings two maps together.
#[derive(Debug, Clone, PartialEq)]
pub struct MapTransform {
    /// From map B to map A.
    pub a_from_b: Similarity,
    /// Covariance of the motion in the frame of map A that is left: rotation vector (radians), translation (units of A), logarithm of the
    /// scale, about `pivot`. Where the scale is known its row and column are 0.
    pub covariance: Matrix7,
    /// The middle of the matched objects, in the frame of map A.
    pub pivot: Point3<f64>,
    /// Which object of A is which one of B (indices), ordered by those of A.
    pub matches: Vec<(usize, usize)>,
    /// Logarithm of the odds against maps that have nothing in common (nats): the larger, the better.
    pub evidence: f64,
}

impl MapTransform {
    /// Standard deviations of the rotation (radians), of the position of the pivot (units of A), both root mean squares over the axes, and of the
    /// logarithm of the scale.
    pub fn sds(&self) -> [f64; 3] {
        let mean = |first: usize| self.covariance.fixed_view::<3, 3>(first, first).trace() / 3.0;
        [mean(0), mean(3), self.covariance[(6, 6)]].map(|variance| variance.max(0.0).sqrt())
    }
}

/// Where one map lies in another.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Whether the first transform can be trusted.
    pub status: AlignStatus,
    /// Transforms that explain the maps, the best first; with [`AlignStatus::Ok`] the others are less probable than 1 in 100.
    pub transforms: Vec<MapTransform>,
}

impl Alignment {
    /// Number of transforms that are not a hundred times less probable than the best one.
    pub fn equally_good(&self) -> usize {
        let best = self.transforms.first().map_or(0.0, |best| best.evidence);
        self.transforms.iter().filter(|transform| best - transform.evidence < CLEAR).count()
    }
}

/// Transforms that are told at most.
const MAX_TRANSFORMS: usize = 8;

/// Largest standard deviations of a rotation about any axis (radians), and of the logarithm of the scale, with which a transform counts as
/// decided.
const OPEN_ROTATION: f64 = 0.1;
const OPEN_SCALE: f64 = 0.1;

/// Matches among the pairs that were examined with which the best transform counts although not all could be: another one that explains as much
/// would have as many.
const ENOUGH_MATCHES: usize = 6;

/// The transform from map B to map A, from their objects alone. The same input gives the same answer; objects whose numbers are not
/// finite, or whose covariance is none, are left out.
///
/// A map may lack most objects of the other one. The time is bounded: of large maps whose objects are all alike, some
/// pairs of objects are examined.
pub fn align(a: &[MapObject], b: &[MapObject], options: &AlignOptions) -> Alignment {
    let nowhere = |status| Alignment { status, transforms: Vec::new() };
    let scale_is_valid = options.scale.is_none_or(|scale| scale.is_finite() && scale > 0.0);
    let maps = PreparedMaps::new(a, b, options);
    if maps.fewest_alike() < maps.needed() || !scale_is_valid {
        return nowhere(AlignStatus::TooFewObjects);
    }
    let starts = hypotheses::starts(&maps);
    let mut transforms: Vec<MapTransform> = Vec::new();
    let examine = |all: &mut Vec<MapTransform>, start: Similarity| {
        let Some(found) = score::aligned(&maps, start) else { return };
        match all.iter_mut().find(|other| maps.same_transform(&other.a_from_b, &found.a_from_b)) {
            Some(other) if other.evidence < found.evidence => *other = found,
            Some(_) => {}
            None => all.push(found),
        }
    };
    starts.transforms.iter().for_each(|&start| examine(&mut transforms, start));
    if let Some(best) = transforms.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence)).cloned() {
        hypotheses::turned(&maps, &best).into_iter().for_each(|start| examine(&mut transforms, start));
    }
    transforms.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    transforms.truncate(MAX_TRANSFORMS);
    let status = match &transforms[..] {
        [] => starts.none_found(),
        [best, ..] if best.evidence < CLEAR => starts.none_found(),
        [best, second, ..] if best.evidence - second.evidence < CLEAR => AlignStatus::Ambiguous(Ambiguity::Several),
        [best, ..] if starts.examined(&maps, &best.matches) < ENOUGH_MATCHES => {
            AlignStatus::Ambiguous(Ambiguity::NotSearched)
        }
        [best, ..] => left_open(best).map_or(AlignStatus::Ok, AlignStatus::Ambiguous),
    };
    transforms.iter_mut().for_each(|transform| maps.finish(transform));
    Alignment { status, transforms }
}

/// Chi-square of three degrees of freedom that one center in a hundred exceeds.
const SAME_PLACE: f64 = 11.345;

/// Pairs of objects of one map (indices, the lesser first) that may be one object twice: of one category, with centers that agree within
/// their errors and are nearer to each other than half the sum of the bodies' mean semi-axes, so that they cannot both be there.
pub fn same_place(map: &[MapObject]) -> Vec<(usize, usize)> {
    let maps = PreparedMaps::new(map, map, &AlignOptions { scale: Some(1.0), up: None });
    let objects = &maps.a.objects;
    let is_one = |p: &prepared::PreparedObject, q: &prepared::PreparedObject| {
        let off = p.center - q.center;
        let covariance = p.center_covariance + q.center_covariance;
        let near = off.norm() < 0.5 * (p.log_size.exp() + q.log_size.exp());
        near && covariance.cholesky().is_some_and(|factor| off.dot(&factor.solve(&off)) < SAME_PLACE)
    };
    let pairs = maps.candidates.iter().filter(|c| c.a < c.b && is_one(&objects[c.a], &objects[c.b]));
    pairs.map(|c| (objects[c.a].index, objects[c.b].index)).collect()
}

/// What the objects that agree do not decide.
fn left_open(best: &MapTransform) -> Option<Ambiguity> {
    let of_rotation = best.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    let largest =
        crate::geometry::linalg::symmetric_eigen3(&of_rotation).map_or(f64::INFINITY, |(values, _)| values[0]);
    if largest.sqrt() > OPEN_ROTATION {
        return Some(Ambiguity::RotationOpen);
    }
    (best.covariance[(6, 6)].sqrt() > OPEN_SCALE).then_some(Ambiguity::ScaleOpen)
}

//! Two maps, prepared: objects with the errors that they may have, and which of them may be the same.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::log_shape::{coordinates, covariance_of_log_shape, log_shape};
use super::{AlignOptions, MapObject, MapTransform};
use crate::geometry::Similarity;
use crate::geometry::linalg::{cholesky, symmetric_eigen3};
use crate::sorting::StableSort;

/// Standard deviation of centers as a share of the object's size, beside their covariance: what bodies that are no ellipsoids and boxes of
/// visible parts move from one side to the other.
const CENTER_SHARE: f64 = 0.1;

/// The same of semi-axes, relative.
const AXES_SD: f64 = 0.1;

/// By how much the logarithm of the ratio of two sizes may differ from that of the scale.
pub(super) const SIZE_SLACK: f64 = 0.5;

/// Pairs of objects that are kept at most, about: bounds memory and time for large maps whose objects are all alike.
const MAX_PAIRS: usize = 2_000_000;

/// Transforms are the same when their rotations differ by less than this, radians ...
const SAME_ANGLE: f64 = 0.05;
/// ... the logarithms of their scales by less than this ...
const SAME_SCALE: f64 = 0.05;
/// ... and the middle of map B by less than this share of the extent of map A.
const SAME_SHARE: f64 = 0.05;

/// An object, relative to the middle of its map.
#[derive(Debug, Clone)]
pub(super) struct PreparedObject {
    /// Its index in the input.
    pub index: usize,
    pub center: Vector3<f64>,
    pub center_covariance: Matrix3<f64>,
    /// Largest variance of the center along any axis.
    pub largest_variance: f64,
    /// `log A` of its shape, and the covariance of its coordinates.
    pub log_shape: Matrix3<f64>,
    pub log_shape_covariance: Matrix6<f64>,
    /// Logarithm of the geometric mean of its semi-axes.
    pub log_size: f64,
}

/// A map, prepared.
#[derive(Debug, Clone)]
pub(super) struct PreparedMap {
    pub objects: Vec<PreparedObject>,
    /// Where its middle is in its frame.
    pub middle: Vector3<f64>,
    /// Edges of the box that has the second moments of the centers, the longest first; at least those of their errors.
    pub extents: Vector3<f64>,
}

impl PreparedMap {
    fn new(input: &[MapObject]) -> Self {
        let mut objects: Vec<PreparedObject> =
            input.iter().enumerate().filter_map(|(index, object)| prepared(index, object)).collect();
        let count = objects.len().max(1) as f64;
        let middle = objects.iter().fold(Vector3::zeros(), |sum, object| sum + object.center / count);
        objects.iter_mut().for_each(|object| object.center -= middle);
        let moments = objects.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, object| {
            sum + (object.center * object.center.transpose() + object.center_covariance) / count
        });
        let variances = symmetric_eigen3(&moments).map_or_else(Vector3::zeros, |(values, _)| values);
        let extents = variances.map(|variance| (12.0 * variance.max(f64::MIN_POSITIVE)).sqrt());
        Self { objects, middle, extents }
    }

    /// Logarithm of the volume in which an object may be.
    pub(super) fn log_volume(&self) -> f64 {
        self.extents.iter().map(|x| x.ln()).sum()
    }
}

/// Two objects that may be the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Indices of the prepared objects.
    pub a: usize,
    pub b: usize,
    /// Number of objects that are like the one or the other: the larger one.
    pub alike: usize,
    /// Logarithm of the ratio of their sizes.
    pub log_ratio: f64,
}

/// The two maps.
#[derive(Debug, Clone)]
pub(super) struct PreparedMaps {
    pub a: PreparedMap,
    pub b: PreparedMap,
    /// Ordered by the objects of A, then by those of B.
    pub candidates: Vec<Candidate>,
    /// Whether these are all pairs that may be the same.
    pub all: bool,
    pub options: AlignOptions,
    fewest_alike: usize,
}

impl PreparedMaps {
    pub(super) fn new(a: &[MapObject], b: &[MapObject], options: &AlignOptions) -> Self {
        let [of_a, of_b] = [a, b].map(PreparedMap::new);
        let categories = [(&of_a, a), (&of_b, b)].map(|(map, input)| Categories::new(map, input));
        let like_a: Vec<usize> = categories[0].names.iter().map(|name| categories[1].count(*name)).collect();
        let like_b: Vec<usize> = categories[1].names.iter().map(|name| categories[0].count(*name)).collect();
        // Objects with fewer that are alike come first, where not all pairs can be kept.
        let mut order: Vec<usize> = (0..like_a.len()).collect();
        order.stable_sort_by_key(|&i| like_a[i]);
        let mut left = MAX_PAIRS;
        order.retain(|&i| {
            left = left.saturating_sub(like_a[i]);
            left > 0
        });
        let all = order.len() == like_a.len();
        order.sort_unstable();
        let log_scale = options.scale.map(f64::ln);
        let mut candidates = Vec::new();
        for i in order {
            for j in categories[1].like(categories[0].names[i]) {
                let log_ratio = of_a.objects[i].log_size - of_b.objects[j].log_size;
                if log_scale.is_none_or(|log_scale| (log_ratio - log_scale).abs() < SIZE_SLACK) {
                    candidates.push(Candidate { a: i, b: j, alike: like_a[i].max(like_b[j]), log_ratio });
                }
            }
        }
        let alike = |counts: &[usize]| counts.iter().filter(|&&count| count > 0).count();
        let fewest_alike = alike(&like_a).min(alike(&like_b));
        Self { a: of_a, b: of_b, candidates, all, options: *options, fewest_alike }
    }

    /// Number of objects of the map with fewer that may be one of the other map.
    pub(super) fn fewest_alike(&self) -> usize {
        self.fewest_alike
    }

    /// Number of matches that a transform needs.
    pub(super) fn needed(&self) -> usize {
        if self.options.up.is_some() { 2 } else { 3 }
    }

    /// Whether two transforms (between the middles of the maps) differ by less than what matters.
    pub(super) fn same_transform(&self, p: &Similarity, q: &Similarity) -> bool {
        p.angle_to(q) < SAME_ANGLE
            && (p.scale / q.scale).ln().abs() < SAME_SCALE
            && (p.translation - q.translation).norm() < SAME_SHARE * self.a.extents.norm()
    }

    /// From the frames of the middles to those of the input, and from prepared objects to those of the input.
    pub(super) fn finish(&self, transform: &mut MapTransform) {
        let Similarity { scale, rotation, translation } = transform.a_from_b;
        transform.a_from_b.translation = translation + self.a.middle - rotation * self.b.middle * scale;
        transform.pivot += self.a.middle;
        for pair in &mut transform.matches {
            *pair = (self.a.objects[pair.0].index, self.b.objects[pair.1].index);
        }
    }
}

/// The objects of a map by their categories.
struct Categories<'a> {
    /// Of each prepared object.
    names: Vec<Option<&'a str>>,
    /// Those of each category, and those without one.
    of_name: BTreeMap<Option<&'a str>, Vec<usize>>,
}

impl<'a> Categories<'a> {
    fn new(map: &PreparedMap, input: &'a [MapObject]) -> Self {
        let names: Vec<_> = map.objects.iter().map(|object| input[object.index].category.as_deref()).collect();
        let mut of_name: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        names.iter().enumerate().for_each(|(index, name)| of_name.entry(*name).or_default().push(index));
        Self { names, of_name }
    }

    fn of<'b>(&'b self, name: Option<&'b str>) -> &'b [usize] {
        self.of_name.get(&name).map_or(&[], Vec::as_slice)
    }

    /// How many objects may be one of a category, or of any.
    fn count(&self, name: Option<&str>) -> usize {
        if name.is_none() { self.names.len() } else { self.of(name).len() + self.of(None).len() }
    }

    /// Which ones, in ascending order.
    fn like(&self, name: Option<&str>) -> Vec<usize> {
        if name.is_none() {
            return (0..self.names.len()).collect();
        }
        let mut found = [self.of(name), self.of(None)].concat();
        found.sort_unstable();
        found
    }
}

/// `None` where a number is not finite, a semi-axis not positive, or the covariance none.
fn prepared(index: usize, object: &MapObject) -> Option<PreparedObject> {
    let body = &object.ellipsoid;
    let axes_are_valid = body.semi_axes.iter().all(|x| x.is_finite() && *x > 0.0);
    let is_finite = body.center.iter().chain(body.rotation.matrix().iter()).all(|x| x.is_finite());
    if !axes_are_valid || !is_finite {
        return None;
    }
    let log_size = body.semi_axes.iter().map(|x| x.ln()).sum::<f64>() / 3.0;
    let own = CENTER_SHARE * log_size.exp();
    let mut center_covariance = Matrix3::from_diagonal_element(own * own);
    // `log A` has twice the logarithms of the semi-axes.
    let mut log_shape_covariance = Matrix6::from_diagonal(&Vector6::repeat(4.0 * AXES_SD * AXES_SD));
    if let Some(covariance) = &object.covariance {
        center_covariance += covariance.matrix.fixed_view::<3, 3>(0, 0);
        log_shape_covariance += covariance_of_log_shape(body, covariance)?;
    }
    cholesky(&center_covariance)?;
    cholesky(&log_shape_covariance)?;
    let (variances, _) = symmetric_eigen3(&center_covariance)?;
    let log_shape = log_shape(body);
    coordinates(&log_shape).iter().all(|x| x.is_finite()).then_some(PreparedObject {
        index,
        center: body.center.coords,
        center_covariance,
        largest_variance: variances[0],
        log_shape,
        log_shape_covariance,
        log_size,
    })
}

//! Merges objects whose union has more evidence than the two, and removes bodies inside others.

use nalgebra::Vector3;

use super::assignment::count_visible;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::input::point_tree::PointTree;
use crate::association::score::evidence::evidence;
use crate::association::score::fit::{Start, fit};
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::statistics::quantile;

/// Objects are tried as one when their centers are nearer than this many times the sum of their radii.
pub(crate) const NEAR: f64 = 1.2;

/// Maximum fraction of the smaller object's frames in which both have a box.
pub(crate) const SHARED_FRAMES: f64 = 0.5;

/// Centers closer than this many semi-axes of each other's bodies count as duplicates,
pub(crate) const SAME_PLACE: f64 = 0.5;
/// when the logarithms of the radii differ by less than this,
pub(crate) const SAME_SIZE: f64 = 0.35;
/// and the weaker one has less than this share of the other's views.
pub(crate) const FEWER_VIEWS: f64 = 0.6;

/// Merges objects whose union has more evidence than they have apart, the nearest first.
pub(crate) fn merge(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    objects: Vec<Object>,
) -> Vec<Object> {
    // Two objects that both have more than two thirds of all frames share too many of them to be one, and remain so.
    let frames = observations.cameras.iter().filter(|c| !c.boxes.is_empty()).count();
    let is_open = |object: &Object| 3 * object.boxes.len() <= 2 * frames;
    let apart = |a: &Object, b: &Object| (a.center - b.center).norm() / (a.radius + b.radius);
    let mut pairs = near_pairs(&objects, is_open, apart, NEAR);
    pairs.sort_by(|a, b| a.2.total_cmp(&b.2).then((a.0, a.1).cmp(&(b.0, b.1))));
    let mut objects: Vec<Option<Object>> = objects.into_iter().map(Some).collect();
    let own_evidence = |object: &Object| evidence(&context.rate, observations, statistics, object);
    for (first, second, _) in pairs {
        let (Some(a), Some(b)) = (&objects[first], &objects[second]) else { continue };
        // Two trusted ids are two objects.
        if a.trusted_id.is_some() && b.trusted_id.is_some() {
            continue;
        }
        let Some(union) = union(context, observations, statistics, a, b) else { continue };
        if own_evidence(&union) > own_evidence(a) + own_evidence(b) {
            objects[first] = Some(union);
            objects[second] = None;
        }
    }
    objects.into_iter().flatten().collect()
}

/// The merged object, if it can be fitted.
fn union(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    a: &Object,
    b: &Object,
) -> Option<Object> {
    // The boxes of the larger (or trusted) object are kept, and the other adds boxes of other frames.
    let first_stays = a.trusted_id.is_some() || b.trusted_id.is_none() && a.boxes.len() >= b.boxes.len();
    let (major, minor) = if first_stays { (a, b) } else { (b, a) };
    let taken: Vec<usize> = major.frames(observations).collect();
    let is_new = |index: &u32| taken.binary_search(&observations.boxes[*index as usize].frame).is_err();
    let mut boxes: Vec<u32> = minor.boxes.iter().copied().filter(is_new).collect();
    let shared = minor.boxes.len() - boxes.len();
    if shared as f64 > SHARED_FRAMES * minor.boxes.len().min(major.boxes.len()) as f64 {
        return None;
    }
    boxes.extend(&major.boxes);
    boxes.sort_unstable();
    let mut union = fit(observations, statistics, boxes, &[Start::body(major), Start::body(minor)])?;
    union.trusted_id = major.trusted_id;
    union.visible = count_visible(context, observations, &union);
    Some(union)
}

/// Drops the weaker of two objects that occupy the same volume and are about as large: bodies do not nest, but
/// detectors report one object twice.
pub(crate) fn drop_nested(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    objects: Vec<Object>,
) -> Vec<Object> {
    let own_evidence: Vec<f64> = objects.iter().map(|o| evidence(&context.rate, observations, statistics, o)).collect();
    let inside = |a: &Object, b: &Object| within(a, &b.center).max(within(b, &a.center));
    let most_views = objects.iter().map(|o| o.boxes.len()).max().unwrap_or(0) as f64;
    let has_few = |object: &Object| (object.boxes.len() as f64) < FEWER_VIEWS * most_views;
    let mut gone = vec![false; objects.len()];
    for (a, b, _) in near_pairs(&objects, has_few, inside, SAME_PLACE) {
        if gone[a] || gone[b] || (objects[a].radius / objects[b].radius).ln().abs() >= SAME_SIZE {
            continue;
        }
        let (weaker, other) = if own_evidence[a] >= own_evidence[b] { (b, a) } else { (a, b) };
        let views = |k: usize| objects[k].boxes.len() as f64;
        if objects[weaker].trusted_id.is_none() && views(weaker) < FEWER_VIEWS * views(other) {
            gone[weaker] = true;
        }
    }
    objects.into_iter().zip(gone).filter(|(_, gone)| !gone).map(|(object, _)| object).collect()
}

/// How far a point is from the center of a body, in its semi-axes.
pub(crate) fn within(body: &Object, point: &Vector3<f64>) -> f64 {
    body.root.lu().solve(&(point - body.center)).map_or(f64::INFINITY, |x| x.norm())
}

/// Pairs of nearby objects of one category with their distances; `is_open` holds for at least one of them.
fn near_pairs(
    objects: &[Object],
    is_open: impl Fn(&Object) -> bool,
    apart: impl Fn(&Object, &Object) -> f64,
    limit: f64,
) -> Vec<(usize, usize, f64)> {
    let mut radii: Vec<f64> = objects.iter().map(|o| o.radius).collect();
    let Some(large) = quantile(&mut radii, 0.9) else { return Vec::new() };
    let tree = PointTree::new(objects.iter().map(|o| o.center).collect());
    let mut pairs = Vec::new();
    for (place, object) in objects.iter().enumerate().filter(|(_, object)| is_open(object)) {
        for other in tree.within(&object.center, 2.0 * large) {
            let other = other as usize;
            // Of two open ones the pair comes up twice.
            let is_new = other > place || other < place && !is_open(&objects[other]);
            if is_new && objects[other].category == object.category {
                let (first, second) = (place.min(other), place.max(other));
                let distance = apart(&objects[first], &objects[second]);
                if distance < limit {
                    pairs.push((first, second, distance));
                }
            }
        }
    }
    pairs.sort_unstable_by_key(|&(first, second, _)| (first, second));
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::options::AssociateOptions;
    use crate::association::test_scenes::{ellipsoid, of_frames};
    use crate::geometry::Ellipsoid;

    fn moved(by: f64) -> Ellipsoid {
        Ellipsoid { center: ellipsoid().center + Vector3::new(0.0, 0.0, by), ..ellipsoid() }
    }

    /// An object of some of the views, from a start near the body.
    fn object_of(observations: &Observations, statistics: &SceneStatistics, body: &Ellipsoid, views: &[u32]) -> Object {
        let start = Start::sphere(body.center.coords - observations.origin, 2.0);
        let object = fit(observations, statistics, views.to_vec(), &[start]).unwrap();
        Object { visible: 12, ..object }
    }

    /// The views of the objects that come out of two, of the body in the first six views and of another, so far above it,
    /// in the last six, after `change`.
    fn of_halves(by: f64, change: impl Fn(&mut [Object; 2])) -> Vec<usize> {
        let body_of = |frame: usize| vec![(if frame < 6 { ellipsoid() } else { moved(by) }, None)];
        let (scene, observations, mut statistics) = of_frames(12, body_of);
        (statistics.volume, statistics.edge_noise) = (1e5, 0.02);
        let options = AssociateOptions::default();
        let context = AssociationContext::new(&scene, &observations, &options);
        let mut halves = [(0, 0.0), (6, by)].map(|(first, by)| {
            object_of(&observations, &statistics, &moved(by), &(first..first + 6).collect::<Vec<_>>())
        });
        change(&mut halves);
        merge(&context, &observations, &statistics, halves.into()).iter().map(|object| object.boxes.len()).collect()
    }

    #[test]
    fn halves_of_one_object_become_one_and_two_objects_stay_two() {
        assert_eq!(of_halves(0.0, |_| ()), [12]);
        // Beside each other: near enough to be tried.
        assert_eq!(of_halves(4.0, |_| ()), [6, 6]);
    }

    #[test]
    fn trusted_ids_and_categories_stay_apart() {
        let trust = |halves: &mut [Object; 2], ids: [Option<u32>; 2]| {
            for (half, id) in halves.iter_mut().zip(ids) {
                half.trusted_id = id;
            }
        };
        assert_eq!(of_halves(0.0, |halves| trust(halves, [Some(0), Some(1)])), [6, 6]);
        assert_eq!(of_halves(0.0, |halves| trust(halves, [None, Some(1)])), [12]);
        assert_eq!(of_halves(0.0, |halves| halves[1].category = 1), [6, 6]);
    }

    /// Which of two objects are left by [`drop_nested`]: one of eight views, and one of so many other views of the same
    /// body, its size times a factor.
    fn nested(views: u32, size: f64, trusted: bool) -> Vec<usize> {
        let (scene, observations, mut statistics) = of_frames(16, |_| vec![(ellipsoid(), None)]);
        statistics.volume = 1e5;
        let options = AssociateOptions::default();
        let context = AssociationContext::new(&scene, &observations, &options);
        let large = object_of(&observations, &statistics, &ellipsoid(), &(0..8).collect::<Vec<_>>());
        let mut small = object_of(&observations, &statistics, &ellipsoid(), &(8..8 + views).collect::<Vec<_>>());
        small.root *= size;
        small.radius *= size;
        small.trusted_id = trusted.then_some(0);
        let left = drop_nested(&context, &observations, &statistics, vec![small, large]);
        left.iter().map(|object| object.boxes.len()).collect()
    }

    #[test]
    fn the_weaker_of_two_bodies_in_one_place_goes_where_it_has_much_fewer_views() {
        assert_eq!(nested(4, 1.0, false), [8]);
        assert_eq!(nested(5, 1.0, false), [5, 8]);
        // A thing inside of another is smaller, and stays; so does one whose id is trusted.
        assert_eq!(nested(4, 0.6, false), [4, 8]);
        assert_eq!(nested(4, 1.0, true), [4, 8]);
    }
}

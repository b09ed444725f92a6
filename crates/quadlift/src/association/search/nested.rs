//! Removes bodies inside others.

use nalgebra::Vector3;

use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::score::evidence::evidence;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::geometry::point_tree::PointTree;
use crate::optimize::median::quantile;

/// Centers closer than this many semi-axes of each other's bodies count as duplicates,
pub(crate) const SAME_PLACE: f64 = 0.5;
/// when the logarithms of the radii differ by less than this,
pub(crate) const SAME_SIZE: f64 = 0.35;
/// and the weaker one has less than this share of the other's views.
pub(crate) const FEWER_VIEWS: f64 = 0.6;

/// Drops the weaker of two objects that occupy the same volume and are about as large: bodies do not nest, but
/// detectors report one object twice.
pub(crate) fn drop_nested(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    objects: Vec<Object>,
) -> Vec<Object> {
    let own_evidence: Vec<f64> = objects.iter().map(|o| evidence(&context.rate, observations, statistics, o)).collect();
    let most_views = objects.iter().map(|o| o.boxes.len()).max().unwrap_or(0) as f64;
    let has_few = |object: &Object| (object.boxes.len() as f64) < FEWER_VIEWS * most_views;
    let mut gone = vec![false; objects.len()];
    for (a, b) in near_pairs(&objects, has_few) {
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

/// Pairs of objects of one category whose centers are in each other's bodies (by `SAME_PLACE`); `is_open` holds for at
/// least one of the two.
fn near_pairs(objects: &[Object], is_open: impl Fn(&Object) -> bool) -> Vec<(usize, usize)> {
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
                let (first, second) = (&objects[place.min(other)], &objects[place.max(other)]);
                if within(first, &second.center).max(within(second, &first.center)) < SAME_PLACE {
                    pairs.push((place.min(other), place.max(other)));
                }
            }
        }
    }
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::options::AssociateOptions;
    use crate::association::score::fit::{Start, fit};
    use crate::association::test_scenes::{ellipsoid, of_frames};

    /// An object of some of the views, from a start near the body.
    fn object_of(observations: &Observations, statistics: &SceneStatistics, views: &[u32]) -> Object {
        let start = Start::sphere(ellipsoid().center.coords - observations.origin, 2.0);
        let object = fit(observations, statistics, views.to_vec(), &[start]).unwrap();
        Object { visible: 12, ..object }
    }

    /// Which of two objects are left by [`drop_nested`]: one of eight views, and one of so many other views of the same
    /// body, its size times a factor.
    fn nested(views: u32, size: f64, trusted: bool) -> Vec<usize> {
        let (scene, observations, mut statistics) = of_frames(16, |_| vec![(ellipsoid(), None)]);
        statistics.volume = 1e5;
        let options = AssociateOptions::default();
        let context = AssociationContext::new(&scene, &observations, &options);
        let large = object_of(&observations, &statistics, &(0..8).collect::<Vec<_>>());
        let mut small = object_of(&observations, &statistics, &(8..8 + views).collect::<Vec<_>>());
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

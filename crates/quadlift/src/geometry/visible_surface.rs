//! The visible surface of a body: how far it is where the rays of pixels meet it.

use nalgebra::{Point3, Vector2, Vector3};

use super::body::Body;
use super::bounding_box::BoundingBox;
use super::camera::Projection;
use super::convex_body::ConvexBody;

/// Steps and bisections of the search along a ray, for bodies without a closed form.
const STEPS: usize = 60;
const BISECTIONS: usize = 40;

/// Median depth along the optical axis of a body's visible surface, over a grid of rays through a box of the image (`rays` along each side);
/// `None` if none meets the body, or if it is not in front of the camera.
pub fn visible_depth(projection: &Projection, bounding_box: &BoundingBox, body: &Body, rays: usize) -> Option<f64> {
    let camera = projection.center_in_world()?;
    let inverse = projection.m().try_inverse()?;
    let size = bounding_box.size();
    let share = |k: usize| (k as f64 + 0.5) / rays as f64;
    let depth_of = |k: usize| {
        let pixel =
            Vector2::new(bounding_box.x0 + share(k % rays) * size.x, bounding_box.y0 + share(k / rays) * size.y);
        let ray = (inverse * Vector3::new(pixel.x, pixel.y, 1.0)).try_normalize(0.0)?;
        Some(projection.depth(&(camera + ray * first_meeting(body, &camera, &ray)?)))
    };
    let mut depths: Vec<f64> = (0..rays * rays).filter_map(depth_of).collect();
    depths.sort_by(f64::total_cmp);
    depths.get(depths.len() / 2).copied().filter(|depth| *depth > 0.0)
}

/// Distance from the camera at which a ray (a unit vector) first meets a body.
pub(crate) fn first_meeting(body: &Body, camera: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let to_local = body.rotation.inverse();
    let crossing = body.kind.crossing(&(to_local * (camera - body.center)), &(to_local * ray), &body.half_extents);
    crossing.map_or_else(|| searched_meeting(body, camera, ray), |[enter, leave]| (enter <= leave).then_some(enter))
}

fn searched_meeting(body: &Body, camera: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let reach = body.half_extents.norm();
    let start = (body.center - camera).dot(ray) - reach;
    let step = 2.0 * reach / STEPS as f64;
    let is_inside = |t: f64| body.contains(&(camera + ray * t));
    let mut inside = (0..=STEPS).map(|k| start + step * k as f64).find(|t| is_inside(*t))?;
    let mut outside = inside - step;
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (inside + outside);
        if is_inside(middle) { inside = middle } else { outside = middle }
    }
    Some(inside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::BodyKind;
    use nalgebra::Rotation3;

    #[test]
    fn closed_forms_are_what_the_search_finds() {
        let rotation = Rotation3::from_euler_angles(0.3, -0.7, 1.1);
        let (center, sizes) = (Point3::new(0.4, -0.2, 6.0), Vector3::new(2.0, 0.8, 0.5));
        let body = |kind| Body { center, half_extents: sizes, rotation, kind };
        let mut met = 0;
        for body in [BodyKind::Ellipsoid, BodyKind::Cuboid, BodyKind::Cylinder].map(body) {
            for k in 0..400 {
                let (x, y) = (f64::from(k % 20) - 9.7, f64::from(k / 20) - 9.3);
                let ray = Vector3::new(0.05 * x, 0.05 * y, 1.0).normalize();
                let [closed, searched] =
                    [first_meeting(&body, &Point3::origin(), &ray), searched_meeting(&body, &Point3::origin(), &ray)];
                // The search may step over a body that a ray only grazes.
                if let Some(searched) = searched {
                    met += 1;
                    assert!((closed.unwrap() - searched).abs() < 1e-9, "{closed:?} {searched}");
                }
            }
        }
        assert!(met > 50, "{met}");
    }
}

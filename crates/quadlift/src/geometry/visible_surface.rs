//! The visible surface of a body: how far it is where the rays of pixels meet it.

use nalgebra::{Point3, Vector2, Vector3};

use super::Body;
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
fn first_meeting(body: &Body, camera: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let local =
        |rotation: &nalgebra::Rotation3<f64>| (rotation.inverse() * (camera - body.center()), rotation.inverse() * ray);
    match body {
        Body::Ellipsoid(ellipsoid) => {
            let (from, along) = local(&ellipsoid.rotation);
            let (from, along) = (from.component_div(&ellipsoid.semi_axes), along.component_div(&ellipsoid.semi_axes));
            let (a, b, c) = (along.norm_squared(), from.dot(&along), from.norm_squared() - 1.0);
            let discriminant = b * b - a * c;
            (discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
        }
        Body::Cuboid(cuboid) => {
            let (from, along) = local(&cuboid.rotation);
            let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
            for axis in 0..3 {
                let half = cuboid.half_extents[axis];
                if along[axis] == 0.0 {
                    if from[axis].abs() > half {
                        return None;
                    }
                    continue;
                }
                let (a, b) = ((-half - from[axis]) / along[axis], (half - from[axis]) / along[axis]);
                (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
            }
            (enter <= leave).then_some(enter)
        }
        Body::Cylinder(_) | Body::Superellipsoid(_) => searched_meeting(body, camera, ray),
    }
}

fn searched_meeting(body: &Body, camera: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let reach = body.half_extents().norm();
    let start = (body.center() - camera).dot(ray) - reach;
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
    use crate::geometry::{Cuboid, Ellipsoid};
    use nalgebra::Rotation3;

    #[test]
    fn closed_forms_are_what_the_search_finds() {
        let rotation = Rotation3::from_euler_angles(0.3, -0.7, 1.1);
        let (center, sizes) = (Point3::new(0.4, -0.2, 6.0), Vector3::new(2.0, 0.8, 0.5));
        let bodies = [
            Body::Ellipsoid(Ellipsoid { center, semi_axes: sizes, rotation }),
            Body::Cuboid(Cuboid { center, half_extents: sizes, rotation }),
        ];
        let mut met = 0;
        for body in bodies {
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

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::conditions::Conditions;
use super::fit::{Workspace, linearize, residuals};
use super::log_evidence::log_likelihood_over_variance;
use super::rows::Rows;
use super::scan::LinearRows;
use super::solid::{Family, Solid, Step};
use crate::geometry::{Body, BoundingBox, CamFromWorld, Intrinsics, Projection, project_bounding_box};
use crate::observer::{Unobserved, Watch};
use crate::optimize::normal_equations::PARAMETERS;
use crate::scene::View;

/// Cameras on a circle of radius 8 about the origin, at several heights, that look at it.
fn cameras(count: usize) -> Vec<Projection> {
    let intrinsics = Intrinsics::new(600.0, 600.0, 320.0, 240.0).unwrap();
    let camera = |k: usize| {
        let angle = std::f64::consts::TAU * k as f64 / count as f64;
        let position = Vector3::new(8.0 * angle.cos(), 8.0 * angle.sin(), 1.0 + (k % 3) as f64);
        let z = -position.normalize();
        let x = z.cross(&Vector3::z()).normalize();
        let rotation = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
        let mut pose = nalgebra::Matrix3x4::zeros();
        pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        pose.set_column(3, &-(rotation * position));
        Projection::from_camera(&intrinsics, &CamFromWorld::new(pose).unwrap())
    };
    (0..count).map(camera).collect()
}

fn views(body: &Body, count: usize) -> Vec<View> {
    let view = |(k, projection): (usize, Projection)| {
        let bounding_box = project_bounding_box(&projection, body).unwrap();
        View { frame_index: k, ..View::from_box(projection, bounding_box) }
    };
    cameras(count).into_iter().enumerate().map(view).collect()
}

/// A body of each family, in the world as frame.
fn solid(family: Family) -> Solid {
    Solid {
        family,
        center: Vector3::new(0.1, -0.2, 0.3),
        axes: *Rotation3::from_euler_angles(0.4, -0.3, 0.9).matrix(),
        half_extents: if family == Family::Cylinder {
            Vector3::new(0.6, 0.6, 0.9)
        } else {
            Vector3::new(1.0, 0.7, 0.5)
        },
        cuboid_share: 0.4,
        up: None,
    }
}

/// A body of the world in the frame of rows.
fn in_frame(body: &Solid, rows: &Rows) -> Solid {
    let center = (body.center - rows.origin.coords) / rows.unit;
    Solid { center, half_extents: body.half_extents / rows.unit, ..*body }
}

fn world(body: &Solid) -> Body {
    body.in_world(&nalgebra::Point3::origin(), 1.0)
}

/// Bodies touch the planes of their boxes: other than at kinks, which are rounded.
#[test]
fn bodies_leave_no_residuals_in_their_own_boxes() {
    for family in Family::ALL {
        let body = solid(family);
        let rows = Rows::new(&views(&world(&body), 7), 67.0).unwrap();
        let mut work = Workspace::default();
        let conditions = Conditions::first(1.0, 0.4);
        residuals(&rows, &in_frame(&body, &rows), &conditions, &mut work);
        let largest = work.views.iter().flat_map(|view| view.residual.0).fold(0.0f64, |a, x| a.max(x.abs()));
        assert!(largest < 2e-3, "{family:?}: {largest}");
    }
}

/// The cost has the slope `2 g`, by differences; wrong boxes and edges at the border included. The slopes by half extents leave out what the
/// rounded kinks add.
#[test]
fn gradients_of_the_likelihood_are_those_of_differences() {
    for family in Family::ALL {
        let body = solid(family);
        let mut views = views(&world(&body), 6);
        // One box is of something else, one ends at the border.
        let [x0, y0, x1, y1] = views[1].bounding_box.unwrap().edges();
        views[1].bounding_box = BoundingBox::new([x0 + 60.0, y0, x1 + 90.0, y1 + 20.0]).ok();
        views[2].cut_off = [true, false, false, false];
        views[3].occluded_edges = [false, false, true, false];
        let rows = Rows::new(&views, 67.0).unwrap();
        let conditions = Conditions { view_weight: 0.7, opposite_correlation: 0.6, ..Conditions::first(0.05, 0.4) };
        let mut work = Workspace::default();
        let mut at = in_frame(&body, &rows);
        at.center += Vector3::new(0.03, 0.02, -0.04);
        at.half_extents *= 1.05;
        let gradient = linearize(&rows, &at, &conditions, &mut work).gradient;
        for k in (0..PARAMETERS).filter(|&k| family != Family::Cylinder || k != 7) {
            let mut step = Step::zeros();
            step[k] = 1e-6;
            let mut cost = |step: &Step| linearize(&rows, &at.moved(step), &conditions, &mut work).cost;
            let difference = (cost(&step) - cost(&-step)) / 4e-6;
            let error = (difference - gradient[k]).abs();
            assert!(error < 1e-3 * (1.0 + gradient.amax()), "{family:?} {k}: {difference} {}", gradient[k]);
        }
    }
}

/// Exact boxes of a cuboid or cylinder, at its own axes: the linear problem gives the body, and no other axes are better.
#[test]
fn the_scan_is_exact_at_the_true_axes() {
    for family in [Family::Cuboid, Family::Cylinder] {
        let body = solid(family);
        let rows = Rows::new(&views(&world(&body), 9), 67.0).unwrap();
        let expected = in_frame(&body, &rows);
        // No ridge to speak of, and equal weights: depths are those of the true center.
        let conditions = Conditions { wrong_share: 0.0, shape_sd: 1e6, ..Conditions::first(10.0, 0.4) };
        let mut work = Workspace::default();
        residuals(&rows, &expected, &conditions, &mut work);
        let linear = LinearRows::new(&rows, &expected, &conditions, &work);
        let at = |axes: &Matrix3<f64>| match family {
            Family::Cylinder => {
                let found = linear.cylinder(&axes.column(2).into_owned());
                let [radius, half_height] = found.half_extents;
                (found.cost, found.center, Vector3::new(radius, radius, half_height))
            }
            _ => {
                let found = linear.cuboid(axes);
                (found.cost, found.center, found.half_extents.into())
            }
        };
        let (cost, center, half_extents) = at(&expected.axes);
        assert!((center - expected.center).norm() < 1e-4, "{family:?} {center}");
        assert!((half_extents - expected.half_extents).norm() < 1e-4, "{family:?} {half_extents}");
        let turned = expected.axes * Rotation3::new(Vector3::new(0.1, -0.05, 0.02)).matrix();
        assert!(at(&turned).0 > cost + 1e-6);
    }
}

/// Laplace's approximation over the object's variance, against the sum over a fine grid.
#[test]
fn the_integral_over_the_variance_is_that_of_a_grid() {
    let body = solid(Family::Ellipsoid);
    let rows = Rows::new(&views(&world(&body), 12), 67.0).unwrap();
    let mut at = in_frame(&body, &rows);
    at.half_extents *= 1.04;
    for noise in [0.025, 0.05, 0.1] {
        let conditions = Conditions::first(noise, 0.4);
        let mut work = Workspace::default();
        residuals(&rows, &at, &conditions, &mut work);
        let found = log_likelihood_over_variance(&rows, &conditions, &work);
        let step = 0.002;
        let sum: f64 = (-3000..3000)
            .map(|k| {
                let log_variance = f64::from(k) * step;
                let scaled = conditions.times((0.5 * log_variance).exp());
                let mut work = Workspace::default();
                // Clutter is of the scene's noise, and densities are per residual in units of that.
                let log = residuals(&rows, &at, &scaled, &mut work);
                let edges = 4.0 * rows.views.len() as f64;
                let prior = 4.0 * 4f64.ln() - 6f64.ln() - 4.0 * log_variance - 4.0 * (-log_variance).exp();
                (log - 0.5 * edges * log_variance + prior).exp() * step
            })
            .sum();
        assert!((found - sum.ln()).abs() < 0.25, "{noise}: {found} {}", sum.ln());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Whatever the boxes: no panic, no number that is none, and an end.
    #[test]
    fn any_boxes_end_in_finite_bodies(
        boxes in prop::collection::vec((0.0f64..640.0, 0.0f64..480.0, 1e-3f64..400.0, 1e-3f64..400.0), 2..7),
        upright in any::<bool>(),
    ) {
        let views: Vec<View> = cameras(boxes.len())
            .into_iter()
            .zip(&boxes)
            .enumerate()
            .map(|(k, (projection, (x, y, w, h)))| {
                let bounding_box = BoundingBox::new([*x, *y, x + w, y + h]).unwrap();
                View { frame_index: k, ..View::from_box(projection, bounding_box) }.with_image_size(640.0, 480.0)
            })
            .collect();
        if let Some(rows) = Rows::new(&views, 67.0) {
            let plan = super::Plan { family: None, up: upright.then(Vector3::z) };
            let first = super::first_conditions(0.4);
            let object = super::Object::new(rows, None, &first, &mut Workspace::default());
            let watch = Watch::new(&Unobserved, 1);
            let scene = super::SceneFit::new(object.into_iter().collect(), first, &plan, &watch);
            for object in &scene.objects {
                let body = object.fit().body;
                prop_assert!(body.center.iter().chain(body.half_extents.iter()).chain(body.axes.iter()).all(|x| x.is_finite()));
            }
            prop_assert!(scene.conditions.noise.iter().all(|sd| sd.is_finite() && *sd > 0.0));
        }
    }
}

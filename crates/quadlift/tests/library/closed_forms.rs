//! The closed forms on synthetic views: what they recover, what they refuse, and what must not change the result.

use crate::common::{Vech, Views, arc, camera, dual_conic, observe, projected, random_ellipsoid, scene, vech4};
use crate::test_cases::cases;
use nalgebra::{Matrix4, Point3, Vector2, Vector3, Vector4};
use proptest::prelude::*;
use quadlift::geometry::{Ellipse, Ellipsoid, Projection, vech3};
use quadlift::solve::{ClosedFormError, RegOptions, RegSolution, lfd, pfd, reg};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The ellipsoid seen by cameras at the given centers that look at the given targets.
fn look(body: &Ellipsoid, cameras: &[(Vector3<f64>, Vector3<f64>)], noise: f64) -> Views {
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    cameras.iter().map(|(center, target)| observe(camera(center, target), body, noise, &mut rng)).collect()
}

fn relative_error(a: &Ellipsoid, b: &Ellipsoid) -> f64 {
    let center = (a.center - b.center).norm() / b.semi_axes.max();
    center.max((a.semi_axes - b.semi_axes).norm() / b.semi_axes.norm())
}

#[test]
fn exact_outlines_give_the_ellipsoid() {
    for (count, seed) in [(3, 1), (4, 2), (20, 3), (101, 4)] {
        let (views, body) = scene(count, 0.0, seed);
        let mut sorted = body;
        sorted.semi_axes.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
        let lifted = lfd(&views).unwrap().to_ellipsoid().unwrap();
        assert!(relative_error(&lifted, &sorted) < 1e-8, "{count} views, lfd");
        assert!((lifted.shape() - body.shape()).norm() < 1e-7 * body.shape().norm());
        let solution = pfd(&views).unwrap();
        let lifted = solution.dual_quadric.to_ellipsoid().unwrap();
        assert!(relative_error(&lifted, &sorted) < 1e-6, "{count} views, pfd");
        // beta C* = P Q* P^T
        for ((projection, ellipse), beta) in views.iter().zip(&solution.betas) {
            let p = projection.matrix();
            let image = p * solution.dual_quadric.matrix() * p.transpose();
            assert!((image - dual_conic(ellipse) * *beta).norm() < 1e-6 * image.norm());
        }
    }
}

#[test]
fn too_few_views_are_refused() {
    let (views, _) = scene(3, 0.1, 1);
    let too_few = |found, needed| ClosedFormError::TooFewViews { found, needed };
    for count in 0..3 {
        assert_eq!(pfd(&views[..count]), Err(too_few(count, 3)));
        assert_eq!(lfd(&views[..count]), Err(too_few(count, 3)));
    }
    assert_eq!(reg(&views[..1], &RegOptions::default()), Err(too_few(1, 2)));
}

/// Views that leave the object open, far from the world's origin and near it, with and without noise.
fn degenerate_views() -> Vec<(String, Views)> {
    let body = random_ellipsoid(&mut ChaCha8Rng::seed_from_u64(5));
    let mut all = Vec::new();
    for noise in [0.0, 0.1, 0.3] {
        for count in [3, 5, 20, 100] {
            for shift in [0.0, 300.0, 1e5] {
                let shift = Vector3::new(shift, -shift, 0.4 * shift);
                let body = Ellipsoid { center: body.center + shift, ..body };
                let centers: Vec<_> = arc(2, 0.6).iter().map(|center| center + shift).collect();
                let aside = |k: usize| Vector3::new((k % 5) as f64, (k % 7) as f64, (k % 3) as f64) * 6.0 + shift;
                let make = |center: &dyn Fn(usize) -> Vector3<f64>, target: &dyn Fn(usize) -> Vector3<f64>| {
                    let cameras: Vec<_> = (0..count).map(|k| (center(k), target(k))).collect();
                    look(&body, &cameras, noise)
                };
                let name = |kind| format!("{kind}, {count} views, noise {noise}, shift {}", shift.x);
                all.push((name("identical"), make(&|_| centers[1], &|_| shift)));
                all.push((name("pure rotation"), make(&|_| centers[1], &aside)));
                all.push((name("two centers"), make(&|k| centers[k % 2], &aside)));
            }
        }
    }
    all
}

#[test]
fn views_that_leave_the_object_open_are_a_status() {
    for (name, views) in degenerate_views() {
        assert_eq!(pfd(&views), Err(ClosedFormError::Degenerate), "pfd, {name}");
        assert_eq!(lfd(&views), Err(ClosedFormError::Degenerate), "lfd, {name}");
    }
}

#[test]
fn badly_scaled_views_are_not_taken_for_degenerate() {
    let body = random_ellipsoid(&mut ChaCha8Rng::seed_from_u64(6));
    for noise in [0.0, 0.1, 0.3] {
        // Down to an arc of 30 arc seconds, up to 5000 camera distances from the world's origin, units over 1e9.
        for span in [1.0, 0.1, 0.01, 0.001, 0.0001] {
            let cameras: Vec<_> = arc(20, span).into_iter().map(|center| (center, Vector3::zeros())).collect();
            assert!(pfd(&look(&body, &cameras, noise)).is_ok(), "span {span}");
        }
        for (shift, scale) in [(1e2, 1.0), (1e4, 1.0), (1e6, 1.0), (0.0, 1e-3), (0.0, 1e3), (0.0, 1e6)] {
            let shift = Vector3::new(shift, -shift, 0.5 * shift);
            let moved = Ellipsoid {
                center: Point3::from(body.center.coords * scale + shift),
                semi_axes: body.semi_axes * scale,
                ..body
            };
            let cameras: Vec<_> = arc(20, 1.0).iter().map(|center| (center * scale + shift, shift)).collect();
            assert!(pfd(&look(&moved, &cameras, noise)).is_ok(), "shift {}, scale {scale}", shift.x);
        }
    }
}

#[test]
fn numbers_beyond_the_range_of_floats_are_a_status() {
    let (mut views, _) = scene(6, 0.1, 1);
    // Numbers that are not finite are no ellipse; in pixels the squares of these are not finite. `lfd` scales each ellipse.
    views[2].1 = Ellipse::new(views[2].1.center(), Vector2::new(1e200, 1.0), 0.1).unwrap();
    assert_eq!(pfd(&views), Err(ClosedFormError::Degenerate));
    assert!(lfd(&views).is_ok());
}

#[test]
fn whatever_comes_out_of_extreme_numbers_is_finite() {
    let (views, _) = scene(6, 0.1, 1);
    for factor in [0.0, 1e-300, 1e-150, 1e-30, 1e30, 1e150, 1e300] {
        let mut sizes = views.clone();
        let changed = sizes[2].1.semi_axes().component_mul(&Vector2::new(factor, 1.0));
        // A size of zero is no ellipse.
        sizes[2].1 = Ellipse::new(sizes[2].1.center(), changed, sizes[2].1.angle()).unwrap_or(sizes[2].1);
        let mut cameras = views.clone();
        for (projection, _) in &mut cameras {
            *projection = Projection::from_matrix(projection.matrix() * factor).unwrap_or(*projection);
        }
        for views in [sizes, cameras] {
            if let Ok(solution) = pfd(&views) {
                let all = solution.betas.iter().chain(solution.dual_quadric.matrix().iter());
                assert!(all.chain([&solution.residual]).all(|x| x.is_finite()), "pfd, {factor:e}");
            }
            if let Ok(solution) = lfd(&views) {
                let all = solution.shape.iter().chain(solution.center.iter());
                assert!(
                    {
                        let mut all = all;
                        all.all(|x| x.is_finite())
                    },
                    "lfd, {factor:e}"
                );
            }
            if let Ok(solution) = reg(&views, &RegOptions::default()) {
                let all = solution.betas.iter().chain(solution.dual_quadric.matrix().iter());
                assert!(all.chain([&solution.cost]).all(|x| x.is_finite()), "reg, {factor:e}");
            }
        }
    }
}

proptest! {
    #![proptest_config(cases(40))]

    #[test]
    fn lfd_moves_and_scales_with_the_world(
        seed in 0u64..1000, count in 4usize..30, noise in prop_oneof![Just(0.0), 0.01..0.2f64],
        exponent in -3i32..=3, far in any::<bool>(),
    ) {
        let body = random_ellipsoid(&mut ChaCha8Rng::seed_from_u64(seed));
        let cameras: Vec<_> = arc(count, 1.0).into_iter().map(|center| (center, Vector3::zeros())).collect();
        let views = look(&body, &cameras, noise);
        let scale = 10f64.powi(exponent);
        let shift = if far { Vector3::new(1e6, -1e6, 5e5) * scale } else { Vector3::zeros() };
        // The same images from cameras composed in the other world, as a user would.
        let moved: Views = cameras
            .iter()
            .zip(&views)
            .map(|((center, target), (_, ellipse))| (camera(&(center * scale + shift), &(target * scale + shift)), *ellipse))
            .collect();
        let (here, there) = (lfd(&views).unwrap(), lfd(&moved).unwrap());
        let size = here.shape.norm();
        let center = (there.center.coords - shift - here.center.coords * scale).norm() / (scale * size.sqrt());
        prop_assert!(center < 1e-6, "center {center:e}");
        let shape = (there.shape / (scale * scale) - here.shape).norm() / size;
        prop_assert!(shape < 1e-6, "shape {shape:e}");
    }
}

/// The regularized cost from its definition, with the best sphere's part left out: `|M w|^2` at `v_10 = -1`.
fn data_cost(views: &Views, v: &Vech, betas: &[f64]) -> f64 {
    let cost = |((projection, ellipse), beta): (&(Projection, Ellipse), &f64)| {
        (projected(projection, v) - vech3(&dual_conic(ellipse)) * *beta).norm_squared()
    };
    views.iter().zip(betas).map(cost).sum()
}

#[test]
fn a_strong_regularizer_gives_a_sphere_and_a_weak_one_the_closed_form() {
    let (views, body) = scene(20, 0.0, 3);
    let solve = |lambda: f64| reg(&views, &RegOptions { lambda }).unwrap();
    let strong = solve(1e22).dual_quadric.to_ellipsoid().unwrap();
    assert!(strong.semi_axes[0] / strong.semi_axes[2] < 1.01, "{}", strong.semi_axes);
    assert!((strong.center - body.center).norm() < 0.2 * body.semi_axes.max());
    let weak = solve(1.0).dual_quadric.to_ellipsoid().unwrap();
    assert!((weak.shape() - body.shape()).norm() < 1e-3 * body.shape().norm());
}

#[test]
fn the_regularized_solution_is_a_minimum_of_the_cost_as_the_paper_writes_it() {
    for (count, seed) in [(2, 1), (3, 2), (20, 3)] {
        let (views, _) = scene(count, 0.1, seed);
        let lambda = 1e16;
        let RegSolution { dual_quadric, betas, cost, .. } = reg(&views, &RegOptions { lambda }).unwrap();
        let v = vech4(dual_quadric.matrix());
        assert_eq!(v[9], -1.0);
        // The sphere's part of the cost, minimized by brute force: coordinate descent over (t, ln a, ln b).
        let distance = |v: &Vech, s: &[f64; 5]| -> f64 {
            let translation = Matrix4::new_translation(&Vector3::new(s[0], s[1], s[2]));
            let (a, b) = (s[3].exp(), s[4].exp());
            let d = Matrix4::from_diagonal(&Vector4::new(a, a, a, -b));
            (v - vech4(&(translation * d * translation.transpose()))).norm_squared()
        };
        let center = -Vector3::new(v[3], v[6], v[8]) / v[9];
        let start = [-center.x, -center.y, -center.z, ((v[0] + v[4] + v[7] + center.norm_squared()) / 3.0).ln(), 0.0];
        let nearest = |v: &Vech| -> f64 {
            let mut s = start;
            let (mut best, mut step) = (distance(v, &s), 0.1);
            while step > 1e-9 {
                let before = best;
                for k in 0..5 {
                    for sign in [1.0, -1.0] {
                        let mut next = s;
                        next[k] += sign * step;
                        if distance(v, &next) < best {
                            (s, best) = (next, distance(v, &next));
                        }
                    }
                }
                if best == before {
                    step *= 0.5;
                }
            }
            best
        };
        let total = |v: &Vech, betas: &[f64]| data_cost(&views, v, betas) + lambda * nearest(v);
        let here = total(&v, &betas);
        assert!((here - cost).abs() < 1e-3 * cost, "{count} views: {here:e} {cost:e}");
        for k in 0..9 {
            for sign in [1.0, -1.0] {
                let mut moved = v;
                moved[k] += sign * 0.02 * v[k].abs().max(1.0);
                assert!(total(&moved, &betas) > cost, "{count} views, v_{k}");
            }
        }
        for f in 0..count {
            let mut moved = betas.clone();
            moved[f] *= 1.0 + 1e-4;
            assert!(total(&v, &moved) > cost);
        }
    }
}

#[test]
fn reg_needs_two_centers() {
    let body = random_ellipsoid(&mut ChaCha8Rng::seed_from_u64(5));
    let center = arc(2, 1.0)[1];
    let turned: Vec<_> = (0..4).map(|k| (center, Vector3::new(0.0, 3.0 * k as f64, 0.0))).collect();
    assert_eq!(reg(&look(&body, &turned, 0.1), &RegOptions::default()), Err(ClosedFormError::Degenerate));
}

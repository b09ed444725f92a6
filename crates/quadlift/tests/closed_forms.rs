//! x
mod common;
use common::*;
use nalgebra::{Point3, Vector3};
use quadlift::geometry::*;
use quadlift::solve::*;
use rand::SeedableRng;
#[test]
fn calib() {
    let show = |name: &str, v: &Views| {
        eprint!("{name}: ");
        let r = pfd(v);
        eprintln!("   {:?}", r.map(|s| s.iterations));
    };
    for noise in [0.0, 0.1, 0.3] {
        for n in [3, 4, 5, 20, 100] {
            for seed in 0..3 {
                show(&format!("ordinary {n} {noise}"), &scene(n, noise, seed).0);
            }
        }
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let body = random_ellipsoid(&mut rng);
        for span in [0.1, 0.01, 0.001, 0.0001] {
            let v: Views =
                arc(20, span).iter().map(|c| observe(camera(c, &Vector3::zeros()), &body, noise, &mut rng)).collect();
            show(&format!("narrow {span} {noise}"), &v);
        }
        for shift in [1e2, 1e3, 1e4, 1e5, 1e6] {
            let s = Vector3::new(shift, -shift, 0.5 * shift);
            let b = Ellipsoid { center: body.center + s, ..body };
            let v: Views = arc(20, 1.0).iter().map(|c| observe(camera(&(c + s), &s), &b, noise, &mut rng)).collect();
            show(&format!("shift {shift} {noise}"), &v);
        }
        for scale in [1e-3, 1e3, 1e6] {
            let b = Ellipsoid {
                center: Point3::from(body.center.coords * scale),
                semi_axes: body.semi_axes * scale,
                ..body
            };
            let v: Views = arc(20, 1.0)
                .iter()
                .map(|c| observe(camera(&(c * scale), &Vector3::zeros()), &b, noise, &mut rng))
                .collect();
            show(&format!("scale {scale} {noise}"), &v);
        }
        // degenerate
        for n in [3, 5, 20, 100] {
            let c = arc(2, 1.0)[1];
            let v: Views = (0..n).map(|_| observe(camera(&c, &Vector3::zeros()), &body, noise, &mut rng)).collect();
            show(&format!("DEG identical {n} {noise}"), &v);
            for far in [1.0, 10.0, 100.0] {
                let v: Views = (0..n)
                    .map(|k| {
                        let t = Vector3::new((k % 5) as f64 - 2.0, (k % 7) as f64 - 3.0, (k % 3) as f64);
                        observe(camera(&(c * far), &(t * 10.0)), &body, noise, &mut rng)
                    })
                    .collect();
                show(&format!("DEG rotation {n} {noise} {far}"), &v);
                let s = Vector3::new(1.0, 2.0, 3.0) * 100.0 * far;
                let b = Ellipsoid { center: body.center + s, ..body };
                let v: Views = (0..n)
                    .map(|k| {
                        let t = Vector3::new((k % 5) as f64 - 2.0, (k % 7) as f64 - 3.0, (k % 3) as f64);
                        observe(camera(&(c + s), &(t * 10.0 + s)), &b, noise, &mut rng)
                    })
                    .collect();
                show(&format!("DEG rotation shifted {n} {noise} {far}"), &v);
            }
            let a = arc(2, 0.5);
            let v: Views =
                (0..n).map(|k| observe(camera(&a[k % 2], &Vector3::zeros()), &body, noise, &mut rng)).collect();
            show(&format!("DEG two {n} {noise}"), &v);
        }
    }
}

#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]
use quadlift::geometry::*;
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::solve::*;
use quadlift::synthetic::*;
use quadlift::*;
fn run(name: &str, make: impl Fn(u64) -> SyntheticOptions, options: &Options) {
    let t0 = std::time::Instant::now();
    let (mut sum, mut n, mut fails, mut enc) = (0.0, 0.0, 0, 0.0);
    let mut noise = vec![];
    let mut solve = 0.0;
    let mut rej = (0, 0, 0);
    for seed in 0..6 {
        let s = generate(&make(seed)).unwrap();
        let t = std::time::Instant::now();
        let r = localize(&s.scene, options, &|_, _| {}).unwrap();
        solve += t.elapsed().as_secs_f64();
        for (i, (e, (_, truth))) in r.estimates.iter().zip(&s.truth).enumerate() {
            n += 1.0;
            match &e.body {
                Some(Body::Ellipsoid(b)) => {
                    if std::env::var("LOW").is_ok() {
                        let v = iou3d_ellipsoids(b, &truth.ellipsoid());
                        if v < std::env::var("LOW").unwrap().parse().unwrap() {
                            println!(
                                "  seed {seed} object {i} iou {v:.5} axes {:.3?} truth {:.3?}",
                                b.semi_axes.as_slice(),
                                truth.ellipsoid().semi_axes.as_slice()
                            )
                        }
                    }
                    sum += iou3d_ellipsoids(b, &truth.ellipsoid());
                    enc += iou3d_ellipsoids(&e.enclosing_ellipsoid().unwrap(), &truth.ellipsoid());
                }
                Some(Body::Cuboid(b)) => {
                    if let Body::Cuboid(t) = truth {
                        if std::env::var("LOW").is_ok() {
                            let v = cuboid_iou(b, t);
                            if v < 0.9 {
                                println!(
                                    "  seed {seed} object {i} {v:.3} {:.3?} {:.3?} used {}",
                                    b.half_extents.as_slice(),
                                    t.half_extents.as_slice(),
                                    e.views_used()
                                )
                            }
                        };
                        sum += cuboid_iou(b, t)
                    }
                }
                _ => fails += 1,
            }
            let f = s.frames.len();
            for (k, v) in e.views.iter().enumerate() {
                let o = s.outliers[i * f + k];
                if o && v.inlier {
                    rej.0 += 1
                }
                if !o && !v.inlier {
                    rej.1 += 1
                }
                if o && !v.inlier {
                    rej.2 += 1
                }
            }
        }
        noise = r.noise;
    }
    println!(
        "{name:22} O3D {:.4} enc {:.4} fail {fails} {:.3} ms/object (total {:.1}s) missed/false/true outliers {rej:?} {noise:.3?}",
        sum / n,
        enc / n,
        solve / n * 1e3,
        t0.elapsed().as_secs_f64()
    );
}
fn cuboid_iou(a: &Cuboid, b: &Cuboid) -> f64 {
    quadlift::metrics::iou3d_cuboids(a, b)
}
fn _old(a: &Cuboid, b: &Cuboid) -> f64 {
    // crude: grid in a
    let n = 24;
    let mut inside = 0;
    for i in 0..n {
        for j in 0..n {
            for k in 0..n {
                let u = |i: i32| -1.0 + 2.0 * (i as f64 + 0.5) / n as f64;
                let p = a.center
                    + a.rotation
                        * nalgebra::Vector3::new(
                            u(i) * a.half_extents.x,
                            u(j) * a.half_extents.y,
                            u(k) * a.half_extents.z,
                        );
                if b.contains(&p) {
                    inside += 1
                }
            }
        }
    }
    let c = inside as f64 / (n as f64).powi(3) * a.volume();
    c / (a.volume() + b.volume() - c)
}
fn main() {
    let d = |seed| SyntheticOptions { seed, ..Default::default() };
    let e = |noise: Noise| move |seed| SyntheticOptions { noise: vec![noise], ..d(seed) };
    let b = |noise: f64| {
        move |seed| SyntheticOptions {
            noise: vec![Noise::BoxEdges(noise)],
            observations: Observations::Boxes,
            ..d(seed)
        }
    };
    let o = Options::default();
    let which = std::env::args().nth(1).unwrap_or_default();
    let on = |n: &str| n.starts_with(&which);
    if on("ellipse") {
        run("ellipse exact", d, &o);
        run("RE 45", e(Noise::Rotation(45.0)), &o);
        run("SE .3", e(Noise::Size(0.3)), &o);
        run("TE .3", e(Noise::Translation(0.3)), &o);
        run("SE2 .3", e(Noise::SizePerAxis(0.3)), &o);
        run("TE2 .3", e(Noise::TranslationFullAxis(0.3)), &o);
    }
    if on("box") {
        run("box exact planes", b(0.0), &Options { method: Method::Planes, ..o.clone() });
        for s in [0.0, 0.02, 0.05, 0.1] {
            run(&format!("box {s}"), b(s), &o);
        }
    }
    if on("outliers") {
        for s in [0.0, 0.1, 0.3, 0.4] {
            run(&format!("outliers {s}"), move |seed| SyntheticOptions { outlier_share: s, ..b(0.02)(seed) }, &o);
        }
    }
    let c = Options { map: MapOptions { body: BodyKind::Cuboid, ..Default::default() }, ..o.clone() };
    if on("cuboid") {
        for s in [0.0, 0.05] {
            run(&format!("cuboid {s}"), move |seed| SyntheticOptions { body: BodyKind::Cuboid, ..b(s)(seed) }, &c);
        }
    }
}

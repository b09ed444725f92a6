use quadlift::geometry::BodyKind;
use quadlift::metrics::{iou3d_bodies, squared_errors};
use quadlift::solve::{PosteriorOptions, NoiseModel};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};
use quadlift::{LocalizeOptions, localize};

fn options(sigma: f64, seed: u64) -> SyntheticOptions {
    SyntheticOptions { observations: Observations::Boxes, noise: vec![Noise::BoxEdges(sigma)], seed, ..Default::default() }
}

#[test]
fn dbg_cuboids() {
    for seed in 0..4 {
        let made = generate(&SyntheticOptions { body: BodyKind::Cuboid, ..options(0.0, seed) }).unwrap();
        let o = PosteriorOptions { body: Some(BodyKind::Cuboid), ..Default::default() };
        let found = localize(&made.scene, &o.into()).unwrap();
        println!("seed {seed} noise {:?} objects {}", found.noise.get("edge_noise"), found.estimates.len());
        for (e, (name, t)) in found.estimates.iter().zip(&made.truth) {
            let iou = iou3d_bodies(&e.body.unwrap(), t);
            if iou < 0.99 { println!("  {name} {iou:.3} {:?} gof {:?} views {}/{} half {:?} true {:?}", e.status, e.goodness_of_fit, e.views_used(), e.views.len(), e.body.unwrap().half_extents, t.half_extents); }
        }
    }
}

#[test]
fn dbg_arc() {
    for (sigma, span) in [(0.02, 10.0), (0.05, 60.0), (0.1, 60.0), (0.02, 25.0)] {
        let (mut inside, mut all, mut nees) = (0, 0, vec![]);
        for seed in 0..3 {
            let made = generate(&SyntheticOptions { objects: 120, trajectory: Trajectory::Arc { span }, ..options(sigma, seed) }).unwrap();
            let found = localize(&made.scene, &LocalizeOptions::default()).unwrap();
            for (e, (_, t)) in found.estimates.iter().zip(&made.truth) {
                let s = squared_errors(&e.body.unwrap(), &e.covariance.unwrap(), t).unwrap();
                all += 1; inside += usize::from(s.center < 7.815); nees.push(s.center);
            }
            println!("{sigma} {span} noise {:?} {:?} {:?} {:?}", found.noise.get("edge_noise"), found.noise.get("direction_error"), found.noise.get("drift_error"), found.noise.get("edge_correlation"));
        }
        nees.sort_by(f64::total_cmp);
        println!("{sigma} {span}: inside {:.3} median of centers {:.2} (2.37)", inside as f64 / all as f64, nees[nees.len() / 2]);
    }
}

#[test]
fn dbg_given() {
    for seed in 0..4 {
        let o = SyntheticOptions { objects: 12, views: 10, outlier_share: 0.15, ..options(0.05, seed) };
        let scene = generate(&o).unwrap().scene;
        let plain = localize(&scene, &LocalizeOptions::default()).unwrap();
        let again = localize(&scene, &PosteriorOptions { noise_model: Some(plain.noise.clone()), ..Default::default() }.into()).unwrap();
        println!("{:?}", plain.noise.levels().collect::<Vec<_>>());
        for (a, b) in plain.estimates.iter().zip(&again.estimates) { println!("   {:?} {:?} {:?} {:?} {:?} {:?}", a.body.map(|b| b.kind), b.body.map(|b| b.kind), a.rms_residual_px(), b.rms_residual_px(), a.status, b.status); }
    }
}

#[test]
fn dbg_rounded() {
    for seed in 0..2 {
        let made = generate(&SyntheticOptions { objects: 10, body: BodyKind::Rounded(0.5), ..options(0.0, seed) }).unwrap();
        for body in [Some(BodyKind::Rounded(0.65)), None] {
        let o = PosteriorOptions { body, ..Default::default() };
        let found = localize(&made.scene, &o.into()).unwrap();
        println!("rounded seed {seed} noise {:?} {:?} {:?}", found.noise.get("edge_noise"), found.noise.get("cuboid_part"), found.noise.get("cuboid_part_precision"));
        for (e, (name, t)) in found.estimates.iter().zip(&made.truth) {
            if e.body.is_none() { println!("{name} {:?}", e.status); continue; }
            let iou = iou3d_bodies(&e.body.unwrap(), t);
            println!("  {name} {iou:.3} {:?} {:?} res {:?} views {}/{} half {:?} true {:?}", e.status, e.body.unwrap().kind, e.goodness_of_fit.map(|g| g.relative_residual), e.views_used(), e.views.len(), e.body.unwrap().half_extents, t.half_extents);
        }
        }
    }
}

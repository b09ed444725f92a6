//! The plain method beside which ours stands: centers of boxes as images of the centers of objects, P3P in RANSAC.

use std::collections::BTreeSet;

use quadlift::geometry::CamFromWorld;
use quadlift::nalgebra::{Matrix3x4, Matrix6, Rotation3, Vector2, Vector3, Vector6};
use quadlift::relocalize::{LandmarkMap, Query};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::p3p::{Pose, p3p};

/// Draws of three boxes with an object each.
const DRAWS: usize = 2000;

/// A box agrees with an object whose center is projected within this share of its mean half size.
const NEAR: f64 = 0.5;

/// Boxes that must agree with a pose that is given: one more than it is made of.
const FEWEST: usize = 4;

/// Steps of Gauss and Newton at the end.
const STEPS: usize = 10;

/// A box: where its center is, on the plane Z = 1, the radius within which an object agrees, and the objects of its category.
struct Sight {
    center: Vector2<f64>,
    radius: f64,
    objects: Vec<usize>,
}

/// The pose with which the centers of most boxes agree; `None` where fewer than four do.
pub(super) fn locate_by_centers(map: &LandmarkMap, query: &Query, seed: u64) -> Option<CamFromWorld> {
    let k = &query.intrinsics;
    let points: Vec<Vector3<f64>> = map.landmarks().iter().map(|l| l.body.center.coords).collect();
    let of_category = |category: &Option<String>| {
        (0..points.len()).filter(|&object| &map.landmarks()[object].category == category).collect::<Vec<_>>()
    };
    let sights: Vec<Sight> = query
        .boxes
        .iter()
        .map(|b| {
            let center = b.bounding_box.center();
            Sight {
                center: Vector2::new((center.x - k.cx) / k.fx, (center.y - k.cy) / k.fy),
                radius: NEAR * b.bounding_box.mean_half_size() / k.fx,
                objects: of_category(&b.category),
            }
        })
        .filter(|sight| !sight.objects.is_empty())
        .collect();
    if sights.len() < FEWEST {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut best: (Vec<(usize, usize)>, Option<Pose>) = (Vec::new(), None);
    for _ in 0..DRAWS {
        let drawn: [usize; 3] = std::array::from_fn(|_| rng.random_range(0..sights.len()));
        let objects = drawn.map(|sight| sights[sight].objects[rng.random_range(0..sights[sight].objects.len())]);
        if BTreeSet::from(drawn).len() < 3 || BTreeSet::from(objects).len() < 3 {
            continue;
        }
        let directions = drawn.map(|sight| sights[sight].center.push(1.0).normalize());
        for pose in p3p(&directions, &objects.map(|object| points[object])) {
            let pairs = agreeing(&pose, &sights, &points);
            if pairs.len() > best.0.len() {
                best = (pairs, Some(pose));
            }
        }
    }
    let (pairs, Some(pose)) = best else { return None };
    if pairs.len() < FEWEST {
        return None;
    }
    let (rotation, translation) = refined(pose, &pairs, &sights, &points);
    let mut matrix = Matrix3x4::zeros();
    matrix.fixed_columns_mut::<3>(0).copy_from(&rotation);
    matrix.set_column(3, &translation);
    CamFromWorld::new(matrix).ok()
}

/// The sights that agree with a pose, with the nearest object that no other sight has.
fn agreeing(pose: &Pose, sights: &[Sight], points: &[Vector3<f64>]) -> Vec<(usize, usize)> {
    let mut taken = vec![false; points.len()];
    let mut pairs = Vec::new();
    for (index, sight) in sights.iter().enumerate() {
        let apart = |object: usize| {
            let p = pose.0 * points[object] + pose.1;
            if p.z > 0.0 { (p.xy() / p.z - sight.center).norm() } else { f64::INFINITY }
        };
        let free = sight.objects.iter().filter(|&&object| !taken[object]);
        let nearest = free.map(|&object| (apart(object), object)).min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, object)) = nearest.filter(|(apart, _)| *apart < sight.radius) {
            taken[object] = true;
            pairs.push((index, object));
        }
    }
    pairs
}

/// The pose with the least squares of the distances of centers.
fn refined(mut pose: Pose, pairs: &[(usize, usize)], sights: &[Sight], points: &[Vector3<f64>]) -> Pose {
    for _ in 0..STEPS {
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        for &(sight, object) in pairs {
            let p = pose.0 * points[object] + pose.1;
            for axis in 0..2 {
                let residual = p[axis] / p.z - sights[sight].center[axis];
                let mut by_point = Vector3::zeros();
                by_point[axis] = 1.0 / p.z;
                by_point[2] = -p[axis] / (p.z * p.z);
                // The point moves by w x p + s.
                let by_turn = p.cross(&by_point);
                let slope = Vector6::new(by_turn.x, by_turn.y, by_turn.z, by_point.x, by_point.y, by_point.z);
                hessian += slope * slope.transpose();
                gradient += slope * residual;
            }
        }
        let Some(cholesky) = hessian.cholesky() else { break };
        let step = -cholesky.solve(&gradient);
        let turn = Rotation3::new(step.fixed_rows::<3>(0).into_owned());
        pose = (turn.matrix() * pose.0, turn.matrix() * pose.1 + step.fixed_rows::<3>(3));
    }
    pose
}

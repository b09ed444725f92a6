//! Scores of a list of estimated objects against the truth.

use std::collections::HashMap;

use super::axes::{axis_error, center_error, main_axis_angle, rotation_error_modulo_symmetry, sorted_axes_error};
use super::iou_cuboids::iou3d_cuboids;
use super::iou_ellipsoids::iou3d_ellipsoids;
use super::overlap::pair_by_overlap;
use super::reprojection::{box_reprojection_iou, ellipse_reprojection_iou};
use super::scores::{
    EstimatedObject, Evaluation, Mean, MeanScore, ObjectScore, PairedBy, ReprojectionScore, TruthObject,
};
use crate::geometry::{Body, BodyKind, Ellipsoid, Projection};

/// Scores estimates against the truth; where their ids mean nothing to it they are paired by overlap ([`pair_by_overlap`]).
///
/// `projections` are the cameras for the agreement in the images; with none of them that score is absent.
pub fn evaluate(
    estimates: &[EstimatedObject],
    truth: &[TruthObject],
    projections: &[Projection],
    paired_by: PairedBy,
) -> Evaluation {
    let mut partners = vec![None; truth.len()];
    match paired_by {
        PairedBy::Ids => {
            let mut by_id = HashMap::new();
            for (index, estimate) in estimates.iter().enumerate() {
                by_id.entry(estimate.id.as_str()).or_insert(index);
            }
            partners = truth.iter().map(|object| by_id.get(object.id.as_str()).copied()).collect();
        }
        PairedBy::Overlap => {
            let closest = |estimate: &EstimatedObject| estimate.body.as_ref().map(Body::closest_ellipsoid);
            let found: Vec<Option<Ellipsoid>> = estimates.iter().map(closest).collect();
            let bodies: Vec<Option<Ellipsoid>> = truth.iter().map(TruthObject::ellipsoid).collect();
            for pair in pair_by_overlap(&found, &bodies, 0.0) {
                partners[pair.truth] = Some(pair.found);
            }
        }
    }
    score_pairs(estimates, truth, &partners, paired_by, projections)
}

/// Scores each true object against its partner, the index of an estimate.
fn score_pairs(
    estimates: &[EstimatedObject],
    truth: &[TruthObject],
    partners: &[Option<usize>],
    paired_by: PairedBy,
    projections: &[Projection],
) -> Evaluation {
    let reported = Reported {
        enclosing: estimates.iter().any(|e| e.enclosing.is_some()),
        cuboids: estimates.iter().any(|e| cuboid(e).is_some()),
    };
    let mut matched = vec![false; estimates.len()];
    let mut objects = Vec::with_capacity(truth.len());
    for (true_object, &partner) in truth.iter().zip(partners) {
        if let Some(index) = partner {
            matched[index] = true;
        }
        objects.push(score(partner.map(|i| &estimates[i]), true_object, projections, &reported));
    }
    Evaluation {
        mean: mean_score(&objects),
        failures: objects.iter().filter(|object| !object.has_body).count(),
        paired_by,
        unmatched: estimates.iter().zip(matched).filter(|(_, m)| !m).map(|(e, _)| e.id.clone()).collect(),
        objects,
    }
}

/// What the estimator reports for any object: only where it does is a lack a failure.
struct Reported {
    enclosing: bool,
    cuboids: bool,
}

fn cuboid(estimate: &EstimatedObject) -> Option<Body> {
    estimate.body.filter(|body| body.kind == BodyKind::Cuboid)
}

fn score(
    estimate: Option<&EstimatedObject>,
    truth: &TruthObject,
    projections: &[Projection],
    reported: &Reported,
) -> ObjectScore {
    let nothing = EstimatedObject::default();
    let (id, status) = (estimate.map(|e| e.id.clone()), estimate.map(|e| e.status.clone()));
    let estimate = estimate.unwrap_or(&nothing);
    // Of two cuboids those inscribed in them are compared.
    let cuboids = cuboid(estimate).zip(truth.cuboid);
    let (found, true_ellipsoid) = match cuboids {
        Some((found, truth)) => (Some(found.inscribed()), Some(truth.inscribed())),
        None => (estimate.body.as_ref().map(Body::closest_ellipsoid), truth.ellipsoid()),
    };
    let ellipsoids = found.zip(true_ellipsoid);
    let center = estimate.center.or(estimate.body.map(|body| body.center));
    let nobody = estimate.body.is_none();
    let iou_of_ellipsoids = |found: Option<Ellipsoid>, truth: Option<Ellipsoid>, failed| {
        truth.and_then(|truth| iou_or_zero(found, truth, failed, iou3d_ellipsoids))
    };
    ObjectScore {
        id: truth.id.clone(),
        estimate: id,
        status,
        has_body: !nobody,
        iou3d: iou_of_ellipsoids(found, true_ellipsoid, true),
        iou3d_enclosing: iou_of_ellipsoids(estimate.enclosing, truth.ellipsoid, reported.enclosing && nobody),
        cuboid_iou3d: truth
            .cuboid
            .and_then(|truth| iou_or_zero(cuboid(estimate), truth, reported.cuboids && nobody, iou3d_cuboids)),
        axis_error: ellipsoids.and_then(|(e, t)| axis_error(&e, &t)),
        theta_err: ellipsoids.map(|(e, t)| main_axis_angle(&e, &t)),
        rotation_error: ellipsoids.map(|(e, t)| rotation_error_modulo_symmetry(&e, &t)),
        center_error: center.zip(true_ellipsoid).map(|(c, t)| center_error(&c, &t.center)),
        size_error: ellipsoids.map(|(e, t)| sorted_axes_error(&e, &t).abs().mean()),
        reprojection: ellipsoids.and_then(|pair| reprojection(pair, cuboids, projections)),
    }
}

/// The IoU of an estimated body with the true one; without an estimate 0 where that is a failure, else nothing.
fn iou_or_zero<B>(estimate: Option<B>, truth: B, failed_without: bool, iou: fn(&B, &B) -> f64) -> Option<f64> {
    match estimate {
        Some(body) => Some(iou(&body, &truth)),
        None => failed_without.then_some(0.0),
    }
}

fn reprojection(
    (a, b): (Ellipsoid, Ellipsoid),
    cuboids: Option<(Body, Body)>,
    projections: &[Projection],
) -> Option<ReprojectionScore> {
    let (mut ellipse_iou, mut box_iou, mut frames) = (0.0, 0.0, 0);
    for projection in projections {
        let outlines = ellipse_reprojection_iou(projection, &a, &b);
        let boxes = match &cuboids {
            Some((a, b)) => box_reprojection_iou(projection, a, b),
            None => box_reprojection_iou(projection, &a, &b),
        };
        if let Some((outlines, boxes)) = outlines.zip(boxes) {
            ellipse_iou += outlines;
            box_iou += boxes;
            frames += 1;
        }
    }
    let count = frames as f64;
    (frames > 0).then(|| ReprojectionScore { ellipse_iou: ellipse_iou / count, box_iou: box_iou / count, frames })
}

fn mean_score(objects: &[ObjectScore]) -> MeanScore {
    let mean = |field: fn(&ObjectScore) -> Option<f64>| {
        let (sum, count) = objects.iter().filter_map(field).fold((0.0, 0usize), |(sum, n), x| (sum + x, n + 1));
        (count > 0).then(|| Mean { value: sum / count as f64, count })
    };
    MeanScore {
        iou3d: mean(|o| o.iou3d),
        iou3d_enclosing: mean(|o| o.iou3d_enclosing),
        cuboid_iou3d: mean(|o| o.cuboid_iou3d),
        axis_error: mean(|o| o.axis_error),
        theta_err: mean(|o| o.theta_err),
        rotation_error: mean(|o| o.rotation_error),
        center_error: mean(|o| o.center_error),
        size_error: mean(|o| o.size_error),
        ellipse_reprojection_iou: mean(|o| o.reprojection.map(|r| r.ellipse_iou)),
        box_reprojection_iou: mean(|o| o.reprojection.map(|r| r.box_iou)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};

    fn cuboid(x: f64) -> Body {
        Body {
            kind: BodyKind::Cuboid,
            center: Point3::new(x, 0.0, 10.0),
            half_extents: Vector3::new(3.0, 2.0, 1.0),
            rotation: Rotation3::from_euler_angles(0.1, 0.2, 0.3),
        }
    }

    fn truth(id: &str) -> TruthObject {
        let cuboid = cuboid(0.0);
        TruthObject { id: id.into(), ellipsoid: Some(cuboid.inscribed()), cuboid: Some(cuboid) }
    }

    fn estimate(id: &str, scale: f64) -> EstimatedObject {
        let ellipsoid = cuboid(0.0).inscribed();
        EstimatedObject {
            id: id.into(),
            status: "ok".into(),
            center: Some(ellipsoid.center),
            body: Some(ellipsoid.scaled(scale).into()),
            enclosing: Some(ellipsoid.scaled(2.0 * scale)),
        }
    }

    fn camera() -> Projection {
        Projection::from_matrix(Matrix3x4::identity()).unwrap()
    }

    #[test]
    fn failures_count_as_zero_and_are_reported() {
        let failed = EstimatedObject {
            id: "b".into(),
            status: "not_an_ellipsoid".into(),
            center: Some(Point3::new(3.0, 4.0, 10.0)),
            ..Default::default()
        };
        let estimates = [failed, estimate("a", 0.5), estimate("stranger", 1.0)];
        let result = evaluate(&estimates, &[truth("a"), truth("b"), truth("c")], &[camera()], PairedBy::Ids);
        let [a, b, c] = result.objects.as_slice() else { unreachable!() };
        assert!((a.iou3d.unwrap() - 0.125).abs() < 1e-9 && (a.iou3d_enclosing.unwrap() - 1.0).abs() < 1e-6);
        assert!((a.size_error.unwrap() - 0.5).abs() < 1e-12);
        assert_eq!((a.center_error, a.cuboid_iou3d, a.status.as_deref()), (Some(0.0), None, Some("ok")));
        assert!(a.theta_err.unwrap() < 1e-9 && a.rotation_error.unwrap() < 1e-7);
        let seen = a.reprojection.unwrap();
        assert!(seen.frames == 1 && seen.ellipse_iou > 0.15 && seen.ellipse_iou < 0.35 && seen.box_iou < 0.35);
        assert_eq!((b.iou3d, b.iou3d_enclosing, b.theta_err, b.center_error), (Some(0.0), Some(0.0), None, Some(5.0)));
        assert_eq!(b.status.as_deref(), Some("not_an_ellipsoid"));
        assert_eq!((c.iou3d, c.status.as_deref(), c.center_error, c.reprojection), (Some(0.0), None, None, None));
        assert_eq!(result.unmatched, ["stranger"]);
        assert_eq!((result.failures, result.failure_share()), (2, Some(2.0 / 3.0)));
        let mean = result.mean.iou3d.unwrap();
        assert!(mean.count == 3 && (mean.value - 0.125 / 3.0).abs() < 1e-9);
        assert_eq!(result.mean.center_error, Some(Mean { value: 2.5, count: 2 }));
        assert_eq!(result.mean.theta_err.unwrap().count, 1);
    }

    #[test]
    fn cuboids_are_compared_where_they_are_reported() {
        let with_cuboid = |id: &str| EstimatedObject { body: Some(cuboid(0.0).scaled(0.5)), ..estimate(id, 0.5) };
        let objects = [truth("a"), truth("b"), truth("c")];
        let result = evaluate(&[with_cuboid("a"), estimate("b", 1.0)], &objects, &[], PairedBy::Ids);
        assert!((result.objects[0].cuboid_iou3d.unwrap() - 0.125).abs() < 1e-9);
        // A body of another kind has no cuboid; no body at all is a failure.
        assert_eq!(result.objects[1].cuboid_iou3d, None);
        assert_eq!((result.objects[2].cuboid_iou3d, result.mean.cuboid_iou3d.unwrap().count), (Some(0.0), 2));
        assert_eq!((result.failures, result.objects[0].reprojection), (1, None));
        // A truth of cuboids only: the inscribed ellipsoid stands for it.
        let only_cuboid = TruthObject { ellipsoid: None, ..truth("a") };
        let result = evaluate(&[estimate("a", 0.5)], &[only_cuboid], &[], PairedBy::Ids);
        assert!((result.objects[0].iou3d.unwrap() - 0.125).abs() < 1e-9);
    }

    #[test]
    fn boxes_in_the_images_are_those_of_the_cuboids_where_both_are_cuboids() {
        // A turned cuboid reaches farther than its inscribed ellipsoid.
        let (own, other) = (cuboid(0.4), cuboid(0.0));
        let with_cuboid = EstimatedObject { body: Some(own), ..estimate("a", 1.0) };
        let around = |cuboid: &Body| {
            let pixels: Vec<_> = cuboid.corners().iter().map(|c| camera().project_point(c).unwrap()).collect();
            let reach = |axis: usize, sign: f64| pixels.iter().map(|p| sign * p[axis]).fold(f64::MIN, f64::max);
            [-reach(0, -1.0), -reach(1, -1.0), reach(0, 1.0), reach(1, 1.0)]
        };
        let (a, b) = (around(&own), around(&other));
        let area = |e: [f64; 4]| (e[2] - e[0]) * (e[3] - e[1]);
        let common = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
        let of_cuboids = common / (area(a) + area(b) - common);
        let box_iou = |estimate: EstimatedObject, truth: TruthObject| {
            evaluate(&[estimate], &[truth], &[camera()], PairedBy::Ids).objects[0].reprojection.unwrap().box_iou
        };
        assert!((box_iou(with_cuboid.clone(), truth("a")) - of_cuboids).abs() < 1e-9);
        // One of them has none: the ellipsoids, which are the same here; that of a cuboid is its closest one, which is larger.
        assert!((box_iou(estimate("a", 1.0), truth("a")) - 1.0).abs() < 1e-9);
        let closest = EstimatedObject { body: Some(own.closest_ellipsoid().into()), ..with_cuboid.clone() };
        let without = TruthObject { cuboid: None, ..truth("a") };
        let [of_cuboid, of_ellipsoid] = [with_cuboid, closest].map(|estimate| box_iou(estimate, without.clone()));
        assert!(of_cuboid == of_ellipsoid && of_cuboid < 0.8, "{of_cuboid} {of_ellipsoid}");
    }

    #[test]
    fn without_common_ids_bodies_are_paired_by_overlap() {
        let (near, exact, far) = (estimate("1", 0.7), estimate("2", 1.0), estimate("3", 1.0));
        let moved = |object: EstimatedObject, x: f64| {
            let body = object.body.map(|body| Body { center: body.center + Vector3::new(x, 0.0, 0.0), ..body });
            EstimatedObject { center: body.map(|body| body.center), body, ..object }
        };
        let result = evaluate(&[near, exact, moved(far, 30.0)], &[truth("a"), truth("b")], &[], PairedBy::Overlap);
        assert_eq!(result.paired_by, PairedBy::Overlap);
        let paired: Vec<_> = result.objects.iter().map(|o| o.estimate.as_deref().unwrap()).collect();
        assert!(paired == ["1", "2"] || paired == ["2", "1"], "{paired:?}");
        assert!((result.mean.iou3d.unwrap().value - 0.5 * (1.0 + 0.343)).abs() < 1e-9);
        assert_eq!((result.unmatched, result.failures), (vec!["3".to_owned()], 0));
        // Nothing overlaps: everything is missing.
        let result = evaluate(&[moved(estimate("1", 1.0), 30.0)], &[truth("a")], &[], PairedBy::Overlap);
        assert_eq!((result.failures, result.objects[0].iou3d), (1, Some(0.0)));
        assert_eq!((&result.objects[0].estimate, &result.objects[0].status), (&None, &None));
    }

    #[test]
    fn empty_lists_and_repeated_ids() {
        let result = evaluate(&[], &[], &[], PairedBy::Ids);
        assert_eq!((result.failure_share(), result.mean.iou3d), (None, None));
        let result = evaluate(&[estimate("a", 1.0), estimate("a", 0.5)], &[truth("a")], &[], PairedBy::Ids);
        assert_eq!(result.unmatched, ["a"]);
        assert!((result.objects[0].iou3d.unwrap() - 1.0).abs() < 1e-6);
        // A truth without any body has nothing to compare with.
        let result = evaluate(
            &[estimate("a", 1.0)],
            &[TruthObject { id: "a".into(), ..Default::default() }],
            &[],
            PairedBy::Ids,
        );
        assert_eq!((result.objects[0].iou3d, result.objects[0].center_error), (None, None));
    }
}

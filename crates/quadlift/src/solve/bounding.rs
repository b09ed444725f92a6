//! The boxes around objects: how far they reach along three axes (docs/method.md, section 13).

use nalgebra::{Matrix3, Rotation3, SVector, Unit, Vector3};

use super::bounds::Bounds;
use super::corrected_support::CorrectedSupport;
use super::estimate::{Covariance, CovarianceCoordinates, Estimate};
use super::refined_pose::RefinedPose;
use super::scene_solution::SceneSolution;
use crate::geometry::{Body, BodyKind, ConvexBody, VECH3};
use crate::parallel::map_indices;
use crate::scene::{ObjectViews, View};

/// A half extent is at least this share of that of the body.
const LEAST_OF_BODY: f64 = 0.05;

/// Share of upright objects in a scene below which boxes are along the bodies' own axes.
const MIN_UPRIGHT_SHARE: f64 = 0.4;

/// The box around an object from its body and the views that show it.
fn bounds_of<'v>(
    body: &Body,
    covariance: Option<&Covariance>,
    views: impl IntoIterator<Item = &'v View>,
    up: Option<&Unit<Vector3<f64>>>,
) -> Bounds {
    let upright = up.filter(|_| !has_faces(body.kind)).map(|up| upright_axes(body, up));
    let axes = upright.unwrap_or_else(|| *body.rotation.matrix());
    let support = CorrectedSupport::new(body, views);
    let mut center = body.center;
    let (mut half_extents, mut process) = (Vector3::zeros(), Vector3::zeros());
    for (k, axis) in axes.column_iter().enumerate() {
        let axis = axis.into_owned();
        let [there, back] = [axis, -axis].map(|direction| support.along(&direction));
        center += axis * (0.5 * (there.distance - back.distance));
        let least = LEAST_OF_BODY * body.support(&axis);
        half_extents[k] = (0.5 * (there.distance + back.distance)).max(least);
        process[k] = 0.25 * (there.sd * there.sd + back.sd * back.sd);
    }
    let of_fit = |covariance: &Covariance| match upright {
        Some(axes) => axes.column_iter().map(|axis| variance_of_support(covariance, body, &axis.into())).collect(),
        None => covariance.half_extents_sd(body).iter().map(|sd| sd * sd).collect::<Vec<f64>>(),
    };
    let half_extents_sd = covariance
        .map(|covariance| (Vector3::from_column_slice(&of_fit(covariance)) + process).map(|x| x.max(0.0).sqrt()))
        .filter(|sd| sd.iter().all(|x| x.is_finite()));
    Bounds { center, rotation: Rotation3::from_matrix_unchecked(axes), half_extents, half_extents_sd }
}

/// Whether a body of this kind has faces, which show its axes.
fn has_faces(kind: BodyKind) -> bool {
    matches!(kind, BodyKind::Cuboid | BodyKind::Cylinder)
}

/// The vertical as third axis; the first one is along that axis of the body which reaches farthest horizontally.
fn upright_axes(body: &Body, up: &Unit<Vector3<f64>>) -> Matrix3<f64> {
    let up = up.into_inner();
    let level = |k: usize| {
        let axis = body.rotation.matrix().column(k).into_owned();
        (axis - up * up.dot(&axis)) * body.half_extents[k]
    };
    let longest = (0..3).map(level).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    // At least two axes of a body are not vertical.
    let first = longest.and_then(|axis| axis.try_normalize(0.0)).unwrap_or_else(Vector3::x);
    Matrix3::from_columns(&[first, up.cross(&first), up])
}

/// Variance of the support of a body about its center along a unit vector.
fn variance_of_support(covariance: &Covariance, body: &Body, direction: &Vector3<f64>) -> f64 {
    let mut slope = SVector::<f64, 9>::zeros();
    match covariance.coordinates {
        CovarianceCoordinates::CenterVechShape => {
            // Of h^2 = n . A n.
            let half = 0.5 / body.support(direction);
            for (entry, &(i, j)) in VECH3.iter().enumerate() {
                slope[3 + entry] = half * direction[i] * direction[j] * if i == j { 1.0 } else { 2.0 };
            }
        }
        CovarianceCoordinates::CenterRotationLogAxes => {
            // Of the point that the plane touches, in the body's frame.
            let inverse = body.rotation.inverse();
            let (point, normal) = (inverse * body.support_point(direction), inverse * direction);
            slope.fixed_rows_mut::<3>(3).copy_from(&point.cross(&normal));
            slope.fixed_rows_mut::<3>(6).copy_from(&point.component_mul(&normal));
        }
    }
    slope.dot(&(covariance.matrix * slope))
}

/// The box around the object of an estimate, whose views are in the order of its reports; `None` without a body.
pub(super) fn bounds_of_estimate(
    estimate: &Estimate,
    views: &[View],
    up: Option<&Unit<Vector3<f64>>>,
) -> Option<Bounds> {
    let used = views.iter().zip(&estimate.views).filter(|(_, report)| report.inlier).map(|(view, _)| view);
    Some(bounds_of(estimate.body.as_ref()?, estimate.covariance.as_ref(), used, up))
}

/// Adds their boxes to the estimates of objects whose views are `views_of`, with the corrected poses.
pub(crate) fn add_bounds(
    solution: &mut SceneSolution,
    views_of: &(dyn Fn(usize) -> ObjectViews + Sync),
    up: Option<&Unit<Vector3<f64>>>,
) {
    let SceneSolution { estimates, refined_poses, noise, .. } = solution;
    let up = up.filter(|_| noise.get("upright_share").is_none_or(|share| share >= MIN_UPRIGHT_SHARE));
    let pose_of = |frame: usize| {
        let place = refined_poses.binary_search_by_key(&frame, |pose| pose.frame_index).ok()?;
        refined_poses.get(place)
    };
    let bounds = map_indices(estimates.len(), |k| {
        let mut views = views_of(k).views;
        for view in &mut views {
            if let Some(RefinedPose { turn, shift, .. }) = pose_of(view.frame_index) {
                view.projection = view.projection.with_moved_camera(turn, shift).unwrap_or(view.projection);
            }
        }
        bounds_of_estimate(&estimates[k], &views, up)
    });
    for (estimate, bounds) in estimates.iter_mut().zip(bounds) {
        estimate.bounds = bounds;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitVector3;

    use super::super::corrected_support::tests::{body, views};
    use super::super::estimate::{Matrix9, Status, ViewReport};
    use super::super::noise_model::NoiseModel;
    use super::*;

    fn vertical() -> UnitVector3<f64> {
        Unit::new_normalize(Vector3::new(0.1, -0.2, 1.0))
    }

    /// A regular covariance of center, rotation and logarithms.
    fn covariance() -> Covariance {
        let root = Matrix9::from_fn(|i, j| if i == j { 0.1 } else { 0.01 * ((3 * i + 5 * j) % 7) as f64 - 0.03 });
        Covariance { coordinates: CovarianceCoordinates::CenterRotationLogAxes, matrix: root * root.transpose() }
    }

    #[test]
    fn bodies_with_faces_keep_their_axes_and_others_stand() {
        for kind in BodyKind::ALL {
            let body = body(kind);
            let views = views(&body, 20, &Rotation3::identity());
            let own = bounds_of(&body, None, &views, None);
            assert!((own.rotation.matrix() - body.rotation.matrix()).amax() < 1e-15);
            // The boxes are those of the body.
            assert!((own.half_extents - body.half_extents).amax() < 1e-9 && (own.center - body.center).norm() < 1e-9);
            let upright = bounds_of(&body, None, &views, Some(&vertical()));
            if has_faces(kind) {
                assert_eq!(upright, own);
                continue;
            }
            let axes = upright.rotation.matrix();
            assert!((axes.column(2) - vertical().into_inner()).amax() < 1e-12);
            assert!((axes.transpose() * axes - Matrix3::identity()).amax() < 1e-12 && axes.determinant() > 0.0);
            // Level, in the plane of the vertical and the longest axis of the body.
            let longest = body.rotation.matrix().column(0).into_owned();
            assert!(axes.column(0).dot(&vertical().cross(&longest)).abs() < 1e-12);
            for k in 0..3 {
                let reach = body.support(&axes.column(k).into());
                assert!((upright.half_extents[k] - reach).abs() < 1e-9, "{kind:?} {k}");
            }
        }
    }

    /// Edges of one side lie farther outside: the box reaches there, and its center moves.
    #[test]
    fn a_box_is_that_of_the_edges() {
        let fitted = body(BodyKind::Cuboid);
        let axis: Vector3<f64> = fitted.rotation.matrix().column(0).into();
        let grown = Body {
            center: fitted.center + axis * 0.03,
            half_extents: fitted.half_extents + Vector3::new(0.03, 0.0, 0.0),
            ..fitted
        };
        let found = bounds_of(&fitted, None, &views(&grown, 30, &Rotation3::identity()), None);
        assert!((found.half_extents[0] - 1.33).abs() < 0.01, "{found:?}");
        assert!(((found.center - fitted.center).dot(&axis) - 0.03).abs() < 0.01, "{found:?}");
        assert!((found.half_extents.yz() - fitted.half_extents.yz()).amax() < 0.01);
        let cuboid = found.cuboid();
        assert_eq!((cuboid.kind, cuboid.half_extents), (BodyKind::Cuboid, found.half_extents));
    }

    #[test]
    fn boxes_never_turn_inside_out() {
        let flat = Body { half_extents: Vector3::new(1.0, 1.0, 0.001), ..body(BodyKind::Cuboid) };
        let smaller = Body { half_extents: Vector3::new(0.9, 0.9, 1e-6), ..flat };
        let found = bounds_of(&flat, None, &views(&smaller, 12, &Rotation3::identity()), None);
        assert!(found.half_extents.iter().all(|x| *x > 0.0), "{found:?}");
    }

    /// Deviations of the body along its own axes, and in other directions those of the support, by differences and in both coordinates.
    #[test]
    fn deviations_are_those_of_the_support_and_of_the_correction() {
        let body = body(BodyKind::Ellipsoid);
        let covariance = covariance();
        let own = bounds_of(&body, Some(&covariance), [], None);
        let of_body = covariance.half_extents_sd(&body);
        let least = 0.01 * body.half_extents.product().cbrt();
        let expected = of_body.map(|sd| (sd * sd + 0.5 * least * least).sqrt());
        assert!((own.half_extents_sd.unwrap() - expected).amax() < 1e-12);
        for kind in [BodyKind::Ellipsoid, BodyKind::Cuboid, BodyKind::Cylinder, BodyKind::Rounded(0.4)] {
            let body = Body { kind, ..body };
            let direction = Vector3::new(0.48, -0.6, 0.64);
            let slope = SVector::<f64, 9>::from_fn(|k, _| {
                let moved = |step: f64| {
                    let mut axis = Vector3::zeros();
                    axis[k % 3] = step;
                    let moved = match k {
                        0..3 => body,
                        3..6 => Body { rotation: body.rotation * Rotation3::new(axis), ..body },
                        _ => Body { half_extents: body.half_extents.component_mul(&axis.map(f64::exp)), ..body },
                    };
                    moved.support(&direction)
                };
                (moved(1e-6) - moved(-1e-6)) / 2e-6
            });
            let expected = slope.dot(&(covariance.matrix * slope));
            let found = variance_of_support(&covariance, &body, &direction);
            assert!((found / expected - 1.0).abs() < 1e-6, "{kind:?}: {found} {expected}");
            if kind == BodyKind::Ellipsoid {
                let matrix = covariance.in_center_vech_shape(&body.inscribed());
                let shape = Covariance { coordinates: CovarianceCoordinates::CenterVechShape, matrix };
                assert!((variance_of_support(&shape, &body, &direction) / found - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn boxes_stand_where_objects_of_the_scene_do() {
        let body = body(BodyKind::Ellipsoid);
        let views_of = |_| ObjectViews { views: views(&body, 20, &Rotation3::identity()), ..ObjectViews::default() };
        let tilt = |levels: &[(&str, f64)]| {
            let reports = (0..20).map(ViewReport::without_body).collect();
            let estimate = Estimate { body: Some(body), views: reports, ..Estimate::failed(0, None, Status::Ok) };
            let noise = NoiseModel::new(levels.iter().copied()).unwrap();
            let mut solution = SceneSolution { estimates: vec![estimate], noise, ..SceneSolution::default() };
            add_bounds(&mut solution, &views_of, Some(&vertical()));
            let rotation = solution.estimates[0].bounds.unwrap().rotation;
            rotation.matrix().column(2).angle(&vertical().into_inner())
        };
        let own = body.rotation.matrix().column(2).angle(&vertical().into_inner());
        assert!(own > 0.1 && (tilt(&[("upright_share", 0.1)]) - own).abs() < 1e-12);
        assert!(tilt(&[("upright_share", 0.7)]) < 1e-6 && tilt(&[]) < 1e-6);
    }

    /// Rejected views do not count, and poses are those that were corrected.
    #[test]
    fn the_views_are_those_that_were_used_from_where_they_were_taken() {
        let body = body(BodyKind::Ellipsoid);
        let seen = views(&body, 20, &Rotation3::identity());
        let report = |k: usize| ViewReport { inlier: k != 3, ..ViewReport::without_body(k) };
        let estimate = Estimate {
            body: Some(body),
            views: (0..20).map(report).collect(),
            ..Estimate::failed(0, None, Status::Ok)
        };
        // One camera was elsewhere, as its correction says, and the box of another is wrong.
        let (turn, shift) = (Rotation3::new(Vector3::new(0.001, -0.0005, 0.001)), Vector3::new(0.03, 0.01, -0.02));
        let mut given = seen.clone();
        given[5].projection = given[5].projection.with_moved_camera(&turn.inverse(), &-shift).unwrap();
        given[3].bounding_box = given[4].bounding_box;
        let refined = vec![RefinedPose { frame_index: 5, turn, shift, covariance: None }];
        let with = |refined_poses: Vec<RefinedPose>| {
            let estimates = vec![estimate.clone(), Estimate::failed(1, None, Status::Degenerate)];
            let mut solution = SceneSolution { estimates, refined_poses, ..SceneSolution::default() };
            let views_of = |k: usize| ObjectViews { object_index: k, category_index: None, views: given.clone() };
            add_bounds(&mut solution, &views_of, None);
            assert_eq!(solution.estimates[1].bounds, None);
            solution.estimates[0].bounds.unwrap().half_extents - body.half_extents
        };
        assert!(with(refined).amax() < 1e-9);
        assert!(with(Vec::new()).amax() > 1e-5);
    }
}

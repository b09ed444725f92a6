//! From estimates to the objects of a scene file.

use quadlift::Localization;
use quadlift::cross_validation::{Extent, ObjectCrossValidation};
use quadlift::geometry::{Body, quaternion_from_rotation};
use quadlift::scene::Scene;
use quadlift::solve::{Alternative, Bounds, Estimate};
use serde_json::Map;

use super::bodies::coordinates_name;
use super::object_records::{
    AlternativeRecord, BoundsRecord, CovarianceRecord, CrossValidationRecord, GoodnessOfFitRecord, ObjectRecord,
    ViewRecord,
};
use crate::numbers::significant;

/// Significant digits of residuals and standard deviations.
const FIGURE_DIGITS: i32 = 6;

/// Significant digits of covariances. A correlation matrix keeps its eigenvalues but for `9 * 5e-9`.
const COVARIANCE_DIGITS: i32 = 9;

/// Level of detail of a result per object.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Detail {
    /// All that is known.
    #[default]
    Full,
    /// Without covariance, the figures of each view and alternatives: about a third of the size.
    Compact,
}

impl From<bool> for Detail {
    /// `true` is compact.
    fn from(compact: bool) -> Self {
        if compact { Self::Compact } else { Self::Full }
    }
}

impl Detail {
    /// Removes the parts of an object that are not requested.
    pub fn apply(self, object: &mut ObjectRecord) {
        if self == Self::Compact {
            object.covariance = None;
            object.view_residuals_px = Vec::new();
            object.alternatives = Vec::new();
        }
    }
}

/// The estimates of a localization of `scene` as the objects of a file, in their order, each made when it is asked for: a
/// record takes a few kilobytes.
///
/// Non-finite values are omitted, because JSON cannot represent them. Residuals and standard deviations have 6
/// significant digits, covariances 9, bodies all.
pub fn estimates_to_objects<'a>(
    scene: &'a Scene,
    localization: &'a Localization,
) -> impl Iterator<Item = ObjectRecord> + 'a {
    let checked = &localization.cross_validation;
    let of_object = |index| checked.of_estimate(index).filter(|_| checked.extent == Extent::All);
    let objects = localization.estimates.iter().enumerate();
    objects.map(move |(index, estimate)| object(scene, estimate, of_object(index)))
}

/// The cross-validation of an object; `None` if no view was predicted.
pub fn cross_validation_of_object(scene: &Scene, checked: &ObjectCrossValidation) -> Option<CrossValidationRecord> {
    let frame = |index: usize| scene.frames.get(index).map(|frame| frame.id.clone());
    Some(CrossValidationRecord {
        iou: checked.iou()?,
        views: checked.predictions.len(),
        edge_error: checked.edge_error().filter(|x| x.is_finite()),
        suspect_view: checked.suspect_view().and_then(|odd| frame(odd.frame_index)),
        ..Default::default()
    })
}

fn object(scene: &Scene, estimate: &Estimate, checked: Option<&ObjectCrossValidation>) -> ObjectRecord {
    let frame_id = |index: usize| scene.frames.get(index).map(|frame| frame.id.clone()).unwrap_or_default();
    let finite = |x: &f64| x.is_finite();
    let figure = |x: f64| significant(x, FIGURE_DIGITS);
    ObjectRecord {
        id: scene.object_ids.get(estimate.object_index).cloned().unwrap_or_default(),
        category: estimate.category_index.and_then(|index| scene.categories.get(index).cloned()),
        status: Some(estimate.status.name().to_owned()),
        center: estimate.center.map(|center| center.coords.into()).filter(|c: &[f64; 3]| c.iter().all(finite)),
        center_sd: estimate.center_sd().filter(finite).map(figure),
        body: estimate.body.as_ref().map(|body| Box::new(body.into())),
        half_extents_sd: estimate.half_extents_sd().filter(|sd| sd.iter().all(finite)).map(|sd| sd.map(figure).into()),
        rotation_sd_deg: estimate
            .rotation_sd(scene.up.as_ref())
            .filter(|sd| sd.iter().all(finite))
            .map(|sd| sd.map(|x| figure(x.to_degrees()))),
        bounds: estimate.bounds.as_ref().map(|found| Box::new(bounds(found))),
        enclosing: estimate.enclosing.map(|body| Box::new((&Body::from(body)).into())),
        views_used: Some(estimate.views_used()),
        views_rejected: estimate
            .views
            .iter()
            .filter(|v| v.rejection_reason.is_some())
            .map(|v| frame_id(v.frame_index))
            .collect(),
        residual_px: estimate.rms_residual_px().filter(finite).map(figure),
        alternatives: estimate.alternatives.iter().filter_map(alternative).collect(),
        goodness_of_fit: estimate
            .goodness_of_fit
            .filter(|m| finite(&m.normalized_residual) && finite(&m.relative_residual))
            .map(|m| GoodnessOfFitRecord {
                normalized_residual: figure(m.normalized_residual),
                relative_residual: figure(m.relative_residual),
                ..Default::default()
            }),
        view_residuals_px: estimate
            .views
            .iter()
            .map(|view| ViewRecord {
                frame: frame_id(view.frame_index),
                residual_px: view.residual_px.filter(finite).map(figure),
                normalized_residual: view.normalized_residual.filter(finite).map(figure),
                inlier: view.inlier,
                predicted_iou: checked.and_then(|c| Some(figure(c.of_frame(view.frame_index)?.iou))),
                rejection_reason: view.rejection_reason.map(|reason| reason.name().to_owned()),
                ..Default::default()
            })
            .collect(),
        cross_validation: checked.and_then(|c| cross_validation_of_object(scene, c)).map(Box::new),
        warnings: estimate.warnings.iter().map(ToString::to_string).collect(),
        covariance: estimate.covariance.as_ref().filter(|c| c.matrix.iter().all(finite)).map(|c| {
            Box::new(CovarianceRecord {
                coordinates: coordinates_name(c.coordinates).to_owned(),
                matrix: std::array::from_fn(|i| {
                    std::array::from_fn(|j| significant(c.matrix[(i, j)], COVARIANCE_DIGITS))
                }),
                ..Default::default()
            })
        }),
        ..Default::default()
    }
}

fn bounds(found: &Bounds) -> BoundsRecord {
    BoundsRecord {
        center: found.center.coords.into(),
        rotation: quaternion_from_rotation(&found.rotation),
        half_extents: found.half_extents.into(),
        half_extents_sd: found.half_extents_sd.map(|sd| sd.map(|x| significant(x, FIGURE_DIGITS)).into()),
        ..Default::default()
    }
}

fn alternative(other: &Alternative) -> Option<AlternativeRecord> {
    let Alternative { body, log_odds } = other;
    log_odds.is_finite().then(|| AlternativeRecord { body: Some(body.into()), log_odds: *log_odds, extra: Map::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::SceneFile;
    use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
    use quadlift::geometry::{BodyKind, Ellipsoid, Projection};
    use quadlift::scene::{NewDetection, SceneBuilder};
    use quadlift::solve::{
        Covariance, CovarianceCoordinates, Matrix9, Rejection, SceneSolution, Status, ViewReport, Warning,
    };

    fn scene() -> Scene {
        let mut builder = SceneBuilder::new("test");
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        let unit_box = quadlift::geometry::BoundingBox::new([0.0, 0.0, 1.0, 1.0]).unwrap();
        for frame in ["f0", "f1"] {
            builder.add_frame(frame, projection, None).unwrap();
            for object in ["cup", "box", "tin", "can"] {
                let input = NewDetection {
                    frame,
                    object: Some(object),
                    category: Some("thing"),
                    bounding_box: Some(unit_box),
                    ..Default::default()
                };
                builder.add_detection(&input).unwrap();
            }
        }
        builder.build()
    }

    fn estimate(object_index: usize, body: Body) -> Estimate {
        let mut matrix = Matrix9::identity() * 0.01;
        matrix[(3, 4)] = 0.002;
        matrix[(4, 3)] = 0.002;
        Estimate {
            center: Some(Point3::new(1.0, 2.0, 3.0)),
            body: Some(body),
            enclosing: Some(Ellipsoid { semi_axes: body.half_extents * 1.25, ..body.inscribed() }),
            bounds: Some(Bounds {
                center: Point3::new(1.5, 2.0, 3.0),
                rotation: Rotation3::from_euler_angles(0.0, 0.0, 0.3),
                half_extents: body.half_extents * 1.1,
                half_extents_sd: Some(Vector3::new(0.03, 0.02, 0.01)),
            }),
            covariance: Some(Covariance { coordinates: CovarianceCoordinates::CenterVechShape, matrix }),
            views: vec![
                ViewReport { residual_px: Some(1.5), ..ViewReport::without_body(0) },
                ViewReport {
                    residual_px: Some(f64::NAN),
                    inlier: false,
                    rejection_reason: Some(Rejection::Residual),
                    ..ViewReport::without_body(1)
                },
            ],
            warnings: vec![Warning::TwoViews],
            alternatives: vec![Alternative { body, log_odds: -0.5 }],
            ..Estimate::failed(object_index, Some(0), Status::Ok)
        }
    }

    fn close(a: &Ellipsoid, b: &Ellipsoid) -> bool {
        (a.center - b.center).norm() < 1e-12 && (a.shape() - b.shape()).amax() < 1e-12
    }

    #[test]
    fn estimates_survive_the_file() {
        let (center, lengths) = (Point3::new(1.0, 2.0, 3.0), Vector3::new(0.5, 0.25, 0.125));
        let rotation = Rotation3::from_euler_angles(0.1, -2.0, 3.0);
        let bodies = [
            Body::from(Ellipsoid { center, semi_axes: lengths, rotation }),
            Body { kind: BodyKind::Cuboid, center, half_extents: lengths, rotation },
            Body { kind: BodyKind::Superellipsoid(1.5), center, half_extents: lengths, rotation },
            Body { center, half_extents: lengths, rotation, kind: BodyKind::Cylinder },
        ];
        let estimates: Vec<_> = bodies.into_iter().enumerate().map(|(i, body)| estimate(i, body)).collect();
        let localization = Localization {
            solution: SceneSolution { estimates: estimates.clone(), ..Default::default() },
            ..Default::default()
        };
        let objects = estimates_to_objects(&scene(), &localization).collect::<Vec<_>>();
        let file = SceneFile::default().with_results(objects, serde_json::json!({"method": "posterior"}));
        let mut bytes = Vec::new();
        crate::scene_file::write_scene(&file, &mut bytes).unwrap();
        let back = crate::scene_file::parse_scene_file("a.json".as_ref(), &bytes).unwrap();
        assert_eq!(back, file);
        let objects = back.to_objects().unwrap();
        assert_eq!(objects.iter().map(|o| o.id.as_str()).collect::<Vec<_>>(), ["cup", "box", "tin", "can"]);
        for (object, estimate) in objects.iter().zip(&estimates) {
            assert_eq!(object.category.as_deref(), Some("thing"));
            assert_eq!(object.status, Some(Status::Ok));
            assert_eq!(object.center, estimate.center);
            assert_eq!(object.covariance, estimate.covariance);
            assert!(close(&object.body().unwrap().closest_ellipsoid(), &estimate.closest_ellipsoid().unwrap()));
            assert!(close(&object.enclosing.unwrap().inscribed(), &estimate.enclosing.unwrap()));
            let (found, expected) = (object.bounds.unwrap(), estimate.bounds.unwrap().cuboid());
            assert!(close(&found.inscribed(), &expected.inscribed()) && found.kind == BodyKind::Cuboid);
        }
        for (object, record) in objects.iter().zip(&back.objects) {
            assert_eq!(record.to_alternatives("").unwrap(), [(object.body().unwrap(), -0.5)]);
        }
        for (object, estimate) in objects.iter().zip(&estimates).skip(1) {
            let body = object.body().unwrap();
            assert_eq!((Some(body.kind), body.half_extents), (estimate.body.map(|body| body.kind), lengths));
        }
        assert_eq!(objects[1].cuboid().unwrap().half_extents, lengths);
        assert!(objects[0].cuboid().is_none() && objects.iter().all(|object| object.bodies.len() == 1));
        let record = &back.objects[0];
        assert_eq!(record.bounds.as_ref().unwrap().half_extents_sd, Some([0.03, 0.02, 0.01]));
        assert_eq!((record.views_used, record.residual_px), (Some(1), Some(1.5)));
        assert_eq!(record.views_rejected, ["f1"]);
        assert_eq!(record.view_residuals_px[1].residual_px, None);
        assert_eq!(record.view_residuals_px[1].rejection_reason.as_deref(), Some("residual"));
        assert_eq!(record.warnings, ["only two views: the shape rests on the prior"]);
        assert!((record.center_sd.unwrap() - 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_failed_estimate_has_its_status_and_its_center() {
        let mut failed = Estimate::failed(1, None, Status::NotAnEllipsoid);
        failed.center = Some(Point3::new(0.0, 1.0, 2.0));
        let objects = estimates_to_objects(
            &scene(),
            &Localization {
                solution: SceneSolution { estimates: vec![failed], ..Default::default() },
                ..Default::default()
            },
        )
        .collect::<Vec<_>>();
        insta::assert_snapshot!(
            serde_json::to_string(&objects[0]).unwrap(),
            @r#"{"id":"box","status":"not_an_ellipsoid","center":[0.0,1.0,2.0],"views_used":0}"#
        );
    }
}

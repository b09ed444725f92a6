//! Objects from the tangent lines of masks, and from ellipses of which some are of parts.

use nalgebra::{Rotation2, Vector2};
use quadlift::geometry::{BodyKind, Ellipse, OrientedBox, OutlineEnd, TangentLines};
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::scene::Scene;
use quadlift::solve::{Method, RegOptions};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, generate};
use quadlift::{LocalizeError, LocalizeOptions, MeasurementKind, localize};

fn synthetic(observations: Observations, noise: Vec<Noise>) -> SyntheticScene {
    generate(&SyntheticOptions { objects: 20, views: 8, observations, noise, ..Default::default() }).unwrap()
}

/// The tangent lines of an ellipse, of which nothing right of `x` pixels is seen.
fn lines(ellipse: &Ellipse, x: f64) -> Option<Box<TangentLines>> {
    let outline = (0..3600).map(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 3600.0).sin_cos();
        let offset = Vector2::new(ellipse.semi_axes().x * cos, ellipse.semi_axes().y * sin);
        let point = ellipse.center() + Rotation2::new(ellipse.angle()) * offset;
        (Vector2::new(point.x.min(x), point.y), OutlineEnd { cut_off: point.x > x - 1.0, hidden: false })
    });
    TangentLines::of_outline(&outline.collect::<Vec<_>>()).map(Box::new)
}

fn mean_iou(synthetic: &SyntheticScene, scene: &Scene, options: &LocalizeOptions) -> f64 {
    let estimates = localize(scene, options).unwrap().solution.estimates;
    let iou = |k: usize| {
        let body = estimates[k].body.as_ref()?.closest_ellipsoid();
        Some(iou3d_ellipsoids(&body, &synthetic.truth[estimates[k].object_index].1.closest_ellipsoid()))
    };
    (0..estimates.len()).map(|k| iou(k).unwrap_or(0.0)).sum::<f64>() / estimates.len() as f64
}

fn with_masks(method: Method) -> LocalizeOptions {
    let mut options = LocalizeOptions { method, measurements: MeasurementKind::Mask, ..Default::default() };
    if let Some(map) = options.method.posterior_options_mut() {
        map.body = Some(BodyKind::Ellipsoid);
    }
    options
}

#[test]
fn exact_masks_give_exact_bodies() {
    let synthetic = synthetic(Observations::Ellipses, Vec::new());
    let mut scene = synthetic.scene.clone();
    scene
        .edit(|parts| {
            for detection in &mut parts.detections {
                detection.tangent_lines = lines(&detection.ellipse.unwrap(), f64::INFINITY);
            }
        })
        .unwrap();
    for method in [Method::default(), Method::Planes] {
        let iou = mean_iou(&synthetic, &scene, &with_masks(method.clone()));
        assert!(iou > 0.999, "{method:?} {iou}");
    }
    // Without masks nothing takes part.
    let estimates = localize(&synthetic.scene, &with_masks(Method::default())).unwrap().solution.estimates;
    assert!(estimates.iter().all(|estimate| estimate.body.is_none()));
}

#[test]
fn exact_oriented_boxes_give_exact_bodies() {
    let synthetic = synthetic(Observations::Ellipses, Vec::new());
    let mut scene = synthetic.scene.clone();
    scene
        .edit(|parts| {
            for (index, detection) in parts.detections.iter_mut().enumerate() {
                let ellipse = detection.ellipse.take().unwrap();
                // The rectangle around the ellipse in another direction in each view.
                let angle = 0.4 * index as f64;
                let half = |turn: f64| {
                    let normal = Vector2::new(turn.cos(), turn.sin());
                    let [.., offset] = ellipse.tangent_line(&normal);
                    -offset - normal.dot(&ellipse.center())
                };
                let size = Vector2::new(half(angle), half(angle + std::f64::consts::FRAC_PI_2)) * 2.0;
                let turned = OrientedBox::new(ellipse.center(), size, angle).unwrap();
                detection.bounding_box = turned.bounding_box();
                detection.tangent_lines = Some(Box::new(TangentLines::of_oriented_box(&turned, None, 0.0)));
            }
        })
        .unwrap();
    for method in [Method::default(), Method::Planes] {
        // Without a choice, oriented boxes come before boxes.
        let mut options = with_masks(method.clone());
        options.measurements = MeasurementKind::Auto;
        let iou = mean_iou(&synthetic, &scene, &options);
        assert!(iou > 0.999, "{method:?} {iou}");
        options.measurements = MeasurementKind::Box;
        let loose = mean_iou(&synthetic, &scene, &options);
        assert!(loose < 0.9, "boxes around the corners are too large: {loose}");
    }
}

#[test]
fn what_the_border_cuts_off_or_another_object_hides_tells_only_that_the_object_reaches_so_far() {
    let synthetic = synthetic(Observations::Ellipses, Vec::new());
    let mut scene = synthetic.scene.clone();
    // Half of the masks lose what lies right of a place inside of them.
    scene
        .edit(|parts| {
            for (index, detection) in parts.detections.iter_mut().enumerate() {
                let ellipse = detection.ellipse.unwrap();
                let x =
                    if index % 2 == 0 { ellipse.center().x + 0.3 * ellipse.semi_axes().min() } else { f64::INFINITY };
                detection.tangent_lines = lines(&ellipse, x);
            }
        })
        .unwrap();
    for method in [Method::default(), Method::Planes] {
        let told = mean_iou(&synthetic, &scene, &with_masks(method.clone()));
        assert!(told > 0.98, "{method:?} {told}");
    }
    let mut hidden = scene.clone();
    let swapped = |end: OutlineEnd| OutlineEnd { cut_off: end.hidden, hidden: end.cut_off };
    hidden
        .edit(|parts| {
            for lines in parts.detections.iter_mut().filter_map(|d| d.tangent_lines.as_mut()) {
                **lines = lines.with_ends(|line| swapped(line.end));
            }
        })
        .unwrap();
    for method in [Method::default(), Method::Planes] {
        let told = mean_iou(&synthetic, &hidden, &with_masks(method.clone()));
        assert!(told > 0.98, "{method:?} {told}");
    }
    scene
        .edit(|parts| {
            for lines in parts.detections.iter_mut().filter_map(|d| d.tangent_lines.as_mut()) {
                **lines = lines.with_ends(|_| OutlineEnd::default());
            }
        })
        .unwrap();
    let not_told = mean_iou(&synthetic, &scene, &with_masks(Method::Planes));
    assert!(not_told < 0.9, "{not_told}");
}

#[test]
fn ellipses_of_parts_do_less_harm_when_they_are_known_as_such() {
    let synthetic = synthetic(Observations::Ellipses, vec![Noise::Rotation(3.0)]);
    let mut scene = synthetic.scene.clone();
    // Of every fourth object only the left half is seen.
    scene
        .edit(|parts| {
            for detection in parts.detections.iter_mut().step_by(4) {
                let ellipse = detection.ellipse.unwrap();
                let center = ellipse.center() - Vector2::new(0.5 * ellipse.semi_axes().min(), 0.0);
                let semi_axes = ellipse.semi_axes().component_mul(&Vector2::new(1.0, 0.5));
                detection.ellipse = Ellipse::new(center, semi_axes, ellipse.angle()).ok();
            }
        })
        .unwrap();
    let mut options = with_masks(Method::default());
    options.measurements = MeasurementKind::Ellipse;
    options.method.posterior_options_mut().unwrap().robust = false;
    let not_told = mean_iou(&synthetic, &scene, &options);
    scene.edit(|parts| parts.detections.iter_mut().step_by(4).for_each(|detection| detection.partial = true)).unwrap();
    let told = mean_iou(&synthetic, &scene, &options);
    assert!(told > not_told + 0.05, "{told} {not_told}");
}

#[test]
fn closed_forms_of_ellipses_refuse_masks() {
    for method in [Method::Lfd, Method::Pfd, Method::Reg(RegOptions::default())] {
        let result = localize(&Scene::default(), &with_masks(method.clone()));
        assert!(matches!(result, Err(LocalizeError::Option(text)) if text.to_string().contains("mask")));
    }
}

use std::f64::consts::TAU;

use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

use super::*;
use crate::geometry::{
    Body, BodyKind, BoundingBox, CamFromWorld, CameraError, CameraModel, Ellipse, Ellipsoid, Projection,
    project_bounding_box, project_ellipsoid,
};

/// A camera of each model, of 1000 x 800 pixels, with the distortion of a real wide lens.
fn cameras() -> Vec<Camera> {
    let coefficients: [&[f64]; 18] = [
        &[],
        &[],
        &[-0.12],
        &[-0.2, 0.05],
        &[-0.25, 0.07, 0.002, -0.001],
        &[-0.02, 0.01, -0.004, 0.0007],
        &[-0.3, 0.12, 0.001, -0.0015, 0.01, -0.1, 0.05, 0.003],
        &[0.9],
        &[-0.03],
        &[-0.03, 0.004],
        &[-0.02, 0.01, 0.001, -0.002, -0.001, 0.0002, 0.0015, -0.001],
        &[0.1, -0.05, 0.02, -0.01, 0.002, -0.0003, 0.0005, -0.0007, 0.001, -0.0002, 0.0008, 0.0003],
        &[-0.15],
        &[-0.2],
        &[],
        &[],
        &[0.6, 1.1],
        &[],
    ];
    CameraModel::all()
        .zip(coefficients)
        .map(|(model, coefficients)| {
            let mut params = match model {
                CameraModel::Equirectangular => vec![1000.0, 800.0],
                model if model.has_one_focal_length() => vec![610.0, 503.0, 398.0],
                _ => vec![610.0, 600.0, 503.0, 398.0],
            };
            params.extend_from_slice(coefficients);
            Camera::new(model, &params).unwrap()
        })
        .collect()
}

proptest! {
    #[test]
    fn every_model_inverts_itself(x in -0.75..0.75f64, y in -0.6..0.6f64, depth in 0.1..50.0f64) {
        for camera in cameras() {
            let pixel = camera.project_point(&Point3::new(x * depth, y * depth, depth)).unwrap();
            let ideal = camera.undistort_point(&pixel).unwrap();
            let expected = camera.to_pixel(&Vector2::new(x, y));
            prop_assert!((ideal - expected).norm() < 1e-8, "{:?} {ideal} {expected}", camera.model());
            let again = camera.distort_point(&ideal).unwrap();
            prop_assert!((again - pixel).norm() < 1e-9, "{:?}", camera.model());
        }
    }

    #[test]
    fn nothing_panics_and_answers_are_right_or_none(
        k in proptest::collection::vec(-3.0..3.0f64, 12), x in -3000.0..3000.0f64, y in -3000.0..3000.0f64,
    ) {
        for camera in cameras() {
            let mut params = camera.params().to_vec();
            let first = params.len() - camera.coefficients().len();
            params[first..].iter_mut().zip(&k).for_each(|(to, from)| *to = *from);
            let Ok(camera) = Camera::new(camera.model(), &params) else { continue };
            if let Some(ideal) = camera.undistort_point(&Vector2::new(x, y)) {
                let back = camera.distort_point(&ideal).unwrap();
                prop_assert!((back - Vector2::new(x, y)).norm() < 1e-6, "{camera:?} {ideal} {back}");
            }
        }
    }
}

#[test]
fn the_images_of_folding_lenses_end_where_they_fold() {
    // r (1 - 0.5 r^2) turns back at r = sqrt(2 / 3), where it is 0.544.
    let camera = Camera::new(CameraModel::SimpleRadial, &[1000.0, 0.0, 0.0, -0.5]).unwrap();
    assert!((camera.reach - (2.0f64 / 3.0).sqrt()).abs() < 1e-6, "{}", camera.reach);
    let at = |r: f64| camera.undistort_point(&Vector2::new(r * 1000.0, 0.0));
    let r = at(0.54).unwrap().x / 1000.0;
    assert!((r * (1.0 - 0.5 * r * r) - 0.54).abs() < 1e-12 && r < 0.8165, "{r}");
    assert!(at(0.55).is_none() && at(2.0).is_none());
    // 85 degrees from the axis of a fish-eye lens.
    let fisheye = Camera::new(CameraModel::SimpleFisheye, &[100.0, 0.0, 0.0]).unwrap();
    assert!(fisheye.undistort_point(&Vector2::new(0.0, 85f64.to_radians() * 100.0)).is_none());
    assert!(fisheye.undistort_point(&Vector2::new(0.0, 79f64.to_radians() * 100.0)).is_some());
    assert!(fisheye.undistort_point(&Vector2::new(0.0, 300.0)).is_none());
    // Behind the viewer of a panorama.
    let panorama = Camera::new(CameraModel::Equirectangular, &[1000.0, 500.0]).unwrap();
    assert!(panorama.undistort_point(&Vector2::new(50.0, 250.0)).is_none());
    assert_eq!(panorama.undistort_point(&Vector2::new(500.0, 250.0)), Some(Vector2::new(500.0, 250.0)));
}

#[test]
fn bad_parameters_are_refused() {
    let count = Camera::new(CameraModel::OpenCv, &[1.0; 7]).unwrap_err();
    assert_eq!(count.to_string(), "a OPENCV camera has 8 params [fx, fy, cx, cy, k1, k2, p1, p2]; found 7");
    assert!(matches!(
        Camera::new(CameraModel::Pinhole, &[0.0, 1.0, 0.0, 0.0]),
        Err(CameraError::SingularIntrinsics { .. })
    ));
    assert!(matches!(Camera::new(CameraModel::Fov, &[f64::NAN; 5]), Err(CameraError::NotFinite { .. })));
    for (model, last) in [(CameraModel::Eucm, [1.5, 1.0]), (CameraModel::Eucm, [0.5, 0.0])] {
        let params = [1.0, 1.0, 0.0, 0.0, last[0], last[1]];
        assert!(matches!(Camera::new(model, &params), Err(CameraError::Coefficients { .. })));
    }
    assert!(Camera::new(CameraModel::Equirectangular, &[0.0, 100.0]).is_err());
}

#[test]
fn ellipses_and_boxes_of_pinholes_stay_and_affine_maps_are_exact() {
    let e = Ellipse::new(Vector2::new(620.0, 300.0), Vector2::new(80.0, 30.0), 0.4).unwrap();
    let pinhole = Camera::new(CameraModel::Pinhole, &[610.0, 600.0, 503.0, 398.0]).unwrap();
    assert_eq!(pinhole.undistort_ellipse(&e), Some(e));
    assert_eq!(pinhole.undistort_box(&e.bounding_box()), Some(e.bounding_box()));
    // The same camera with a model that goes through the sampled points.
    let radial = Camera::new(CameraModel::OpenCv, &[610.0, 600.0, 503.0, 398.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let back = radial.undistort_ellipse(&e).unwrap();
    assert!((back.center - e.center).norm() < 1e-9 && (back.semi_axes - e.semi_axes).norm() < 1e-9);
    assert!((back.angle - e.angle).abs() < 1e-9);
    for (p, q) in radial.undistort_box(&e.bounding_box()).unwrap().edges().iter().zip(e.bounding_box().edges()) {
        // The extreme points of the upright inscribed ellipse are among the samples.
        assert!((p - q).abs() < 1e-9);
    }
}

/// The box in the distorted image around points in camera coordinates.
fn distorted_box(camera: &Camera, points: impl Iterator<Item = Point3<f64>>) -> Option<BoundingBox> {
    let mut edges = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for point in points {
        let pixel = camera.project_point(&point)?;
        for axis in 0..2 {
            edges[axis] = edges[axis].min(pixel[axis]);
            edges[axis + 2] = edges[axis + 2].max(pixel[axis]);
        }
    }
    BoundingBox::new(edges).ok()
}

/// Points on the rays of an ellipsoid's outline.
fn rays_of_outline(camera: &Camera, outline: &Ellipse) -> impl Iterator<Item = Point3<f64>> {
    let (k, outline) = (camera.pinhole(), *outline);
    (0..720).map(move |i| {
        let p = point_on(&outline, TAU * f64::from(i) / 720.0);
        Point3::new((p.x - k.cx) / k.fx, (p.y - k.cy) / k.fy, 1.0)
    })
}

fn points_on_edges(cuboid: &Body) -> impl Iterator<Item = Point3<f64>> {
    let corners = cuboid.corners();
    let pairs = (0..8).flat_map(|i| (0..8).map(move |j| (i, j)));
    pairs.flat_map(move |(i, j)| (0..=20).map(move |t| corners[i] + (corners[j] - corners[i]) * (f64::from(t) / 20.0)))
}

/// Boxes around random bodies in distorted images, undistorted: how far their edges lie outside of the pinhole camera's
/// boxes, relative to the half sizes; mean, and mean absolute value.
fn box_errors(model: CameraModel, cuboids: bool) -> [f64; 2] {
    let camera = cameras().into_iter().find(|camera| camera.model() == model).unwrap();
    let pose = CamFromWorld::new(nalgebra::Matrix3x4::identity()).unwrap();
    let projection = Projection::from_camera(&camera.pinhole(), &pose);
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let mut errors = Vec::new();
    for _ in 0..400 {
        let depth = uniform(4.0, 12.0);
        let center = Point3::new(depth * uniform(-0.65, 0.65), depth * uniform(-0.5, 0.5), depth);
        let size = Vector3::from_fn(|_, _| uniform(0.3, 0.8));
        let rotation = Rotation3::from_euler_angles(uniform(-3.0, 3.0), uniform(-1.5, 1.5), uniform(-3.0, 3.0));
        let cuboid = Body { kind: BodyKind::Cuboid, center, half_extents: size, rotation };
        let ellipsoid = Ellipsoid { center, semi_axes: size, rotation };
        let (seen, expected) = if cuboids {
            (distorted_box(&camera, points_on_edges(&cuboid)), project_bounding_box(&projection, &cuboid))
        } else {
            let outline = project_ellipsoid(&projection, &ellipsoid).unwrap();
            (distorted_box(&camera, rays_of_outline(&camera, &outline)), project_bounding_box(&projection, &ellipsoid))
        };
        let (found, expected) = (camera.undistort_box(&seen.unwrap()).unwrap(), expected.unwrap());
        for edge in 0..4 {
            let outwards = if edge < 2 { -1.0 } else { 1.0 };
            errors.push(outwards * (found.edges()[edge] - expected.edges()[edge]) * 2.0 / expected.size()[edge % 2]);
        }
    }
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / errors.len() as f64;
    [mean(&mut errors.iter().copied()), mean(&mut errors.iter().map(|e| e.abs()))]
}

/// The box around the undistorted rectangle itself would be 4 to 6 % too large with these lenses.
#[test]
fn boxes_of_bodies_are_those_of_the_pinhole_camera_on_average() {
    for model in [CameraModel::OpenCv, CameraModel::OpenCvFisheye, CameraModel::Eucm, CameraModel::Fov] {
        for (cuboids, spread) in [(false, 0.012), (true, 0.022)] {
            let [mean, mean_absolute] = box_errors(model, cuboids);
            println!("{}, cuboids {cuboids}: {mean:.4}, {mean_absolute:.4}", model.name());
            assert!(mean.abs() < 0.004 && mean_absolute < spread, "{model:?} {cuboids} {mean} {mean_absolute}");
        }
    }
}

/// What a mask in a distorted image gives: the ellipse of the moments of an outline.
#[test]
fn ellipses_of_distorted_outlines_are_those_of_the_pinhole_camera() {
    for camera in cameras() {
        let expected = Ellipse::new(Vector2::new(760.0, 250.0), Vector2::new(70.0, 40.0), 0.5).unwrap();
        let expected = if camera.model() == CameraModel::Equirectangular {
            Ellipse { center: Vector2::new(560.0, 330.0), semi_axes: expected.semi_axes * 0.5, ..expected }
        } else {
            expected
        };
        let outline: Vec<Vector2<f64>> = (0..360).map(|i| point_on(&expected, TAU * f64::from(i) / 360.0)).collect();
        let distorted: Vec<_> = outline.iter().map(|p| camera.distort_point(p).unwrap()).collect();
        let seen = super::measurements::ellipse_of_polygon(&distorted).unwrap();
        let found = camera.undistort_ellipse(&seen).unwrap();
        let size = expected.semi_axes.x;
        assert!((found.center - expected.center).norm() < 0.004 * size, "{camera:?} {found:?}");
        assert!((found.semi_axes - expected.semi_axes).norm() < 0.01 * size, "{camera:?} {found:?}");
        // Undistorted outlines are exact.
        for (p, q) in camera.undistort_outline(&distorted).unwrap().iter().zip(&outline) {
            assert!((p - q).norm() < 1e-8);
        }
    }
}

/// The box of a distorted outline, from many of its points.
#[test]
fn distorted_boxes_surround_the_distorted_outline() {
    for camera in cameras() {
        let pinhole_box = BoundingBox::new([500.0, 260.0, 590.0, 310.0]).unwrap();
        let inscribed = Ellipse::inscribed_in(&pinhole_box);
        let points =
            (0..3600).map(|i| camera.distort_point(&point_on(&inscribed, TAU * f64::from(i) / 3600.0)).unwrap());
        let expected = points.fold([f64::MAX, f64::MAX, f64::MIN, f64::MIN], |[x0, y0, x1, y1], p| {
            [x0.min(p.x), y0.min(p.y), x1.max(p.x), y1.max(p.y)]
        });
        for (found, expected) in camera.distort_box(&pinhole_box).unwrap().edges().iter().zip(expected) {
            assert!((found - expected).abs() < 0.02, "{camera:?} {found} {expected}");
        }
    }
}

fn point_on(e: &Ellipse, t: f64) -> Vector2<f64> {
    let ((sin, cos), (s, c)) = (e.angle.sin_cos(), t.sin_cos());
    e.center
        + Vector2::new(
            e.semi_axes.x * c * cos - e.semi_axes.y * s * sin,
            e.semi_axes.x * c * sin + e.semi_axes.y * s * cos,
        )
}

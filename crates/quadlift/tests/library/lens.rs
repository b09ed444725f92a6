//! Objects from boxes in distorted images: as good as from the images of a pinhole camera.

use nalgebra::{Matrix3x4, Point3, Rotation3, Vector2, Vector3};
use quadlift::geometry::{
    BoundingBox, CamFromWorld, Camera, CameraModel, Ellipse, Ellipsoid, Projection, project_ellipsoid,
};
use quadlift::metrics::iou3d_ellipsoids;
use quadlift::scene::{NewDetection, Scene, SceneBuilder};
use quadlift::{LocalizeOptions, localize};
use rand::{RngExt, SeedableRng};

fn objects() -> Vec<Ellipsoid> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let mut object = || Ellipsoid {
        center: Point3::new(uniform(-2.5, 2.5), uniform(-1.0, 1.0), uniform(-2.5, 2.5)),
        semi_axes: Vector3::new(uniform(0.3, 0.6), uniform(0.2, 0.5), uniform(0.2, 0.4)),
        rotation: Rotation3::from_euler_angles(uniform(-3.0, 3.0), uniform(-1.5, 1.5), uniform(-3.0, 3.0)),
    };
    (0..8).map(|_| object()).collect()
}

/// Cameras on a ring around the objects, at two heights, that look past the middle.
fn poses() -> Vec<CamFromWorld> {
    (0..14)
        .map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / 14.0;
            let height = if i % 2 == 0 { -2.0 } else { 0.5 };
            let center = Vector3::new(4.5 * angle.sin(), height, -4.5 * angle.cos());
            let ahead = (Vector3::new(0.8, 0.0, -0.6) - center).normalize();
            let right = Vector3::y().cross(&ahead).normalize();
            let rotation = nalgebra::Matrix3::from_columns(&[right, ahead.cross(&right), ahead]).transpose();
            let mut pose = Matrix3x4::zeros();
            pose.fixed_columns_mut::<3>(0).copy_from(&rotation);
            pose.set_column(3, &-(rotation * center));
            CamFromWorld::new(pose).unwrap()
        })
        .collect()
}

/// The box around an outline in the distorted image.
fn distorted_box(camera: &Camera, outline: &Ellipse) -> Option<BoundingBox> {
    let mut edges = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for i in 0..720 {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 720.0).sin_cos();
        let turn = nalgebra::Rotation2::new(outline.angle());
        let offset = turn * Vector2::new(outline.semi_axes().x * cos, outline.semi_axes().y * sin);
        let pixel = camera.distort_point(&(outline.center() + offset))?;
        for axis in 0..2 {
            edges[axis] = edges[axis].min(pixel[axis]);
            edges[axis + 2] = edges[axis + 2].max(pixel[axis]);
        }
    }
    BoundingBox::new(edges).ok()
}

/// The boxes that `seen_by` gives, in a scene that takes them for those of `taken_for`.
fn scene(seen_by: &Camera, taken_for: &Camera) -> Scene {
    let mut builder = SceneBuilder::new("lens");
    for (i, pose) in poses().iter().enumerate() {
        let id = i.to_string();
        builder.add_frame_of_camera(&id, taken_for, pose, None).unwrap();
        let projection = Projection::from_camera(&seen_by.pinhole(), pose);
        for (k, object) in objects().iter().enumerate() {
            let Ok(outline) = project_ellipsoid(&projection, object) else { continue };
            let (object, bounding_box) = (k.to_string(), distorted_box(seen_by, &outline));
            builder
                .add_detection(&NewDetection {
                    frame: &id,
                    object: Some(&object),
                    bounding_box: Some(bounding_box.unwrap()),
                    ..NewDetection::default()
                })
                .unwrap();
        }
    }
    builder.build()
}

fn mean_iou(scene: &Scene) -> f64 {
    let result = localize(scene, &LocalizeOptions::default()).unwrap();
    let truth = objects();
    let iou = |(k, truth): (usize, &Ellipsoid)| {
        let index = scene.object_ids.iter().position(|id| *id == k.to_string()).unwrap();
        result.estimates[index].closest_ellipsoid().map_or(0.0, |found| iou3d_ellipsoids(&found, truth))
    };
    truth.iter().enumerate().map(iou).sum::<f64>() / truth.len() as f64
}

#[test]
fn boxes_in_distorted_images_give_the_objects() {
    let pinhole = Camera::new(CameraModel::SimplePinhole, &[500.0, 640.0, 480.0]).unwrap();
    assert!(mean_iou(&scene(&pinhole, &pinhole)) > 0.99);
    let lenses = [
        Camera::new(CameraModel::OpenCvFisheye, &[500.0, 500.0, 640.0, 480.0, -0.02, 0.01, -0.004, 0.0007]).unwrap(),
        Camera::new(CameraModel::OpenCv, &[500.0, 500.0, 640.0, 480.0, -0.25, 0.05, 0.002, -0.001]).unwrap(),
        Camera::new(CameraModel::Division, &[500.0, 500.0, 640.0, 480.0, -0.15]).unwrap(),
    ];
    for lens in lenses {
        let (right, wrong) = (mean_iou(&scene(&lens, &lens)), mean_iou(&scene(&lens, &pinhole)));
        println!("{}: IoU {right:.3}, taken for a pinhole {wrong:.3}", lens.model().name());
        assert!(right > 0.93, "{lens:?}: {right}");
        assert!(wrong < right - 0.1, "{lens:?}: {wrong}, the test sees no distortion");
    }
}

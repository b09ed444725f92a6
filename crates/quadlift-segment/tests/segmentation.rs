//! Objects segmented from crops to ellipses: found where they are, in all the awkward cases, and the same every time.
// Helpers of tests, which clippy does not take for tests.
#![allow(clippy::unwrap_used)]

use std::ops::ControlFlow;

use image::{Rgb, RgbImage};
use nalgebra::Vector2;
use quadlift::geometry::{BoundingBox, Ellipse};
use quadlift::metrics::ellipse_iou;
use quadlift_segment::{
    Crop, CropError, CropOptions, SegmentError, SegmentMethod, SegmentOptions, SegmentStatus, ViewSegmentation,
    segment_object, segment_objects,
};

/// A number in [0, 1) that depends on a place: noise without a generator.
fn noise(x: u32, y: u32, salt: u32) -> f64 {
    let mut h = x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b) ^ salt.wrapping_mul(0xc2b2_ae35);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    f64::from(h ^ (h >> 15)) / 4_294_967_296.0
}

/// An orange ellipse with stripes on a ground of gray and green patches.
fn view(ellipse: &Ellipse, salt: u32) -> RgbImage {
    let inverse = ellipse.shape().try_inverse().unwrap();
    RgbImage::from_fn(320, 240, |x, y| {
        let d = Vector2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - ellipse.center();
        let color = if d.dot(&(inverse * d)) <= 1.0 {
            if x / 4 % 2 == 0 { [210.0, 120.0, 40.0] } else { [180.0, 90.0, 50.0] }
        } else if noise(x / 16, y / 16, 7) < 0.5 {
            [120.0, 120.0, 125.0]
        } else {
            [70.0, 110.0, 80.0]
        };
        Rgb(color.map(|c| (c + 40.0 * (noise(x, y, salt) - 0.5)) as u8))
    })
}

/// Ellipses that turn from view to view.
fn ellipses(count: u32) -> Vec<Ellipse> {
    (0..count)
        .map(|t| {
            let center = Vector2::new(150.0 + 3.0 * f64::from(t), 118.0 - f64::from(t));
            Ellipse::new(center, Vector2::new(62.0, 28.0), 0.5 + 0.15 * f64::from(t)).unwrap()
        })
        .collect()
}

fn crops(ellipses: &[Ellipse]) -> Vec<Crop> {
    let cut =
        |(t, e): (usize, &Ellipse)| Crop::cut(&view(e, t as u32), &e.bounding_box(), &CropOptions::default()).unwrap();
    ellipses.iter().enumerate().map(cut).collect()
}

fn with(method: SegmentMethod) -> SegmentOptions {
    SegmentOptions { method, ..Default::default() }
}

fn is_finite(view: &ViewSegmentation) -> bool {
    let e = &view.ellipse;
    e.center().iter().chain(&e.semi_axes()).all(|x| x.is_finite())
        && e.semi_axes().min() > 0.0
        && e.angle().is_finite()
        && (0.0..=1.0).contains(&view.confidence)
}

#[test]
fn an_object_of_two_colors_is_found() {
    let truth = ellipses(6);
    let crops = crops(&truth);
    for method in SegmentMethod::ALL {
        let views = segment_object(&crops, &with(method)).unwrap();
        for (view, truth) in views.iter().zip(&truth) {
            assert_eq!(view.status, SegmentStatus::Ok);
            let iou = ellipse_iou(&view.ellipse, truth);
            assert!(iou > 0.93, "{method:?}: {iou}");
            // sin of the difference: an angle and its opposite are the same.
            assert!((view.ellipse.angle() - truth.angle()).sin().abs() < 0.05, "{method:?}: {view:?}");
            let area = std::f64::consts::PI * truth.semi_axes().product();
            assert!((view.mask.count() as f64 / area - 1.0).abs() < 0.08, "{method:?}: {}", view.mask.count());
            assert!(view.confidence > 0.6);
        }
    }
}

#[test]
fn one_frame_is_enough_and_none_is_nothing() {
    let truth = ellipses(1);
    for method in SegmentMethod::ALL {
        let views = segment_object(&crops(&truth), &with(method)).unwrap();
        assert!(views.len() == 1 && is_finite(&views[0]), "{method:?}");
        assert_eq!(segment_object(&[], &with(method)), Ok(vec![]));
    }
    let views = segment_object(&crops(&truth), &SegmentOptions::default()).unwrap();
    assert!(ellipse_iou(&views[0].ellipse, &truth[0]) > 0.9);
}

#[test]
fn uniform_images_fall_back_to_the_box() {
    for color in [[0, 0, 0], [255, 255, 255], [90, 140, 30]] {
        let image = RgbImage::from_pixel(100, 80, Rgb(color));
        let bounding_box = BoundingBox::new([20.0, 10.0, 70.0, 60.0]).unwrap();
        let crop = Crop::cut(&image, &bounding_box, &CropOptions::default()).unwrap();
        for method in SegmentMethod::ALL {
            let views = segment_object(&[crop.clone(), crop.clone()], &with(method)).unwrap();
            assert!(views.iter().all(is_finite), "{method:?}: {views:?}");
        }
        // Without colors to go by, the labels are those of the prior: an ellipse in the box, if any.
        let view = &segment_object(std::slice::from_ref(&crop), &SegmentOptions::default()).unwrap()[0];
        assert!(ellipse_iou(&view.ellipse, &Ellipse::inscribed_in(&bounding_box)) > 0.7, "{view:?}");
    }
}

#[test]
fn awkward_boxes_do_not_disturb_the_other_views() {
    let truth = ellipses(4);
    let mut all = crops(&truth);
    let image = view(&truth[0], 9);
    let cut = |edges: [f64; 4]| Crop::cut(&image, &BoundingBox::new(edges).unwrap(), &CropOptions::default());
    assert!(matches!(cut([-50.0, 10.0, -10.0, 40.0]), Err(CropError::OutsideImage { .. })));
    // One pixel, a line of pixels, half out of the image, all of it and much more, and a box with nothing of its own.
    for edges in [
        [100.0, 100.0, 101.0, 101.0],
        [40.0, 50.0, 41.0, 150.0],
        [-60.0, 60.0, 60.0, 200.0],
        [-100.0, -100.0, 420.0, 340.0],
        [319.0, 239.0, 330.0, 250.0],
        [5.0, 5.0, 5.3, 5.2],
    ] {
        all.push(cut(edges).unwrap());
    }
    for method in SegmentMethod::ALL {
        for fall_back in [true, false] {
            let views = segment_object(&all, &SegmentOptions { fall_back, ..with(method) }).unwrap();
            assert_eq!(views.len(), all.len());
            assert!(views.iter().all(is_finite), "{method:?}: {views:?}");
            // Masks lie in the image.
            for view in &views {
                assert!(view.mask.extent().is_none_or(|[_, _, x1, y1]| x1 <= 320 && y1 <= 240));
            }
            for (view, truth) in views.iter().zip(&truth) {
                let iou = ellipse_iou(&view.ellipse, truth);
                assert!(iou > 0.85, "{method:?}: {iou}");
            }
        }
    }
}

#[test]
fn what_lies_outside_of_the_image_is_not_in_the_mask() {
    // The object is cut off by the left border; the detector's box goes on beyond it.
    let ellipse = Ellipse::new(Vector2::new(10.0, 120.0), Vector2::new(60.0, 35.0), 0.0).unwrap();
    let crop = Crop::cut(&view(&ellipse, 1), &ellipse.bounding_box(), &CropOptions::default()).unwrap();
    let found = &segment_object(&[crop], &SegmentOptions { fall_back: false, ..Default::default() }).unwrap()[0];
    // The center of the visible part, not of the whole.
    assert!(found.ellipse.center().x > 25.0, "{found:?}");
    assert!((f64::from(found.mask.extent().unwrap()[2]) - 70.0).abs() < 3.0);
}

#[test]
fn many_objects_give_the_same_as_each_alone_on_any_number_of_threads() {
    let objects: Vec<Vec<Crop>> = (1..5).map(|count| crops(&ellipses(count))).collect();
    let options = SegmentOptions { seed: 3, ..Default::default() };
    let alone: Vec<_> = objects.iter().map(|crops| segment_object(crops, &options)).collect();
    let count = std::sync::atomic::AtomicUsize::new(0);
    let progress = |done: usize, total: usize| {
        assert!(done <= total && total == 4);
        count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        ControlFlow::Continue(())
    };
    assert_eq!(segment_objects(&objects, &options, &progress), alone);
    assert_eq!(count.into_inner(), 4);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(
            pool.install(|| segment_objects(&objects, &options, &|_: usize, _: usize| ControlFlow::Continue(()))),
            alone
        );
    }
}

#[test]
fn options_and_crops_that_do_not_fit_are_refused() {
    let one = crops(&ellipses(1));
    let options = SegmentOptions { smoothing: f64::NAN, ..Default::default() };
    assert!(matches!(segment_object(&one, &options), Err(SegmentError::Option(_))));
    let image = view(&ellipses(1)[0], 0);
    let other = CropOptions { grid: 48, ..Default::default() };
    let other = Crop::cut(&image, one[0].bounding_box(), &other).unwrap();
    let error = segment_object(&[one[0].clone(), other], &SegmentOptions::default()).unwrap_err();
    assert!(error.to_string().contains("a grid of 64 with a margin of 0.2, and 48 with 0.2"), "{error}");
}

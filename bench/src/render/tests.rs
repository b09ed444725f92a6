use super::*;
use quadlift::geometry::{ConvexBody, project_bounding_box, project_ellipsoid};
use quadlift_segment::{Moments, PixelTerm};

fn small() -> RenderOptions {
    RenderOptions { seed: 4, views: 4, width: 160, height: 120, ..Default::default() }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_one_does_not() {
    let (a, b) = (render(&small()).unwrap(), render(&small()).unwrap());
    assert_eq!((&a.images, &a.labels), (&b.images, &b.labels));
    let other = render(&RenderOptions { seed: 5, ..small() }).unwrap();
    assert_ne!(a.images, other.images);
    assert_ne!(a.synthetic.truth, other.synthetic.truth);
}

#[test]
fn noise_does_not_change_the_world() {
    let (clean, noisy) = (
        render(&RenderOptions { sensor_noise: 0.0, ..small() }).unwrap(),
        render(&RenderOptions { box_noise: 0.1, ..small() }).unwrap(),
    );
    assert_eq!((&clean.labels, &clean.synthetic.truth), (&noisy.labels, &noisy.synthetic.truth));
    assert_ne!(clean.images, noisy.images);
}

#[test]
fn the_boxes_are_those_of_the_visible_masks() {
    let rendered = render(&small()).unwrap();
    let scene = &rendered.synthetic.scene;
    assert!(scene.detections.len() >= 10, "{}", scene.detections.len());
    assert_eq!(scene.detections.len(), rendered.values.len());
    for ((detection, &value), &fraction) in
        scene.detections.iter().zip(&rendered.values).zip(&rendered.visible_fractions)
    {
        let mask = rendered.labels[detection.frame_index as usize].mask(value);
        assert_eq!(detection.bounding_box, mask.bounding_box());
        let object = detection.object_index.unwrap() as usize;
        assert_eq!(scene.object_ids[object], rendered.synthetic.truth[usize::from(value) - 1].0);
        assert!((0.2..=1.0).contains(&fraction));
    }
}

#[test]
fn a_lone_ellipsoid_is_where_its_projection_is() {
    let options = RenderOptions { objects: 1, kinds: vec![ObjectKind::Ellipsoid], views: 6, ..Default::default() };
    let mut seen_whole = 0;
    for seed in 0..4 {
        let rendered = render(&RenderOptions { seed, ..options.clone() }).unwrap();
        let body = rendered.synthetic.truth[0].1;
        for (k, detection) in rendered.synthetic.scene.detections.iter().enumerate() {
            if rendered.visible_fractions[k] < 1.0 {
                continue;
            }
            let frame = detection.frame_index as usize;
            let projection = &rendered.synthetic.scene.frames[frame].projection;
            let exact = project_ellipsoid(projection, &body.closest_ellipsoid()).unwrap();
            let mask = rendered.labels[frame].mask(1);
            let fitted = Moments::of_mask(&mask, PixelTerm::Centers).unwrap().ellipse().unwrap();
            assert!((fitted.center() - exact.center()).norm() < 0.1);
            assert!((fitted.shape() - exact.shape()).norm() < 5e-3 * exact.shape().norm());
            seen_whole += 1;
        }
    }
    assert!(seen_whole >= 8, "{seen_whole}");
}

#[test]
fn masks_lie_in_the_projections_of_the_envelopes() {
    let rendered = render(&RenderOptions { objects: 9, kinds: ObjectKind::ALL.to_vec(), views: 3, ..small() }).unwrap();
    assert!(ObjectKind::ALL.iter().all(|kind| rendered.kinds.contains(kind)), "{:?}", rendered.kinds);
    for (detection, &value) in rendered.synthetic.scene.detections.iter().zip(&rendered.values) {
        let projection = &rendered.synthetic.scene.frames[detection.frame_index as usize].projection;
        let (_, body) = &rendered.synthetic.truth[usize::from(value) - 1];
        let outer = project_bounding_box(projection, body).unwrap().edges();
        let inner = detection.bounding_box.unwrap().edges();
        for side in 0..2 {
            assert!(inner[side] > outer[side] - 1.0 && inner[side + 2] < outer[side + 2] + 1.0);
        }
    }
}

#[test]
fn objects_hide_each_other_and_hidden_ones_are_not_detected() {
    let all = render(&RenderOptions { least_visible: 0.0, views: 10, ..small() }).unwrap();
    let hidden = all.visible_fractions.iter().filter(|&&f| f < 0.95).count();
    assert!(hidden >= 4, "{:?}", all.visible_fractions);
    assert!(all.visible_fractions.iter().all(|&f| f > 0.0 && f <= 1.0));
    let most = render(&RenderOptions { least_visible: 0.9, views: 10, ..small() }).unwrap();
    let kept = all.visible_fractions.iter().filter(|&&f| f >= 0.9).count();
    assert_eq!(most.synthetic.scene.detections.len(), kept);
}

#[test]
fn noisy_boxes_stay_in_the_image_and_vary_as_asked() {
    let options = RenderOptions { objects: 6, views: 60, ..small() };
    let exact = render(&options).unwrap();
    let noisy = render(&RenderOptions { box_noise: 0.1, ..options }).unwrap();
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in exact.synthetic.scene.detections.iter().zip(&noisy.synthetic.scene.detections) {
        let (a, b) = (a.bounding_box.unwrap(), b.bounding_box.unwrap());
        let [x0, y0, x1, y1] = b.edges();
        assert!(x0 >= 0.0 && y0 >= 0.0 && x1 <= 160.0 && y1 <= 120.0 && x0 < x1 && y0 < y1);
        // Edges far from the border are not cut.
        for k in 0..4 {
            let free = a.edges()[k] > 30.0 && a.edges()[k] < 90.0;
            if free {
                sum += ((b.edges()[k] - a.edges()[k]) / a.mean_half_size()).powi(2);
                count += 1.0;
            }
        }
    }
    let deviation: f64 = f64::sqrt(sum / count);
    assert!(count > 200.0 && (deviation - 0.1).abs() < 0.02, "{deviation} {count}");
}

#[test]
fn the_truth_of_an_ellipsoid_is_itself_and_bodies_stand_on_the_ground() {
    let rendered = render(&RenderOptions { objects: 3, kinds: vec![ObjectKind::Ellipsoid], ..small() }).unwrap();
    for (_, body) in &rendered.synthetic.truth {
        let lowest = body.center().z - body.support(&nalgebra::Vector3::z());
        assert!(lowest.abs() < 1e-9);
    }
}

#[test]
fn senseless_options_are_refused_by_name() {
    let refused = |change: fn(&mut RenderOptions)| {
        let mut options = small();
        change(&mut options);
        match render(&options).unwrap_err() {
            SyntheticError::OutOfRange { what, .. } => what,
            other => panic!("{other}"),
        }
    };
    assert_eq!(refused(|o| o.objects = 256), "number of objects");
    assert_eq!(refused(|o| o.kinds.clear()), "number of kinds of objects");
    assert_eq!(refused(|o| o.width = 0), "width of the images");
    assert_eq!(refused(|o| o.height = 1 << 20), "height of the images");
    assert_eq!(refused(|o| o.arc = f64::NAN), "angle of the arc");
    assert_eq!(refused(|o| o.camouflage = 1.5), "share of camouflaged objects");
    assert_eq!(refused(|o| o.least_visible = -0.1), "minimum visible share");
    assert_eq!(refused(|o| o.box_noise = f64::INFINITY), "box noise");
    assert_eq!(refused(|o| o.sensor_noise = -1.0), "sensor noise");
}

#[test]
fn no_objects_or_no_views_are_no_special_cases() {
    let empty = render(&RenderOptions { objects: 0, ..small() }).unwrap();
    assert_eq!((empty.images.len(), empty.synthetic.scene.detections.len()), (4, 0));
    let unseen = render(&RenderOptions { views: 0, ..small() }).unwrap();
    assert_eq!((unseen.images.len(), unseen.synthetic.truth.len()), (0, 4));
}

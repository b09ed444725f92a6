//! Depth images of known bodies; the depths are those of rays.

use quadlift::geometry::BoundingBox;
use quadlift::random::stream;

use super::*;
use crate::surface::{ERROR_IN_BOX, ERROR_IN_MASK};
use crate::surface_shots::{SCALE, SIDE, patch, quantiles, shot, shots};

#[test]
fn the_surface_is_found_before_walls_on_the_ground_and_behind_other_things() {
    let shots = shots();
    assert!(shots.len() > 280, "{}", shots.len());
    let of_window =
        |half_sizes: f64| quantiles(&shots, |s| s.image.surface_in(&patch(s, None), half_sizes).unwrap().median);
    let ours = of_window(WINDOW);
    let all = [1.0, 1.5, 3.0].map(of_window);
    // Shorter windows show a part, longer ones what is behind.
    assert!(ours[0] < 0.05 && all.iter().all(|other| ours[2] < other[2]), "{ours:?} {all:?}");
    // The median of the whole box shows the wall.
    let of_box = quantiles(&shots, |s| s.image.surface_in(&patch(s, None), 1e9).unwrap().median);
    assert!(of_box[2] > 1.3 * ours[2], "{of_box:?} {ours:?}");
    let in_mask = quantiles(&shots, |s| s.image.surface(&patch(s, Some(&s.mask))).unwrap().median);
    // The standard deviations are those of the errors.
    assert!((0.8..1.25).contains(&(ours[1] / ERROR_IN_BOX)), "{ours:?}");
    assert!((0.8..1.25).contains(&(in_mask[1] / ERROR_IN_MASK)), "{in_mask:?}");
}

#[test]
fn an_image_with_fewer_pixels_shows_the_same() {
    for seed in 0..20 {
        let Some(shot) = shot(&mut stream(seed, 71)) else { continue };
        let full = shot.image.surface(&patch(&shot, None)).unwrap();
        let small: Vec<u16> = (0..SIDE * SIDE / 16)
            .map(|k| shot.image.counts.value(4 * (k % (SIDE / 4)) + 2, 4 * (k / (SIDE / 4)) + 2))
            .collect();
        let small = DepthImage::new(SIDE / 4, SIDE / 4, small, SCALE).unwrap();
        let found = small.surface(&patch(&shot, None)).unwrap();
        assert!((found.median / full.median - 1.0).abs() < 0.1 * shot.half_size, "{seed}: {full:?} {found:?}");
        assert!(found.sd > full.sd);
        let in_mask = small.surface(&patch(&shot, Some(&shot.mask))).unwrap();
        let full = shot.image.surface(&patch(&shot, Some(&shot.mask))).unwrap();
        assert!((in_mask.median / full.median - 1.0).abs() < 0.1 * shot.half_size, "{seed}: {full:?} {in_mask:?}");
    }
}

#[test]
fn pixels_without_depth_tell_nothing() {
    let bounding_box = BoundingBox::new([2.0, 2.0, 30.0, 30.0]).unwrap();
    let patch = Patch { bounding_box, mask: None, image_size: [32.0; 2], half_size: 0.1 };
    let image = |counts: Vec<u16>| DepthImage::new(32, 32, counts, 0.001).unwrap();
    assert_eq!(image(vec![0; 1024]).surface(&patch), None);
    let few =
        |n: usize| image((0..1024).map(|k| u16::from(k % 32 == 16 && k < 32 * (n + 10) && k >= 320) * 1500).collect());
    assert_eq!(few(MIN_PIXELS - 1).surface(&patch), None);
    let found = few(MIN_PIXELS).surface(&patch).unwrap();
    assert!((found.median - 1.5).abs() < 1e-12 && found.sd > 0.0);
    let outside = Patch { bounding_box: BoundingBox::new([-50.0, -50.0, -10.0, -10.0]).unwrap(), ..patch };
    assert_eq!(image(vec![1500; 1024]).surface(&outside), None);
    let none = Mask::from_fn(32, 32, |_, _| false);
    assert_eq!(image(vec![1500; 1024]).surface(&Patch { mask: Some(&none), ..patch }), None);
    let beyond = Patch { bounding_box: BoundingBox::new([20.0, 20.0, 60.0, 60.0]).unwrap(), ..patch };
    assert!(image(vec![1500; 1024]).surface(&beyond).is_some());
    assert!(DepthImage::new(32, 32, vec![0; 3], 1.0).is_err());
}

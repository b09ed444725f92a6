//! Scenes with masses of boxes but no objects, for tests and for the bench `crowds`.

use super::{BoundingBox, NewDetection, Scene, SceneBuilder, SyntheticOptions, generate};

/// Boxes anywhere in the image, by a simple sequence.
pub(super) fn anywhere(count: usize, seed: usize) -> Vec<[f64; 4]> {
    let fraction = |k: usize| (((k + seed * 977) * 2_654_435_761) % 1_000_003) as f64 / 1_000_003.0;
    let one = |k: usize| {
        let (x, y, s) = (1200.0 * fraction(3 * k), 900.0 * fraction(3 * k + 1), 10.0 + 60.0 * fraction(3 * k + 2));
        [x, y, x + s, y + s]
    };
    (0..count).map(one).collect()
}

/// A scene without objects whose frames have these boxes.
pub(super) fn scene_of(views: usize, boxes: impl Fn(usize) -> Vec<[f64; 4]>) -> Scene {
    let empty = generate(&SyntheticOptions { objects: 0, views, ..Default::default() }).expect("the options are valid");
    let mut builder = SceneBuilder::new("crowd");
    for (index, frame) in empty.scene.frames.iter().enumerate() {
        builder.add_frame(&frame.id, frame.projection, frame.image_size.map(Into::into)).expect("a new frame");
        for edges in boxes(index) {
            let bounding_box = Some(BoundingBox::new(edges).expect("a box"));
            let detection = NewDetection { frame: &frame.id, bounding_box, ..Default::default() };
            builder.add_detection(&detection).expect("its frame is there");
        }
    }
    builder.build()
}

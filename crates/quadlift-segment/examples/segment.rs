//! Segments the objects of a rendered scene and compares the masks with the true ones.
//!
//!     cargo run --example segment -p quadlift-segment

#![allow(clippy::print_stdout, reason = "an example")]

use quadlift_segment::render::{RenderOptions, render};
use quadlift_segment::{Crop, CropOptions, SegmentOptions, segment_object};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Three textured objects on a cluttered ground in six images, with boxes around the visible pixels.
    let rendered = render(&RenderOptions { objects: 3, views: 6, seed: 1, ..Default::default() })?;
    let scene = &rendered.synthetic.scene;
    for (object, id) in scene.object_ids.iter().enumerate() {
        // The pixels of all boxes of the object; the images are not needed any more after this.
        let (mut crops, mut truth) = (Vec::new(), Vec::new());
        for (index, detection) in scene.detections.iter().enumerate() {
            let Some(bounding_box) = detection.bounding_box else { continue };
            if detection.object_index.map(|index| index as usize) != Some(object) {
                continue;
            }
            let frame = detection.frame_index as usize;
            crops.push(Crop::cut(&rendered.images[frame], &bounding_box, &CropOptions::default())?);
            truth.push(rendered.labels[frame].mask(rendered.values[index]));
        }
        let views = segment_object(&crops, &SegmentOptions::default())?;
        let overlaps: Vec<f64> = views.iter().zip(&truth).map(|(view, truth)| view.mask.iou(truth)).collect();
        let mean = overlaps.iter().sum::<f64>() / overlaps.len() as f64;
        println!("{id}: {} views, mean overlap (IoU) with the true masks {mean:.2}", views.len());
        if mean < 0.5 {
            return Err(format!("{id}: the masks are wrong").into());
        }
    }
    Ok(())
}

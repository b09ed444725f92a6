//! Renders a scene and writes its images, its label images and, in `detections.txt`, a line for each detection with its
//! frame, its value in the label image and the visible share: `render FOLDER [SEED] [OBJECTS] [VIEWS]`.

use std::path::Path;
use std::time::Instant;

use quadlift_segment::render::{RenderOptions, render};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(arguments.first().ok_or("expected a folder")?);
    let number = |index: usize, default: u64| arguments.get(index).map_or(Ok(default), |text| text.parse());
    let defaults = RenderOptions::default();
    let options = RenderOptions {
        seed: number(1, 0)?,
        objects: number(2, defaults.objects as u64)? as usize,
        views: number(3, defaults.views as u64)? as usize,
        ..defaults
    };
    let start = Instant::now();
    let rendered = render(&options)?;
    let seconds = start.elapsed().as_secs_f64();
    std::fs::create_dir_all(folder)?;
    for ((frame, image), labels) in rendered.synthetic.frames.iter().zip(&rendered.images).zip(&rendered.labels) {
        image.save(folder.join(format!("{}.png", frame.id)))?;
        let labels = labels.to_8_bit().ok_or("more than 255 objects")?;
        labels.save(folder.join(format!("{}_labels.png", frame.id)))?;
    }
    let mut lines = String::new();
    for (k, detection) in rendered.synthetic.scene.detections.iter().enumerate() {
        let frame = &rendered.synthetic.frames[detection.frame_index as usize].id;
        lines += &format!("{frame} {} {:.3}\n", rendered.values[k], rendered.visible_fractions[k]);
    }
    std::fs::write(folder.join("detections.txt"), lines)?;
    let detections = rendered.synthetic.scene.detections.len();
    let message = format!("{} images, {detections} detections, {seconds:.2} s\n", rendered.images.len());
    std::io::Write::write_all(&mut std::io::stdout(), message.as_bytes())?;
    Ok(())
}

//! Draws the picture of the README from the files that `quadlift demo` writes of its second scene: on the left the boxes of one image with
//! the outlines of the estimated ellipsoids, on the right the estimates and the truth from above.
//!
//!     cargo run --release -p quadlift-cli -- demo --out target/demo
//!     cargo run --release -p quadlift-cli --example readme_picture -- target/demo/boxes docs/images/demo.svg

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Result, bail};
use nalgebra::Vector2;
use quadlift::associate;
use quadlift::associate::AssociateOptions;
use quadlift::geometry::{BoundingBox, Ellipse, Ellipsoid, project_ellipsoid};
use quadlift::scene::Detection;
use quadlift_io::scene_file::ObjectBodies;
use quadlift_io::{SceneFile, read_scene_file, write_file};

/// One colour for each object, in their order.
const COLOURS: [&str; 8] = ["#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#ee8866", "#777777"];

/// Side of a panel in pixels of the picture.
const SIDE: f64 = 400.0;

/// Space around the panels.
const MARGIN: f64 = 16.0;

/// A square part of a plane that is drawn into a panel.
struct Panel {
    /// Left end of the panel in the picture.
    left: f64,
    /// Corner of the part, in its own units.
    corner: Vector2<f64>,
    /// Pixels of the picture per unit.
    scale: f64,
}

impl Panel {
    /// The panel that holds all the boxes with a little space around them.
    fn around(boxes: impl Iterator<Item = BoundingBox>, left: f64) -> Self {
        let mut low = Vector2::repeat(f64::INFINITY);
        let mut high = -low;
        for b in boxes {
            low = low.inf(&Vector2::new(b.x0, b.y0));
            high = high.sup(&Vector2::new(b.x1, b.y1));
        }
        let side = 1.08 * (high - low).max();
        Self { left, corner: (low + high) / 2.0 - Vector2::repeat(side / 2.0), scale: SIDE / side }
    }

    fn place(&self, point: &Vector2<f64>) -> Vector2<f64> {
        (point - self.corner) * self.scale + Vector2::new(self.left, MARGIN)
    }

    fn rectangle(&self, b: &BoundingBox, style: &str) -> String {
        let (low, size) = (self.place(&Vector2::new(b.x0, b.y0)), b.size() * self.scale);
        format!(
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" {style}/>\n",
            low.x, low.y, size.x, size.y
        )
    }

    fn ellipse(&self, e: &Ellipse, style: &str) -> String {
        let (c, r, angle) = (self.place(&e.center), e.semi_axes * self.scale, e.angle.to_degrees());
        format!(
            "<ellipse cx=\"{0:.1}\" cy=\"{1:.1}\" rx=\"{2:.1}\" ry=\"{3:.1}\" transform=\"rotate({angle:.1} {0:.1} {1:.1})\" \
             {style}/>\n",
            c.x, c.y, r.x, r.y
        )
    }
}

/// An ellipsoid seen from above by a camera at infinity: x to the right, y up.
fn from_above(ellipsoid: &Ellipsoid) -> Result<Ellipse> {
    let shape = ellipsoid.shape();
    let mut flat = shape.fixed_view::<2, 2>(0, 0).into_owned();
    // The y axis of a picture points down.
    flat[(0, 1)] = -flat[(0, 1)];
    flat[(1, 0)] = -flat[(1, 0)];
    Ok(Ellipse::from_shape(Vector2::new(ellipsoid.center.x, -ellipsoid.center.y), &flat)?)
}

/// The ellipsoids of a file with the colours of their objects.
fn coloured(objects: &[ObjectBodies]) -> impl Iterator<Item = (Ellipsoid, &'static str)> + '_ {
    objects.iter().zip(COLOURS.iter().cycle()).filter_map(|(object, colour)| Some((object.ellipsoid?, *colour)))
}

/// The boxes of one image and the outlines of the ellipsoids in it.
fn image(file: &SceneFile, estimate: &SceneFile) -> Result<String> {
    let scene = file.to_scene()?;
    // As the demo has found them: a box is wrong when it belongs to no object or was rejected by its own.
    let objects = associate(&scene, &AssociateOptions::default(), &|_, _| {})?;
    let wrong = |(detection, object): (&Detection, &Option<u32>)| {
        let frame = &scene.frames[detection.frame_index as usize].id;
        object.is_none_or(|object| {
            let id = &objects.objects[object as usize].id;
            estimate.objects.iter().any(|o| o.id == *id && o.views_rejected.contains(frame))
        })
    };
    let wrong: Vec<bool> = scene.detections.iter().zip(&objects.object_of_detection).map(wrong).collect();
    let boxes_in = |frame: usize| {
        let boxes = scene.detections.iter().zip(&wrong).filter(move |(d, _)| d.frame_index as usize == frame);
        boxes.filter_map(|(d, wrong)| Some((d.bounding_box?, *wrong)))
    };
    // The image with the most wrong boxes, the first of equals.
    let count = |frame: &usize| boxes_in(*frame).filter(|(_, wrong)| *wrong).count();
    let Some(index) = (0..scene.frames.len()).rev().max_by_key(count) else { bail!("there is no frame") };
    let (frame, boxes) = (&scene.frames[index], boxes_in(index).collect::<Vec<_>>());
    let panel = Panel::around(boxes.iter().map(|(b, _)| *b), MARGIN);
    let mut svg = String::new();
    for (ellipsoid, colour) in coloured(&estimate.to_objects()?) {
        let outline = project_ellipsoid(&frame.projection, &ellipsoid)?;
        svg += &panel.ellipse(&outline, &format!("fill=\"{colour}\" fill-opacity=\"0.45\" stroke=\"{colour}\""));
    }
    for (b, wrong) in &boxes {
        let style = if *wrong { "stroke=\"#cc0000\" stroke-dasharray=\"6 4\"" } else { "stroke=\"#222222\"" };
        svg += &panel.rectangle(b, &format!("fill=\"none\" {style}"));
    }
    Ok(svg)
}

/// Estimates and truth from above.
fn plan(estimate: &SceneFile, truth: &SceneFile) -> Result<String> {
    let (estimated, exact) = (estimate.to_objects()?, truth.to_objects()?);
    let outlines = |objects: &[ObjectBodies]| -> Result<Vec<(Ellipse, &str)>> {
        coloured(objects).map(|(ellipsoid, colour)| Ok((from_above(&ellipsoid)?, colour))).collect()
    };
    let (estimated, exact) = (outlines(&estimated)?, outlines(&exact)?);
    let panel = Panel::around(estimated.iter().chain(&exact).map(|(e, _)| e.bounding_box()), 2.0 * MARGIN + SIDE);
    let mut svg = String::new();
    for (outline, colour) in &estimated {
        svg += &panel.ellipse(outline, &format!("fill=\"{colour}\" fill-opacity=\"0.45\" stroke=\"{colour}\""));
    }
    for (outline, _) in &exact {
        svg += &panel.ellipse(outline, "fill=\"none\" stroke=\"#222222\" stroke-dasharray=\"2 3\"");
    }
    Ok(svg)
}

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [folder, output] = arguments.as_slice() else { bail!("expected the folder of the demo and the file to write") };
    let read = |name: &str| read_scene_file(&folder.join(name));
    let (scene, estimate, truth) = (read("scene.json")?, read("estimate.json")?, read("truth.json")?);
    let (width, height) = (2.0 * SIDE + 3.0 * MARGIN, SIDE + 4.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"14\">\n\
         <title>Boxes in one of 20 images, and the ellipsoids estimated from all of them</title>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    svg += &image(&scene, &estimate)?;
    svg += &plan(&estimate, &truth)?;
    let captions =
        ["one of 20 images: boxes (red: rejected) and outlines", "from above: estimated ellipsoids, truth dotted"];
    for (index, caption) in captions.iter().enumerate() {
        let x = MARGIN + index as f64 * (SIDE + MARGIN);
        writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{MARGIN}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\" stroke=\"#cccccc\"/>\n\
             <text x=\"{x}\" y=\"{}\" fill=\"#222222\">{caption}</text>",
            height - 1.2 * MARGIN
        )?;
    }
    svg += "</svg>\n";
    write_file(output, |out| out.write_all(svg.as_bytes()))?;
    Ok(())
}

//! Localizes the objects of a synthetic scene, and writes a report and the picture of a frame.
//!
//!     cargo run --example report -p quadlift-report -- report.html frame.svg

#![allow(clippy::print_stdout, reason = "an example")]

use std::path::PathBuf;

use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};
use quadlift::{LocalizeOptions, localize};
use quadlift_io::{SceneFile, estimates_to_objects};
use quadlift_report::{Content, Picture, page, report};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [html, svg] = arguments.as_slice() else {
        return Err("usage: report REPORT.html FRAME.svg".into());
    };
    let synthetic = generate(&SyntheticOptions {
        objects: 5,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.02)],
        ..Default::default()
    })?;
    let scene = &synthetic.scene;
    let localization = localize(scene, &LocalizeOptions::default())?;
    // Estimates come as a scene file, so that those of other programs can be shown too.
    let objects = estimates_to_objects(scene, &localization).collect();
    let estimate = SceneFile::default().with_results(objects, Default::default());
    let content = Content {
        title: "Five objects",
        scene,
        images: None,
        estimate: Some(&estimate),
        truth: None,
        source: None,
        scores: None,
        points: &[],
    };
    let report = report(&content)?;
    std::fs::write(html, page(&report)?)?;
    std::fs::write(svg, Picture { report: &report, frame_index: 0, image: None, labels: true }.svg()?)?;
    println!("wrote {} and {}", html.display(), svg.display());
    Ok(())
}

//! `quadlift synth`: synthetic scenes with known truth.

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use nalgebra::Vector3;
use quadlift::solve::BodyKind;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};
use quadlift_io::write_scene_file;
use serde_json::json;

use crate::args;
use crate::error::{Outcome, usage};
use crate::files::check_file;
use crate::output::Output;
use crate::synthetic_file::scene_file;

/// Write a synthetic scene whose truth is known
///
/// Objects of random place, size and orientation lie in a cube of side 20; the cameras stand 200 away from its centre
/// and look at it. The truth is written as the `objects` of the scene; no estimator reads it.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Noise (--noise, several times if wanted):
  box:0.05   each box edge, Gaussian; relative to the box's mean half size
  re:45      angle of the ellipse, uniform; degrees
  se:0.3     size of the ellipse, uniform; one factor for both axes (se2: one for each axis)
  te:0.3     centre of the ellipse, uniform; relative to the mean semi-axis (te2: to the mean full axis)

Examples:
  quadlift synth -o scene.json --noise box:0.05 --outliers 0.05
  quadlift synth -o arc.json --trajectory arc:10 --body cuboid --objects 8 --seed 3
  quadlift synth -o paper.json --observations ellipses --noise se:0.3
  quadlift localize scene.json -o estimate.json && quadlift evaluate estimate.json scene.json"
)]
pub struct Args {
    /// The scene file to write
    #[arg(short, long, value_name = "SCENE.json")]
    output: PathBuf,

    /// Number of objects
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = RangedU64ValueParser::<usize>::new().range(1..=1_000_000))]
    objects: usize,

    /// Number of views
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = RangedU64ValueParser::<usize>::new().range(1..=1_000_000))]
    views: usize,

    /// Kind of the objects: ellipsoid, cuboid or superellipsoid:Q
    #[arg(long, value_name = "BODY", default_value = "ellipsoid", value_parser = args::body)]
    body: BodyKind,

    /// What is measured in the images
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Measured::Boxes)]
    observations: Measured,

    /// Noise and its amount, such as box:0.05 (see below)
    #[arg(long, value_name = "KIND:AMOUNT", value_parser = noise)]
    noise: Vec<Noise>,

    /// Share of the detections that are replaced by wrong boxes, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = args::finite)]
    outliers: f64,

    /// Where the cameras stand: paper (60 degrees around, 70 up) or arc:SPAN (degrees)
    #[arg(long, value_name = "PATH", default_value = "paper", value_parser = trajectory)]
    trajectory: Trajectory,

    /// Factor on the whole world; the pixels stay the same
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = args::finite)]
    scale: f64,

    /// Moves the whole world after scaling; the pixels stay the same
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = args::three_numbers, allow_hyphen_values = true)]
    offset: [f64; 3],

    /// Seed of everything that is drawn at random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Measured {
    Boxes,
    Ellipses,
    Both,
}

fn noise(text: &str) -> Result<Noise, String> {
    let kinds = "box, re, se, se2, te or te2";
    let (kind, amount) = text.split_once(':').ok_or_else(|| format!("expected KIND:AMOUNT with {kinds}"))?;
    let amount = args::finite(amount)?;
    match kind {
        "box" => Ok(Noise::BoxEdges(amount)),
        "re" => Ok(Noise::Rotation(amount)),
        "se" => Ok(Noise::Size(amount)),
        "se2" => Ok(Noise::SizePerAxis(amount)),
        "te" => Ok(Noise::Translation(amount)),
        "te2" => Ok(Noise::TranslationFullAxis(amount)),
        _ => Err(format!("unknown noise \"{kind}\"; expected {kinds}")),
    }
}

fn trajectory(text: &str) -> Result<Trajectory, String> {
    match text.split_once(':') {
        None if text == "paper" => Ok(Trajectory::default()),
        Some(("arc", span)) => Ok(Trajectory::Arc { span: args::finite(span)? }),
        _ => Err("expected paper or arc:SPAN, the span in degrees".to_owned()),
    }
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    check_file(&args.output)?;
    let options = SyntheticOptions {
        seed: args.seed,
        objects: args.objects,
        body: args.body,
        views: args.views,
        trajectory: args.trajectory,
        scale: args.scale,
        offset: Vector3::from(args.offset),
        observations: match args.observations {
            Measured::Boxes => Observations::Boxes,
            Measured::Ellipses => Observations::Ellipses,
            Measured::Both => Observations::Both,
        },
        noise: args.noise.clone(),
        outlier_share: args.outliers,
        ..Default::default()
    };
    let synthetic = match generate(&options) {
        Ok(synthetic) => synthetic,
        Err(error) => return usage(error.to_string()),
    };
    write_scene_file(&args.output, &scene_file(&synthetic))?;
    let outliers = synthetic.outliers.iter().filter(|wrong| **wrong).count();
    let detections = synthetic.scene.detections.len();
    out.report(&format!(
        "wrote {}: {} objects, {} views, {detections} detections, {outliers} of them outliers\n",
        args.output.display(),
        args.objects,
        args.views,
    ))?;
    out.document(&json!({
        "output": args.output.display().to_string(),
        "objects": args.objects,
        "views": args.views,
        "detections": detections,
        "outliers": outliers,
    }))?;
    Ok(Outcome::Fine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noises_and_paths_are_read() {
        assert_eq!(noise("box:0.05"), Ok(Noise::BoxEdges(0.05)));
        assert_eq!(noise("te2:0.3"), Ok(Noise::TranslationFullAxis(0.3)));
        assert!(noise("box").is_err() && noise("box:x").is_err() && noise("fog:1").is_err());
        assert_eq!(trajectory("arc:60"), Ok(Trajectory::Arc { span: 60.0 }));
        assert!(trajectory("arc").is_err() && trajectory("circle:3").is_err());
    }
}

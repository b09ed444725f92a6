//! `quadlift synth`: synthetic scenes with known truth.

mod cues;
mod hall;

use std::path::PathBuf;

use clap::builder::RangedU64ValueParser;
use nalgebra::Vector3;
use quadlift::geometry::BodyKind;
use quadlift::synthetic::{
    Detector, Noise, Observations, ShapeOptions, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate,
};
use quadlift_io::write_scene_file;
use serde_json::json;

use crate::args;
use crate::error::{Outcome, usage};
use crate::files::check_file;
use crate::next::Next;
use crate::output::Output;
use quadlift_io::synthetic_file::{scene_file, with_true_ids};

/// Write a synthetic scene with ground truth
///
/// Objects with random position, size and orientation lie in a cube of side 20; the cameras look at its center from a
/// distance of 200. The ground truth is written as the `objects` of the scene; no estimator reads it. Options simulate
/// a detector with misses and false positives, and the ids of a tracker, or no ids.
///
/// --pedestrians writes a hall with fixed cameras for `calibrate-rig`.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Noise (--noise, may be repeated):
  box:0.05   each box edge, Gaussian; relative to the box's mean half size
  re:45      angle of the ellipse, uniform; degrees
  se:0.3     size of the ellipse, uniform; one factor for both axes (se2: one for each axis)
  te:0.3     center of the ellipse, uniform; relative to the mean semi-axis (te2: to the mean full axis)

Errors of what detections carry (--cue-noise, may be repeated; the defaults are those of networks for single images):
  outline:0.03
             radius of each outline, smooth (size, place, elongation), relative to the box's mean half size
  angle:3 sides:0.03
             angle of each oriented box, degrees; its sides, relative to the box's mean half size
  depth:0.05 depth-scale:1.1 depth-shift:0 depth-outliers:0
             noise of each depth, relative; measured over true depth of all; added to all, in world units; share that shows
             something behind
  distance:0.04 across:0.01
             center of each 3D box along the ray and across it, each way, relative to the distance
  size:0.1 size-scale:1.08
             logarithm of each extent; measured over true extents of all
  yaw:8 flips:0.1 box3d-outliers:0.05
             rotation about the third axis, degrees; share that looks backwards; share that is wrong in everything

Camera positions (--trajectory):
  paper      an arc of 60 degrees at 70 degrees of elevation, as in the paper
  arc:SPAN   an arc of SPAN degrees
  orbit      a full circle, 20 to 50 degrees of elevation
  random     anywhere above the objects, which lie on a floor; boxes are clipped at the image border
  street     a drive along parked cars, one length unit per view; views / 3 + 17 objects fill the street

--pedestrians writes fixed cameras (cam0, cam1, ...) at the walls of a hall of 8 x 6 m in which people walk, in meters, at time steps half a
second apart (`rig_frame` and `time` of frames). It can be combined with --cameras, --time-steps, --noise box:X, --misses,
--false-positives, --no-ids and --seed.

Examples:
  quadlift synth -o scene.json --noise box:0.05 --outliers 0.05
  quadlift synth -o arc.json --trajectory arc:10 --body cuboid --objects 8 --seed 3
  quadlift synth -o table.json --trajectory random --body cuboid,cylinder,ellipsoid --standing --edge-bias 0.04
  quadlift synth -o paper.json --measurement ellipses --noise se:0.3
  quadlift synth -o outlines.json --views 3 --cues outline --cue-noise outline:0.05
  quadlift synth -o cues.json --views 2 --cues depth,box3d --cue-noise depth:0.1 --cue-noise yaw:20
  quadlift synth -o hall.json --pedestrians 2 --cameras 4 --noise box:0.03 --misses 0.2
  quadlift synth -o points.json --trajectory street --views 60 --noise box:0.02 --points 1000 --pose-noise 0.3
  quadlift synth -o boxes.json --ground-truth truth.json --no-ids --cube 40 --noise box:0.05 --misses 0.2 --false-positives 0.15
  quadlift localize scene.json -o estimate.json && quadlift evaluate estimate.json scene.json"
)]
pub(crate) struct Args {
    /// The scene file to write
    #[arg(short, long, value_name = "SCENE.json")]
    output: PathBuf,

    /// Number of objects
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = RangedU64ValueParser::<usize>::new().range(1..=1_000_000))]
    objects: usize,

    /// Number of views
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = RangedU64ValueParser::<usize>::new().range(1..=1_000_000))]
    views: usize,

    /// Kind of the objects: ellipsoid, cuboid, cylinder, superellipsoid:Q or rounded:R; several kinds are used in turn
    #[arg(long, value_name = "BODY,...", default_value = "ellipsoid", value_delimiter = ',', value_parser = args::body)]
    body: Vec<BodyKind>,

    /// Objects stand upright on the plane z = 0
    #[arg(long)]
    standing: bool,

    /// What is measured in the images
    #[arg(long, value_enum, value_name = "WHAT", default_value_t = Measured::Boxes)]
    measurement: Measured,

    /// Noise and its amount, such as box:0.05 (see below)
    #[arg(long, value_name = "KIND:AMOUNT", value_parser = noise)]
    noise: Vec<Noise>,

    /// Systematic error of the left, top, right and bottom edge of each object, the same in all of its boxes: standard
    /// deviation relative to the mean half size
    #[arg(long, value_name = "SD", default_value_t = 0.0, value_parser = args::finite)]
    edge_bias: f64,

    /// Fraction of the detections that are replaced by wrong boxes, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = args::finite)]
    outliers: f64,

    /// Camera positions: paper, arc:SPAN, orbit, random or street (see below)
    #[arg(long, value_name = "PATH", default_value = "paper", value_parser = trajectory)]
    trajectory: Trajectory,

    /// Side of the cube that contains the objects, in length units before --scale
    #[arg(long, value_name = "SIDE", default_value_t = 20.0, value_parser = args::finite)]
    cube: f64,

    /// Standard deviation of the rotation error of the cameras about each of their axes, in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, value_parser = args::finite)]
    pose_noise: f64,

    /// Scale the whole world; pixels do not change
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = args::finite)]
    scale: f64,

    /// Translate the whole world after scaling; pixels do not change
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = args::three_numbers, allow_hyphen_values = true)]
    offset: [f64; 3],

    /// Number of points about the objects, each tracked through 3 to 20 images, as structure from motion finds them
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = RangedU64ValueParser::<usize>::new().range(0..=10_000_000))]
    points: usize,

    /// Standard deviation of the pixels of points, each way
    #[arg(long, value_name = "PX", default_value_t = 0.5, value_parser = args::finite, requires = "points")]
    point_noise: f64,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    #[command(flatten)]
    detector: DetectorArgs,

    #[command(flatten)]
    ids: IdArgs,

    #[command(flatten)]
    cues: cues::CueArgs,

    /// Write a hall with fixed cameras in which so many people walk
    #[arg(
        long,
        value_name = "N",
        help_heading = "Hall",
        value_parser = RangedU64ValueParser::<usize>::new().range(1..=100),
        conflicts_with_all = [
            "objects", "views", "body", "standing", "edge_bias", "measurement", "outliers", "trajectory", "scale", "offset", "cube",
            "pose_noise", "points", "duplicates", "occlusion", "fragments", "switches", "ground_truth", "CueArgs"
        ]
    )]
    pedestrians: Option<usize>,

    /// Number of fixed cameras [default: 4]
    #[arg(
        long,
        value_name = "N",
        help_heading = "Hall",
        requires = "pedestrians",
        value_parser = RangedU64ValueParser::<usize>::new().range(1..=100)
    )]
    cameras: Option<usize>,

    /// Number of time steps
    #[arg(
        long,
        value_name = "N",
        help_heading = "Hall",
        requires = "pedestrians",
        default_value_t = 100,
        value_parser = RangedU64ValueParser::<usize>::new().range(1..=100_000)
    )]
    time_steps: usize,
}

/// Misses and false positives of the detector.
#[derive(clap::Args)]
#[command(next_help_heading = "Detector")]
struct DetectorArgs {
    /// Fraction of the visible objects that are missed, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = args::finite)]
    misses: f64,

    /// Number of false boxes per true box
    #[arg(long, value_name = "RATIO", default_value_t = 0.0, value_parser = args::finite)]
    false_positives: f64,

    /// Fraction of the objects that are detected twice, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = args::finite)]
    duplicates: f64,

    /// Objects occlude each other: an object that is covered by more than 65 % is missed
    #[arg(long)]
    occlusion: bool,
}

/// Object ids of the detections.
#[derive(clap::Args)]
#[command(next_help_heading = "Identities")]
struct IdArgs {
    /// Write detections without object ids
    #[arg(long, conflicts_with_all = ["fragments", "switches"])]
    no_ids: bool,

    /// Simulate tracker ids: probability at each detection that its track ends and a new one begins
    #[arg(long, value_name = "SHARE", value_parser = args::finite)]
    fragments: Option<f64>,

    /// Simulate tracker ids: probability at each detection that its track and a neighbor's are swapped from then on
    #[arg(long, value_name = "SHARE", value_parser = args::finite)]
    switches: Option<f64>,

    /// Write the scene with the true ids and objects to this file; SCENE.json then has no objects
    #[arg(long, value_name = "GROUND_TRUTH.json")]
    ground_truth: Option<PathBuf>,
}

impl IdArgs {
    fn ids(&self) -> SyntheticIds {
        match (self.no_ids, self.fragments, self.switches) {
            (true, ..) => SyntheticIds::Absent,
            (false, None, None) => SyntheticIds::True,
            (false, fragments, switches) => {
                SyntheticIds::Tracks { fragments: fragments.unwrap_or(0.0), switches: switches.unwrap_or(0.0) }
            }
        }
    }
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
    match (text, text.split_once(':')) {
        ("paper", _) => Ok(Trajectory::default()),
        ("orbit", _) => Ok(Trajectory::Orbit),
        ("random", _) => Ok(Trajectory::Random),
        ("street", _) => Ok(Trajectory::Street),
        (_, Some(("arc", span))) => Ok(Trajectory::Arc { span: args::finite(span)? }),
        _ => Err("expected paper, orbit, random, street or arc:SPAN, the span in degrees".to_owned()),
    }
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    if let Some(pedestrians) = args.pedestrians {
        return hall::run(args, pedestrians, out);
    }
    let synthetic = drawn(args)?;
    let outliers = synthetic.outliers.iter().filter(|wrong| **wrong).count();
    let (objects, views) = (synthetic.truth.len(), synthetic.frames.len());
    let detections = synthetic.scene.detections.len();
    let extra = synthetic.true_objects.iter().filter(|object| object.is_none()).count();
    let made_up = if extra > 0 { format!(", {extra} false or twice") } else { String::new() };
    out.report(&format!(
        "wrote {}: {objects} objects, {views} views, {detections} detections, {outliers} of them \
         outliers{made_up}\n",
        args.output.display(),
    ))?;
    let path = args.output.as_path();
    Next::default()
        .localize(path, None, "", "localize its objects")
        .command(["view".into(), path.into()], "view it in the browser")
        .tell(out)?;
    out.document(&json!({
        "output": args.output.display().to_string(),
        "objects": objects,
        "views": views,
        "detections": detections,
        "outliers": outliers,
        "false_or_duplicate": extra,
        "ground_truth": args.ids.ground_truth.as_ref().map(|path| path.display().to_string()),
    }))?;
    Ok(Outcome::Fine)
}

/// The scene that the options describe; its files are written.
fn drawn(args: &Args) -> anyhow::Result<SyntheticScene> {
    check_file(&args.output)?;
    if let Some(truth) = &args.ids.ground_truth {
        check_file(truth)?;
        if *truth == args.output {
            return usage("--ground-truth names the scene itself; expected another file");
        }
    }
    let defaults = SyntheticOptions::default();
    let detector = &args.detector;
    let options = SyntheticOptions {
        seed: args.seed,
        objects: args.objects,
        kinds: args.body.clone(),
        standing: args.standing,
        edge_bias: args.edge_bias,
        views: args.views,
        trajectory: args.trajectory,
        scale: args.scale,
        offset: Vector3::from(args.offset),
        observations: match args.measurement {
            Measured::Boxes => Observations::Boxes,
            Measured::Ellipses => Observations::Ellipses,
            Measured::Both => Observations::Both,
        },
        noise: args.noise.clone(),
        outlier_share: args.outliers,
        cube_side: args.cube,
        pose_noise: args.pose_noise,
        points: args.points,
        point_noise: args.point_noise,
        detector: Detector {
            misses: detector.misses,
            false_boxes: detector.false_positives,
            duplicates: detector.duplicates,
            occlusion: detector.occlusion,
        },
        ids: args.ids.ids(),
        ..defaults
    };
    let mut synthetic = match generate(&options) {
        Ok(synthetic) => synthetic,
        Err(error) => return usage(error.to_string()),
    };
    let mut shapes = ShapeOptions::default();
    if args.cues.is_used() {
        let with_cues = args.cues.options().and_then(|(cues, found)| {
            shapes = found;
            cues::with_cues(&synthetic, &cues, args.seed).map_err(|error| error.to_string())
        });
        match with_cues {
            Ok(scene) => synthetic.scene = scene,
            Err(problem) => return usage(problem),
        }
    }
    let mut file = scene_file(&synthetic);
    cues::add_shapes(&mut file, &synthetic, &shapes, args.seed);
    if let Some(truth) = &args.ids.ground_truth {
        write_scene_file(truth, &with_true_ids(file.clone(), &synthetic))?;
        file.objects = Vec::new();
    }
    write_scene_file(&args.output, &file)?;
    Ok(synthetic)
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
        assert_eq!((trajectory("orbit"), trajectory("street")), (Ok(Trajectory::Orbit), Ok(Trajectory::Street)));
        assert!(trajectory("arc").is_err() && trajectory("circle:3").is_err());
    }
}

//! `quadlift calibrate-rig`: where fixed cameras are, from what stands or walks by.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, bail};
use clap::builder::RangedU64ValueParser;
use quadlift::calibrate_rig::{
    CalibrateOptions, CalibratedCamera, Calibration, CameraStatus, KnownBaseline, RigScale, calibrate_rig,
};
use quadlift::scene::SourceError;
use quadlift::solve::CategoryPriors;
use quadlift_io::calibrate_rig::{RigOptions, RigScene, calibration_record, contradictions_in_words};
use quadlift_io::guard::check_not_read;
use quadlift_io::{builtin_priors, read_priors, read_scene_file, write_scene_file};

use crate::args;
use crate::error::{Outcome, usage};
use crate::files::{Inputs, check_result_name, move_paths, outputs, refuse_to_overwrite, with_hint};
use crate::next::Next;
use crate::output::{BAD, GOOD, HEADING, Output, WARNING, one_line};
use crate::table::{Cell, MAX_ROWS, Table, rest, significant};
use crate::threads;
use crate::words::{count, duration, some_of, with_unit};

/// Find the poses of fixed cameras
///
/// Finds them from the boxes of what stands or walks by. For synchronized cameras with known intrinsics: every camera of the scene file stays where it is, and frames with the same
/// `rig_frame`, or with equal `time`, were taken at one time step. Boxes with the same `object` show the same body; boxes without one are
/// matched by where they are. The result is the scene with `cam_from_world` in the frames of each camera that was calibrated.
/// Cameras that already have a pose keep it.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Columns:
  status    ok
            given: the pose was in the file
            not_connected: fewer than five bodies are seen together with calibrated cameras
            inconsistent: the other cameras contradict its boxes: wrong ids, time steps, intrinsics
            or images; the message says which
            ambiguous: two poses explain the boxes about as well
            undetermined: the boxes leave the pose open: too few, people who stay in one
            place or on one line, or two cameras alone without --baseline
  time steps  time steps at which it sees bodies together with calibrated cameras
  position, rotation  standard deviations relative to the reference camera (root mean square of the axes)
  residual  root mean square of the edges of boxes, pixels
  edges     the noise of the edges, a share of the half size of the boxes

Scale: the sizes of categories (--priors) tell it to within their spread, --baseline exactly. Without both the object that is seen
most is one unit high, and the result has no `length_unit`. People tell the vertical: the world has z upwards, and its origin on
the floor below the reference camera.

Examples:
  quadlift calibrate-rig hall.json -o rig.json
  quadlift calibrate-rig hall.json -o rig.json --baseline cam0,cam2,7.46
  quadlift calibrate-rig court.json -o rig.json --min-score 0.5 --drop-unposed

Exit codes: 0 success; 1 a file cannot be read or written, or no camera was calibrated; 2 wrong usage; 3 cameras
contradict each other."
)]
pub(crate) struct Args {
    /// A scene file with `cameras`, `frames` and `detections`
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    /// Output: the scene file with the poses
    #[arg(short, long, value_name = "OUT.json")]
    output: PathBuf,

    /// Calibrate cameras that have a pose, too
    #[arg(long)]
    include_posed: bool,

    /// Leave out frames without a pose and their detections, so that other commands read the result
    #[arg(long)]
    drop_unposed: bool,

    /// Distance between the centers of two cameras, by their ids; may be repeated
    #[arg(long, value_name = "CAM_A,CAM_B,LENGTH", value_parser = baseline)]
    baseline: Vec<Baseline>,

    /// Sizes of categories: builtin (meters), a TOML file, or none. With --baseline or given poses builtin is only used if the scene has
    /// the `length_unit` "m"
    #[arg(long, value_name = "FILE", default_value = "builtin")]
    priors: PathBuf,

    /// Categories whose bodies are upright; may be repeated [default: person, pedestrian, road vehicles and furniture of the built-in
    /// priors, and boxes without a category]
    #[arg(long, value_name = "CATEGORY")]
    upright: Vec<String>,

    /// Categories whose objects stay where they are; may be repeated
    #[arg(long = "static", value_name = "CATEGORY")]
    still: Vec<String>,

    /// Use only the detections of this source; required if the scene has several
    #[arg(long, value_name = "NAME")]
    source: Option<String>,

    /// Skip detections with a lower score, such as 0.5
    #[arg(long, value_name = "S", value_parser = args::finite)]
    min_score: Option<f64>,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,
}

/// A baseline between two cameras, by their ids.
#[derive(Debug, Clone)]
struct Baseline {
    cameras: [String; 2],
    length: f64,
}

fn baseline(text: &str) -> Result<Baseline, String> {
    let parts = text.rsplit_once(',').and_then(|(ids, length)| {
        let (a, b) = ids.split_once(',')?;
        Some(Baseline { cameras: [a.to_owned(), b.to_owned()], length: args::positive(length).ok()? })
    });
    parts.ok_or_else(|| "expected two ids of cameras and a length above 0: CAM_A,CAM_B,LENGTH".to_owned())
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    let inputs = Inputs { paths: vec![args.scene.clone()], several: false };
    check_result_name(&args.output, false)?;
    outputs(&inputs, &args.output)?;
    refuse_to_overwrite(&args.scene, &args.output)?;
    let mut file = read_scene_file(&args.scene).map_err(|error| with_hint(&args.scene, error))?;
    check_not_read(&args.output)?;
    let scene = file.to_rig(args.include_posed).map_err(|error| error.in_file(&args.scene))?;
    if scene.ids.len() < 2 {
        bail!("{}: there is {}; expected two or more", args.scene.display(), count(scene.ids.len(), "camera"));
    }
    let baselines = baselines(args, &scene)?;
    let unit_is_open = !scene.any_given() && baselines.is_empty();
    let sizes = match args.priors.as_os_str().to_str() {
        Some("none") => CategoryPriors::default(),
        Some("builtin") if unit_is_open || file.length_unit.as_deref() == Some("m") => builtin_priors(),
        Some("builtin") => CategoryPriors::default(),
        _ => read_priors(&args.priors)?,
    };
    // Meters are the unit of the built-in sizes; the unit of others, and of distances, is what the scene says.
    let builtin = unit_is_open && args.priors.as_os_str() == "builtin";
    let unit = if builtin { Some("m".to_owned()) } else { file.length_unit.clone() };
    let options = RigOptions { sizes, upright: args.upright.clone(), still: args.still.clone() };
    let rig = match scene.rig(args.source.as_deref(), args.min_score, &options) {
        Err(error @ SourceError::Several(_)) => bail!("{}: {error} (--source SOURCE)", args.scene.display()),
        found => found.with_context(|| args.scene.display().to_string())?,
    };
    warn_of_categories(args, &scene, out);
    let start = Instant::now();
    let found = calibrate_rig(&rig, &CalibrateOptions { baselines, seed: args.seed });
    out.detail(&format!("{} calibrated in {}", count(rig.cameras.len(), "camera"), duration(start.elapsed())));
    scene.write(&mut file, &found, unit.as_deref(), args.drop_unposed);
    move_paths(&mut file, &args.scene, &args.output)?;
    write_scene_file(&args.output, &file)?;
    let calibrated = found.cameras.iter().filter(|camera| camera.status == CameraStatus::Ok).count();
    let any_way = options.categories(scene.categories()).into_iter().zip(scene.categories());
    let any_way: Vec<&str> =
        any_way.filter(|(known, _)| !known.upright && !known.still).map(|(_, name)| name.as_str()).collect();
    let may_lie = args.upright.is_empty() && !any_way.is_empty();
    if may_lie {
        out.warning(&format!(
            "no prior for: {}; they may lie any way; if their bodies are upright, such as those of people and vehicles, name them with \
             --upright",
            some_of(&any_way)
        ));
    }
    let seen = found.cameras.iter().filter(|camera| camera.residual_px.is_some()).count();
    if calibrated == 0 && seen == 2 && found.scale != RigScale::Baselines {
        out.warning(
            "two cameras alone: a wrong focal length and bodies of another height explain each other; add a camera, or their distance \
             (--baseline CAM_A,CAM_B,LENGTH)",
        );
    }
    let posed = found.cameras.iter().filter(|camera| camera.status.has_pose()).count();
    let given = posed - calibrated;
    let kept = if given == 0 { String::new() } else { format!("; {given} had a pose") };
    out.report(&format!(
        "{HEADING}{}{HEADING:#}: calibrated {calibrated} of {} from {} at {}{kept}\n{}{}wrote {}\n",
        one_line(&args.scene.display().to_string()),
        count(found.cameras.len(), "camera"),
        counted_boxes(rig.boxes.len()),
        count(scene.time_steps(), "time step"),
        table(&scene.ids, &found, file.length_unit.as_deref()),
        world(&scene.ids, &found, file.length_unit.as_deref()),
        args.output.display()
    ))?;
    if calibrated > 0 && (args.drop_unposed || posed == found.cameras.len()) {
        let output = args.output.as_path();
        Next::default().command(["view".into(), output.into()], "look at them in the browser").tell(out)?;
    }
    let mut document = calibration_record(&scene.ids, &found);
    document["output"] = args.output.display().to_string().into();
    document["boxes"] = rig.boxes.len().into();
    document["time_steps"] = scene.time_steps().into();
    document["length_unit"] = file.length_unit.clone().into();
    out.document(&document)?;
    let failed = calibrated == 0 && given < found.cameras.len();
    Ok(match contradictions_in_words(&scene.ids, &found) {
        // Bodies of another shape contradict themselves.
        Some(_) if may_lie && any_way.len() == scene.categories().len() => Outcome::SomethingFailed,
        Some(words) => {
            out.error(&format!("{}: the cameras are inconsistent: {words}", args.scene.display()));
            Outcome::Inconsistent
        }
        None if failed => Outcome::SomethingFailed,
        None => Outcome::Fine,
    })
}

fn counted_boxes(boxes: usize) -> String {
    if boxes == 1 { "1 box".to_owned() } else { format!("{boxes} boxes") }
}

/// The distances that are known, by the numbers of the cameras.
fn baselines(args: &Args, scene: &RigScene) -> anyhow::Result<Vec<KnownBaseline>> {
    let mut found = Vec::new();
    for known in &args.baseline {
        let number = |id: &String| match scene.camera(id) {
            Some(camera) => Ok(camera),
            None => {
                let ids: Vec<&str> = scene.ids.iter().map(String::as_str).collect();
                usage(format!("--baseline: there is no camera \"{id}\"; the scene has {}", some_of(&ids)))
            }
        };
        let [a, b] = &known.cameras;
        let cameras = [number(a)?, number(b)?];
        if cameras[0] == cameras[1] {
            return usage(format!("--baseline names camera \"{a}\" twice; expected two cameras"));
        }
        found.push(KnownBaseline { cameras, length: known.length });
    }
    Ok(found)
}

/// Names categories of the options that no detection has.
fn warn_of_categories(args: &Args, scene: &RigScene, out: &Output) {
    for (option, names) in [("--upright", &args.upright), ("--static", &args.still)] {
        let is_there = |name: &String| scene.categories().iter().any(|known| known.eq_ignore_ascii_case(name));
        for name in names.iter().filter(|name| !is_there(name)) {
            out.warning(&format!("{option} {name}: no detection has this category"));
        }
    }
}

/// What is known of the world, a line for each.
fn world(ids: &[String], found: &Calibration, unit: Option<&str>) -> String {
    let mut lines = String::new();
    if let Some(reference) = found.reference.filter(|&camera| found.cameras[camera].status == CameraStatus::Ok) {
        let place = if found.vertical.is_some() { "z upwards, origin below" } else { "the frame of" };
        lines += &format!("world: {place} camera {}\n", one_line(&ids[reference]));
        lines += &match (found.scale, found.scale_sd) {
            (RigScale::Sizes, Some(sd)) => {
                format!(
                    "scale: from the sizes of categories, to within {:.0} % (--baseline CAM_A,CAM_B,LENGTH tells it exactly)\n",
                    100.0 * sd
                )
            }
            (RigScale::Baselines, _) => "scale: from --baseline\n".to_owned(),
            (RigScale::Arbitrary, _) => {
                "scale: arbitrary, the object that is seen most is 1 high (--baseline CAM_A,CAM_B,LENGTH tells it)\n"
                    .to_owned()
            }
            _ => String::new(),
        };
        if unit.is_none() && found.scale != RigScale::Arbitrary {
            lines += "the scene has no `length_unit`: that of the distances or sizes is meant\n";
        }
        lines += &match found.vertical {
            Some(vertical) => format!("up: to within {:.2} degrees\n", vertical.sd.to_degrees()),
            None => "up: not determined, no `up` is written\n".to_owned(),
        };
    }
    lines
}

fn table(ids: &[String], found: &Calibration, unit: Option<&str>) -> String {
    let position = with_unit("position", unit);
    let mut table =
        Table::new(["<camera", "<status", "time_steps", &position, "rotation [deg]", "residual [px]", "edges [%]"]);
    for (index, (id, camera)) in ids.iter().zip(&found.cameras).enumerate().take(MAX_ROWS) {
        let style = match camera.status {
            CameraStatus::Ok | CameraStatus::Given => GOOD,
            CameraStatus::Ambiguous | CameraStatus::Undetermined => WARNING,
            _ => BAD,
        };
        table.push(vec![
            Cell::from(id),
            Cell::styled(camera.status.name(), style),
            Cell::from(camera.time_steps.to_string()),
            Cell::from(position_of(camera, found.reference == Some(index))),
            Cell::from(camera.sds().map_or_else(String::new, |[sd, _]| format!("{:.2}", sd.to_degrees()))),
            Cell::from(camera.residual_px.map_or_else(String::new, |px| format!("{px:.1}"))),
            Cell::from(camera.edge_noise.map_or_else(String::new, |sd| format!("{:.1}", 100.0 * sd))),
        ]);
    }
    table.render() + &rest(ids.len(), "camera", "the result and --json list all")
}

fn position_of(camera: &CalibratedCamera, is_reference: bool) -> String {
    match (camera.sds(), is_reference && camera.status == CameraStatus::Ok) {
        (_, true) => "reference".to_owned(),
        (Some([_, sd]), _) => significant(sd, 2),
        (None, _) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_two_ids_and_a_length() {
        let known = baseline("cam a,cam b,2.5").unwrap();
        assert_eq!((known.cameras, known.length), (["cam a".to_owned(), "cam b".to_owned()], 2.5));
        for wrong in ["a,b", "a,2.5", "a,b,0", "a,b,-1", "a,b,x", ""] {
            assert!(baseline(wrong).is_err(), "{wrong}");
        }
    }
}

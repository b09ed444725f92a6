//! `quadlift relocalize`: the cameras of images from a map of objects.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail};
use clap::builder::RangedU64ValueParser;
use quadlift::nalgebra::{Unit, Vector3};
use quadlift::relocalize::{
    CameraHeight, CommonMistake, Gravity, LandmarkMap, LocateOptions, LocateStatus, LocatedImage, Relocalization,
};
use quadlift::scene::SourceError;
use quadlift_io::diagnosis::mistake_in_words;
use quadlift_io::guard::check_not_read;
use quadlift_io::relocalize::{FrameQuery, ObjectLandmarks, location_record, write_locations};
use quadlift_io::{SceneFile, read_scene_file, write_scene_file};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::args;
use crate::error::{Outcome, usage};
use crate::files::{Inputs, check_result_name, move_paths, outputs, refuse_to_overwrite, with_hint};
use crate::next::Next;
use crate::output::{BAD, GOOD, HEADING, Output, WARNING, one_line};
use crate::table::{Cell, MAX_ROWS, Table, rest, significant};
use crate::threads;
use crate::words::{count, duration, some_of, with_unit};

/// Locate images in a map of objects
///
/// For images without poses: their boxes are compared with the objects of a map, by category, size and place; ids and appearance are
/// not used. The result is the scene of the images with the poses that were found, each with its covariance, and with
/// the object ids of the map. Where several poses explain an image it gets none, and all of them are listed.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Columns:
  status    ok; ambiguous: several poses explain the boxes; no_pose: none explains them better than chance;
            too_few_objects: fewer than three boxes (two with gravity) of categories of the map;
            too_many_alike: hundreds of boxes may each show hundreds of objects;
            inconsistent: all images fit the map clearly better once a common mistake is corrected
  objects   boxes that the pose explains / boxes of the frame
  position, rotation  standard deviations (root mean square of the axes)
  evidence  log odds of the pose against boxes that come from nowhere (natural logarithm)

Examples:
  quadlift localize scene.json -o map.json
  quadlift relocalize map.json photos.json -o located.json
  quadlift relocalize map.json phone.json -o located.json --up-in-camera 0,-1,0

Exit codes: 0 success; 1 a file cannot be read or written, the map has no objects, or no frame was located; 2 wrong usage;
3 the images do not fit the map: another image size, focal length or format of boxes explains them clearly better."
)]
pub(crate) struct Args {
    /// The map: a result of `quadlift localize` or `quadlift stream --map`, or a scene file with true objects
    #[arg(value_name = "MAP.json")]
    map_file: PathBuf,

    /// A scene file; frames without `cam_from_world` are located
    #[arg(value_name = "QUERY.json")]
    query: PathBuf,

    /// Output: the scene file with the poses
    #[arg(short, long, value_name = "OUT.json")]
    output: PathBuf,

    /// Locate frames that have a pose, too
    #[arg(long)]
    include_posed: bool,

    /// Leave out frames without a pose and their detections, so that other commands read the result
    #[arg(long)]
    drop_unposed: bool,

    /// Use only the detections of this source; required if the scene has several
    #[arg(long, value_name = "NAME")]
    source: Option<String>,

    /// Skip detections with a lower score, such as 0.5
    #[arg(long, value_name = "S", value_parser = args::finite)]
    min_score: Option<f64>,

    /// Standard deviation of the edges of boxes, relative to their half size [default: that of the map, or 0.05]
    #[arg(long, value_name = "X", value_parser = args::positive)]
    edge_noise: Option<f64>,

    /// Upwards (against gravity) in the frames of all cameras: x right, y down, z forwards; needs `up` in the map
    #[arg(long, value_name = "X,Y,Z", value_parser = args::three_numbers, allow_hyphen_values = true)]
    up_in_camera: Option<[f64; 3]>,

    /// Standard deviation of that direction (and of `up_in_camera` of frames) in degrees
    #[arg(long, value_name = "DEG", value_parser = args::positive, default_value_t = 1.0)]
    up_sd: f64,

    /// Height of the cameras along `up` of the map, from the origin of the world, and its standard deviation
    #[arg(long, value_name = "HEIGHT,SD", value_parser = height, allow_hyphen_values = true)]
    camera_height: Option<[f64; 2]>,

    /// Keep the poses that were found although the images fit the map clearly better once a common mistake is corrected
    #[arg(long)]
    allow_inconsistent: bool,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,
}

/// Reads a height and its standard deviation.
fn height(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split_once(',').and_then(|(h, sd)| Some([args::finite(h).ok()?, args::positive(sd).ok()?]));
    numbers.ok_or_else(|| "expected two numbers HEIGHT,SD, the second one above 0".to_owned())
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    let inputs = Inputs { paths: vec![args.query.clone()], several: false };
    check_result_name(&args.output, false)?;
    outputs(&inputs, &args.output)?;
    refuse_to_overwrite(&args.map_file, &args.output)?;
    let read = |path: &Path| read_scene_file(path).map_err(|error| with_hint(path, error));
    let map_file = read(&args.map_file)?;
    let map = map_file.to_landmarks().map_err(|error| error.in_file(&args.map_file))?;
    if map.landmarks.is_empty() {
        bail!("{}: {}", args.map_file.display(), no_objects(&map));
    }
    let options = options(args, &map_file, &map)?;
    let mut file = read(&args.query)?;
    check_not_read(&args.output)?;
    let scene = file.to_queries(args.include_posed).map_err(|error| error.in_file(&args.query))?;
    let frames = match scene.queries(args.source.as_deref(), args.min_score) {
        Err(error @ SourceError::Several(_)) => bail!("{}: {error} (--source SOURCE)", args.query.display()),
        found => found.with_context(|| args.query.display().to_string())?,
    };
    if frames.is_empty() {
        bail!("{}: {}", args.query.display(), no_query_frames(scene.posed()));
    }
    let up = map_file.up.and_then(|up| Unit::try_new(Vector3::from(up), 1e-9));
    if up.is_none() && frames.iter().any(|frame| frame.up_in_camera.is_some()) {
        out.warning(&format!("`up_in_camera` of frames is not used: {} has no `up`", args.map_file.display()));
    }
    let start = Instant::now();
    let landmarks = LandmarkMap::new(map.landmarks.clone());
    let options_of = |frame: &FrameQuery| {
        let gravity = frame.up_in_camera.or(options.gravity.map(|known| known.up_in_camera)).zip(up);
        let sd = args.up_sd.to_radians();
        let gravity = gravity.map(|(up_in_camera, up_in_world)| Gravity { up_in_world, up_in_camera, sd });
        LocateOptions { gravity, ..options.clone() }
    };
    let relocalize = |frame: FrameQuery| {
        let located = landmarks.relocalize(&frame.query, &options_of(&frame));
        (frame, located)
    };
    let mut found: Vec<(FrameQuery, Relocalization)> = frames.into_par_iter().map(relocalize).collect();
    out.detail(&format!("{} located in {}", count(found.len(), "frame"), duration(start.elapsed())));
    let mistake = common_mistake(&landmarks, &found, options_of);
    if mistake.is_some() && !args.allow_inconsistent {
        let ok = found.iter_mut().map(|(_, located)| located).filter(|located| located.status == LocateStatus::Ok);
        ok.for_each(|located| located.status = LocateStatus::Inconsistent);
    }
    let ids: Vec<String> = found.iter().map(|(frame, _)| file.frames[frame.frame_index].id.clone()).collect();
    write_locations(&mut file, &map_file, &map, &found, args.drop_unposed);
    move_paths(&mut file, &args.query, &args.output)?;
    write_scene_file(&args.output, &file)?;
    let located = found.iter().filter(|(_, located)| located.status == LocateStatus::Ok).count();
    warn_of_categories(&map, &found, out);
    out.report(&format!(
        "{HEADING}{}{HEADING:#}: located {located} of {} in {}{}\n{}wrote {}\n",
        one_line(&args.query.display().to_string()),
        count(found.len(), "frame"),
        count(map.landmarks.len(), "object"),
        in_words(scene.posed()),
        table(&ids, &found, map_file.length_unit.as_deref()),
        args.output.display()
    ))?;
    if located > 0 && (args.drop_unposed || located == found.len()) {
        let words = ["view".into(), args.output.as_path().into()];
        Next::default().command(words, "look at the cameras in the map").tell(out)?;
    }
    let mut document = document(args, &ids, &found, &map, &options);
    document["mistake"] = mistake.map_or(Value::Null, |mistake| mistake_record(&mistake));
    out.document(&document)?;
    Ok(match mistake {
        Some(mistake) => {
            let text = format!("{}: {}", args.query.display(), common_mistake_in_words(&mistake));
            if args.allow_inconsistent {
                out.warning(&text);
                Outcome::Fine
            } else {
                out.error(&text);
                Outcome::Inconsistent
            }
        }
        None if located == 0 => Outcome::SomethingFailed,
        None => Outcome::Fine,
    })
}

/// A mistake that all frames have in common. Frames that cannot be sought say nothing.
fn common_mistake<'a>(
    map: &LandmarkMap,
    found: &'a [(FrameQuery, Relocalization)],
    options_of: impl Fn(&FrameQuery) -> LocateOptions,
) -> Option<CommonMistake> {
    let says_nothing = |status| matches!(status, LocateStatus::TooFewObjects | LocateStatus::TooManyAlike);
    let sought = found.iter().filter(|(_, located)| !says_nothing(located.status));
    let image = |(frame, located): &'a (FrameQuery, Relocalization)| LocatedImage {
        query: &frame.query,
        options: options_of(frame),
        located,
    };
    map.common_mistake(&sought.map(image).collect::<Vec<_>>())
}

fn common_mistake_in_words(mistake: &CommonMistake) -> String {
    let correction = mistake.correction;
    format!(
        "the images do not fit the map: {} (evidence {:.0}, {:.0} after correction)",
        mistake_in_words(correction.cause(), correction.value(), Some(correction)),
        mistake.evidence,
        mistake.corrected_evidence
    )
}

fn mistake_record(mistake: &CommonMistake) -> Value {
    json!({
        "name": mistake.correction.cause().name(),
        "value": mistake.correction.value(),
        "evidence": mistake.evidence,
        "corrected_evidence": mistake.corrected_evidence,
    })
}

/// The options of all frames; the direction of gravity may be that of a frame.
fn options(args: &Args, map_file: &SceneFile, map: &ObjectLandmarks) -> anyhow::Result<LocateOptions> {
    let up = map_file.up.and_then(|up| Unit::try_new(Vector3::from(up), 1e-9));
    let needs_up = |option: &str| format!("{option} needs the direction `up` in {}", args.map_file.display());
    let gravity = match args.up_in_camera.map(|direction| (Unit::try_new(Vector3::from(direction), 1e-9), up)) {
        None => None,
        Some((None, _)) => {
            return usage("--up-in-camera is not a direction; expected three numbers that are not all 0");
        }
        Some((_, None)) => bail!(needs_up("--up-in-camera")),
        Some((Some(up_in_camera), Some(up_in_world))) => {
            Some(Gravity { up_in_world, up_in_camera, sd: args.up_sd.to_radians() })
        }
    };
    let height = match (args.camera_height, up) {
        (None, _) => None,
        (Some(_), None) => bail!(needs_up("--camera-height")),
        (Some([height, sd]), Some(up_in_world)) => Some(CameraHeight { up_in_world, height, sd }),
    };
    let noise = match args.edge_noise {
        Some(edge_noise) => LocateOptions { edge_noise, ..Default::default() },
        None => map_file
            .noise_levels()
            .map_or_else(|_| Default::default(), |noise| LocateOptions::with_noise(&noise, &map.landmarks)),
    };
    Ok(LocateOptions { gravity, height, ..noise })
}

fn no_objects(map: &ObjectLandmarks) -> String {
    match map.left_out {
        0 => "there are no objects; expected a result of `quadlift localize`".to_owned(),
        n => format!("none of {} was localized; expected a map with bodies", count(n, "object")),
    }
}

fn no_query_frames(posed: usize) -> String {
    match posed {
        0 => "there are no frames".to_owned(),
        n => format!("all {} have a pose (--include-posed locates those with a camera again)", count(n, "frame")),
    }
}

fn in_words(posed: usize) -> String {
    if posed == 0 { String::new() } else { format!("; {} had a pose", count(posed, "frame")) }
}

/// Names categories of the images that are not in the map.
fn warn_of_categories(map: &ObjectLandmarks, found: &[(FrameQuery, Relocalization)], out: &Output) {
    if map.landmarks.iter().any(|landmark| landmark.category.is_none()) {
        return;
    }
    let known: std::collections::BTreeSet<&str> = map.landmarks.iter().filter_map(|l| l.category.as_deref()).collect();
    let used = found.iter().flat_map(|(frame, _)| &frame.query.boxes).filter_map(|b| b.category.as_deref());
    let unknown: std::collections::BTreeSet<&str> = used.filter(|name| !known.contains(name)).collect();
    if !unknown.is_empty() {
        let names: Vec<&str> = unknown.into_iter().collect();
        out.warning(&format!("no object of the map has the category {}", some_of(&names)));
    }
}

fn table(ids: &[String], found: &[(FrameQuery, Relocalization)], unit: Option<&str>) -> String {
    let position = with_unit("position", unit);
    let mut table = Table::new(["<frame", "<status", "objects", &position, "rotation [deg]", "evidence"]);
    for (id, (frame, located)) in ids.iter().zip(found).take(MAX_ROWS) {
        let style = match located.status {
            LocateStatus::Ok => GOOD,
            LocateStatus::Ambiguous => WARNING,
            _ => BAD,
        };
        let best = located.poses.first();
        let sds = best.filter(|_| located.status == LocateStatus::Ok).map(|pose| pose.sds());
        table.push(vec![
            Cell::from(id),
            Cell::styled(located.status.name(), style),
            Cell::from(format!("{}/{}", best.map_or(0, |pose| pose.matches.len()), frame.query.boxes.len())),
            Cell::from(sds.map_or_else(String::new, |[_, sd]| significant(sd, 2))),
            Cell::from(sds.map_or_else(String::new, |[sd, _]| format!("{:.2}", sd.to_degrees()))),
            Cell::from(best.map_or_else(String::new, |pose| format!("{:.1}", pose.evidence))),
        ]);
    }
    table.render() + &rest(found.len(), "frame", "the result and --json list all")
}

fn document(
    args: &Args,
    ids: &[String],
    found: &[(FrameQuery, Relocalization)],
    map: &ObjectLandmarks,
    options: &LocateOptions,
) -> Value {
    let frame = |(id, (frame, located)): (&String, &(FrameQuery, Relocalization))| {
        let mut record = location_record(frame, located, map);
        record["frame"] = id.as_str().into();
        record["boxes"] = frame.query.boxes.len().into();
        if let (LocateStatus::Ok, Some(best)) = (located.status, located.poses.first()) {
            let rows: Vec<Vec<f64>> =
                best.cam_from_world.matrix().row_iter().map(|r| r.iter().copied().collect()).collect();
            record["cam_from_world"] = json!(rows);
        }
        record
    };
    json!({
        "output": args.output.display().to_string(),
        "objects": map.landmarks.len(),
        "edge_noise": options.edge_noise,
        "edge_noise_px": options.edge_noise_px,
        "frames": ids.iter().zip(found).map(frame).collect::<Vec<_>>(),
    })
}

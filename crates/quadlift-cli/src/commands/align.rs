//! `quadlift align`: two maps of one place, brought together by their objects.

mod merged;
mod words;

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::builder::RangedU64ValueParser;
use quadlift::align::{AlignOptions, AlignStatus};
use quadlift_io::align::{MapObjects, MapScale, align_checked, alignment_record, options_of};
use quadlift_io::guard::check_not_read;
use quadlift_io::{SceneFile, read_scene_file};
use serde_json::json;

use crate::args;
use crate::error::Outcome;
use crate::files::{Inputs, check_result_name, outputs, refuse_to_overwrite, with_hint};
use crate::next::Next;
use crate::output::{HEADING, Output, one_line};
use crate::threads;
use crate::words::duration;

/// Align two object maps and merge them
///
/// For maps of one place that were made apart, also from opposite sides: categories, sizes and distances of objects are compared; ids,
/// images and appearance are not used. Objects of one map may be missing in the other one. With -o the maps become one, in the frame
/// of A.json: objects that are in both have one id, and are localized from the detections of both where the files have them.
/// Where the objects do not decide how the maps lie, nothing is written.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift align north.json south.json
  quadlift align north.json south.json -o house.json
  quadlift align sfm.json lidar.json --similarity --no-up

Exit codes: 0 success; 1 a file cannot be read or written, or the maps were not aligned; 2 wrong usage; 3 the maps were not aligned because
units or `up` contradict the objects, or the detections of the merged map contradict each other (--allow-inconsistent continues)."
)]
pub(crate) struct Args {
    /// The first map: a result of `quadlift localize` or `quadlift stream --map`, or a scene file with true objects
    #[arg(value_name = "A.json")]
    a: PathBuf,

    /// The second map, which is moved
    #[arg(value_name = "B.json")]
    b: PathBuf,

    /// Output: the merged map, in the frame of A.json
    #[arg(short, long, value_name = "MERGED.json")]
    output: Option<PathBuf>,

    /// The maps have one scale (up to their units) [default where both have a known `length_unit`]
    #[arg(long, conflicts_with = "similarity")]
    rigid: bool,

    /// Estimate the scale, too [default where a unit is not known]
    #[arg(long)]
    similarity: bool,

    /// Do not use `up` of the files; by default it is used where both have it
    #[arg(long)]
    no_up: bool,

    /// Standard deviation of the angle between the two `up` in degrees
    #[arg(long, value_name = "DEG", value_parser = args::positive, default_value_t = 2.0)]
    up_sd: f64,

    /// Localize the merged map with the detections of this source; required if the files have several
    #[arg(long, value_name = "NAME", requires = "output")]
    source: Option<String>,

    /// Continue where the detections of the merged map contradict each other
    #[arg(long, requires = "output")]
    allow_inconsistent: bool,

    /// Number of threads [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,
}

/// A map, read.
struct Map {
    file: SceneFile,
    objects: MapObjects,
}

impl Map {
    fn read(path: &Path) -> anyhow::Result<Self> {
        let file = read_scene_file(path).map_err(|error| with_hint(path, error))?;
        let objects = file.to_map_objects().map_err(|error| error.in_file(path))?;
        Ok(Self { file, objects })
    }
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    if let Some(output) = &args.output {
        check_result_name(output, true)?;
        outputs(&Inputs { paths: vec![args.a.clone()], several: false }, output)?;
        refuse_to_overwrite(&args.b, output)?;
    }
    let [a, b] = [Map::read(&args.a)?, Map::read(&args.b)?];
    args.output.as_deref().map_or(Ok(()), check_not_read)?;
    let options = options(args, &a, &b);
    let start = Instant::now();
    let (found, contradiction) = align_checked(&a.objects, &b.objects, &options);
    out.detail(&format!("aligned in {}", duration(start.elapsed())));
    let title = format!("{HEADING}{}{HEADING:#}", one_line(&format!("{}, {}", args.a.display(), args.b.display())));
    let maps = [&a.objects, &b.objects];
    let mut document = json!({
        "a": args.a.display().to_string(),
        "b": args.b.display().to_string(),
        "known_scale": options.scale,
        "used_up": options.up.is_some(),
        "alignment": alignment_record(&found, maps),
    });
    let about = words::assumptions(args, [&a, &b], &options);
    let (AlignStatus::Ok, Some(best)) = (found.status, found.transforms.first()) else {
        let why = words::refused(&found, maps, options.up.is_some(), contradiction.as_ref());
        out.report(&format!("{title}: not aligned\n{about}{}", words::candidates(&found)))?;
        out.error(&why);
        document["reason"] = why.into();
        out.document(&document)?;
        return Ok(if contradiction.is_some() { Outcome::Inconsistent } else { Outcome::SomethingFailed });
    };
    contradiction.iter().for_each(|contradiction| out.warning(&words::contradiction(contradiction, true)));
    let mut text = words::aligned(&title, best, [&a, &b], &options, &about);
    let mut outcome = Outcome::Fine;
    if let Some(output) = &args.output {
        let record = alignment_record(&found, maps);
        let merged = merged::write(args, output, [&a, &b], best, record, out)?;
        text.push_str(&merged.text);
        document["merged"] = merged.document;
        outcome = merged.outcome;
    }
    out.report(&text)?;
    if let Some(output) = args.output.as_deref().filter(|_| outcome == Outcome::Fine) {
        Next::default().command(["view".into(), output.into()], "look at the merged map").tell(out)?;
    }
    out.document(&document)?;
    Ok(outcome)
}

fn options(args: &Args, a: &Map, b: &Map) -> AlignOptions {
    let scale = match (args.rigid, args.similarity) {
        (true, _) => MapScale::Rigid,
        (_, true) => MapScale::Estimated,
        _ => MapScale::OfUnits,
    };
    options_of(&a.file, &b.file, scale, (!args.no_up).then_some(args.up_sd.to_radians()))
}

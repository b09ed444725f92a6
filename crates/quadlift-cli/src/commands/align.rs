//! `quadlift align`: two maps of one place, brought together by their objects.

mod merged;
mod words;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;
use clap::builder::RangedU64ValueParser;
use quadlift::align::{AlignOptions, AlignStatus, Alignment, CommonUp, align};
use quadlift::nalgebra::{Unit, Vector3};
use quadlift_io::align::{MapObjects, alignment_record, scale_of_units};
use quadlift_io::guard::check_not_read;
use quadlift_io::{SceneFile, read_scene_file};
use serde_json::json;

use crate::args;
use crate::error::Outcome;
use crate::files::{Inputs, check_result_name, outputs, refuse_to_overwrite, with_hint};
use crate::next::Next;
use crate::output::{HEADING, Output, one_line};
use crate::words::duration;

/// Align two maps by their objects, and merge them
///
/// For maps of one place that were made apart, also from opposite sides: categories, sizes and distances of objects are compared; ids,
/// images and appearance are not used. Objects of one map may be missing in the other one. With -o the maps become one, in the frame
/// of A.json: objects that are in both have one id, and are localised from the detections of both where the files have them.
/// Where the objects do not decide how the maps lie, nothing is written.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift align north.json south.json
  quadlift align north.json south.json -o house.json
  quadlift align sfm.json lidar.json --similarity --no-up

Exit codes: 0 success; 1 a file cannot be read or written, or the maps were not aligned; 2 wrong usage; 3 the detections of the merged map
contradict each other (--accept-inconsistent continues)."
)]
pub struct Args {
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

    /// Localise the merged map with the detections of this source; required if the files have several
    #[arg(long, value_name = "NAME", requires = "output")]
    source: Option<String>,

    /// Continue where the detections of the merged map contradict each other
    #[arg(long, requires = "output")]
    accept_inconsistent: bool,

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

    fn up(&self) -> Option<Unit<Vector3<f64>>> {
        self.file.up.and_then(|up| Unit::try_new(Vector3::from(up), 1e-9))
    }
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    if let Some(threads) = args.threads {
        // Before anything else: the first call of the library starts the threads.
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start the threads")?;
    }
    if let Some(output) = &args.output {
        check_result_name(output, true)?;
        outputs(&Inputs { paths: vec![args.a.clone()], several: false }, output)?;
        refuse_to_overwrite(&args.b, output)?;
    }
    let [a, b] = [Map::read(&args.a)?, Map::read(&args.b)?];
    args.output.as_deref().map_or(Ok(()), check_not_read)?;
    let options = options(args, &a, &b);
    let start = Instant::now();
    let mut found = align(&a.objects.objects, &b.objects.objects, &options);
    let hint = other_assumptions(&a, &b, &options, &mut found);
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
        let why = words::refused(&found, maps, options.up.is_some(), hint.as_deref());
        out.report(&format!("{title}: not aligned\n{about}{}", words::candidates(&found)))?;
        out.error(&why);
        document["reason"] = why.into();
        out.document(&document)?;
        return Ok(Outcome::SomethingFailed);
    };
    hint.iter().for_each(|hint| out.warning(hint));
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
    let of_units = scale_of_units(&a.file, &b.file);
    let scale = if args.similarity { None } else { of_units.or(args.rigid.then_some(1.0)) };
    let up = a.up().zip(b.up()).filter(|_| !args.no_up);
    let sd = args.up_sd.to_radians();
    AlignOptions { scale, up: up.map(|(up_in_a, up_in_b)| CommonUp { up_in_a, up_in_b, sd }) }
}

/// Standard deviations and least difference of logarithms from which a scale contradicts the known one, and the difference from which the
/// maps are not aligned at all.
const DEVIATIONS: f64 = 3.0;
const LEAST_DIFFERENCE: f64 = 0.01;
const WRONG_SCALE: f64 = 0.03;

/// Difference of the evidence of a free scale from which a known one is wrong: odds of 100 to 1.
const CLEAR: f64 = 4.605;

/// What the objects say without the assumptions: whether the known scale is right, and whether the maps can be aligned without the scale or
/// `up`. Maps whose objects contradict the known scale are not aligned.
fn other_assumptions(a: &Map, b: &Map, options: &AlignOptions, found: &mut Alignment) -> Option<String> {
    let with = |options: AlignOptions| align(&a.objects.objects, &b.objects.objects, &options);
    let is_found = |found: &Alignment| found.status == AlignStatus::Ok;
    if let Some(known) = options.scale {
        let free = with(AlignOptions { scale: None, ..*options });
        if let (true, Some(best)) = (is_found(&free), free.transforms.first()) {
            let off = (best.a_from_b.scale / known).ln();
            let contradicts = off.abs() > LEAST_DIFFERENCE.max(DEVIATIONS * best.sds()[2]);
            let words = format!(
                "by the objects a unit of B is {:.4} units of A (sd {:.1} %), not {known}",
                best.a_from_b.scale,
                100.0 * best.sds()[2]
            );
            let evidence = found.transforms.first().map_or(f64::NEG_INFINITY, |best| best.evidence);
            let is_wrong = off.abs() > WRONG_SCALE && best.evidence > evidence + CLEAR;
            if contradicts && (is_wrong || !is_found(found)) {
                found.status = AlignStatus::NoAlignment;
                return Some(format!("{words}: check the units, or --similarity takes the scale of the objects"));
            }
            if contradicts {
                return Some(format!("{words}; the known scale was kept (--similarity estimates it)"));
            }
        }
    }
    if is_found(found) || options.up.is_none() {
        return None;
    }
    let without = with(AlignOptions { up: None, ..*options });
    is_found(&without).then(|| "without `up` of the files the maps are aligned (--no-up): check both `up`".to_owned())
}

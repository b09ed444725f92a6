//! `compare A B`: paired differences between two programs, or two settings of one, on a fixed list of scenes.
//!
//! Every scene is localized by both programs, in turn and with one thread. A value of an object (or of a scene) is its mean over the
//! seeds, and a row has the mean of the differences of these values with its standard error: differences that both programs share,
//! between easy and hard objects, cancel.

mod paired;
mod program;
pub(crate) mod scoring;
pub(crate) mod sets;
mod turn;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::bail;
use indicatif::ProgressBar;
use quadlift_io::write_scene_file;
use serde_json::{Value, json};

use crate::data::data_folder;
use crate::error::Error;
use crate::table::{Cell, Table};
use paired::Paired;
use program::Program;
use scoring::{Measured, score};
use sets::{Overlap, SceneCase, Set};
use turn::turned;

/// Options of the comparison.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
A and B are paths of quadlift programs. In quotes, options for `quadlift localize` may follow the path: they replace those of a set.

Rows: body IoU of the true objects (0 for a missing one), coverage of the 95 % region of the body, F1 of the association where
detections have no ids, processor time of a run in seconds. IoU is O3D as in docs/results.md for real sets (of the enclosing
ellipsoid for LINEMOD), and that of the bodies of their own kind for synthetic ones. Coverage counts the objects that have a region
in both. An asterisk marks a difference of more than two standard errors; of 20 rows without a true difference one has it by chance.
Every seed turns the world of each scene at random: real objects lie along the axes of their worlds, from which no program may gain.
Sets: all views of the real scenes, the first 150 frames of the videos of KITTI tracking, and synthetic scenes.

Examples:
  quadlift-bench compare old/quadlift target/release/quadlift
  quadlift-bench compare target/release/quadlift \"target/release/quadlift --body ellipsoid\" --json

Exit codes: 0 done; 1 a program cannot be run or does not know an option, or a file cannot be read; 2 wrong usage."
)]
pub struct Args {
    /// The program to compare with, or its path and options in quotes
    #[arg(value_name = "A")]
    a: String,

    /// The program or setting that is to be judged
    #[arg(value_name = "B")]
    b: String,

    /// Folder of the real data, which contains `scenes` (default: QUADLIFT_DATA, or ../shared/data)
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Number of seeds: of the turns of the worlds, and of the scenes of each synthetic set
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100))]
    seeds: u64,

    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// The sums of one value of an object or a scene: A, B and the number of seeds with both.
#[derive(Default)]
struct Sums {
    a: f64,
    b: f64,
    count: u32,
}

/// What identifies a value: set, measure, and scene with object.
type Key = (usize, Measured, String);

/// Runs the comparison; the text to print.
///
/// # Errors
/// The data is not there, a program cannot be run or rejects its options, a result cannot be read.
pub fn run(args: &Args) -> anyhow::Result<String> {
    let programs = [Program::parse(&args.a)?, Program::parse(&args.b)?];
    let (mut sets, note) = match data_folder(args.data.as_deref()) {
        Ok(folder) => (sets::real(&folder)?, String::new()),
        Err(error @ Error::NoData(_)) if args.data.is_some() => bail!(error),
        Err(Error::NoData(folder)) => {
            (Vec::new(), format!("No real data in {}: synthetic sets only.\n", folder.display()))
        }
        Err(error) => bail!(error),
    };
    sets.extend(sets::synthetic(args.seeds)?);
    let folder = tempfile::tempdir()?;
    let (mut values, mut failed) = (BTreeMap::<Key, Sums>::new(), [0_usize; 2]);
    let bar = ProgressBar::new(sets.iter().map(|set| set.scenes.len() as u64 * args.seeds).sum());
    for (set_index, set) in sets.iter().enumerate() {
        for scene in &set.scenes {
            let input = folder.path().join("scene.json");
            for seed in 0..args.seeds {
                let scene = turned(scene, seed);
                write_scene_file(&input, &scene.input)?;
                let scored = compare_once(&programs, set, &scene, &input, folder.path(), seed)?;
                for (failed, scored) in failed.iter_mut().zip(&scored) {
                    *failed += usize::from(scored.failed);
                }
                let [a, b] = scored;
                for (key, a) in a.values {
                    let Some(b) = b.values.get(&key) else { continue };
                    let (measured, unit) = key;
                    let sums = values.entry((set_index, measured, format!("{}/{unit}", scene.name))).or_default();
                    (sums.a, sums.b, sums.count) = (sums.a + a, sums.b + b, sums.count + 1);
                }
                bar.inc(1);
            }
        }
    }
    bar.finish_and_clear();
    let rows = rows(&sets, &values);
    Ok(if args.json {
        format!("{}\n", document(args, &rows, failed))
    } else {
        format!("{note}{}", text(args, &rows, failed))
    })
}

/// Runs both programs on a scene, the second one first every other time, so that neither always finds a warm machine.
fn compare_once(
    programs: &[Program; 2],
    set: &Set,
    scene: &SceneCase,
    input: &Path,
    folder: &Path,
    seed: u64,
) -> anyhow::Result<[scoring::Scored; 2]> {
    let output = folder.join("result.json");
    let mut options = set.options.clone();
    if set.overlap == Overlap::Enclosing {
        options.push("--enclosing");
    }
    let once = |program: &Program| score(set, scene, &program.localize(input, &output, &options)?);
    let [a, b] = programs;
    Ok(if seed.is_multiple_of(2) {
        let first = once(a)?;
        [first, once(b)?]
    } else {
        let second = once(b)?;
        [once(a)?, second]
    })
}

/// A row of the table.
struct Row {
    set: String,
    measured: Measured,
    paired: Paired,
}

/// The rows of every set, then those of all real, all synthetic and all sets together.
fn rows(sets: &[Set], values: &BTreeMap<Key, Sums>) -> Vec<Row> {
    let of = |name: &str, chosen: &dyn Fn(&Set) -> bool| -> Vec<Row> {
        let row = |measured: Measured| {
            let of_row = values.iter().filter(|((set, other, _), _)| *other == measured && chosen(&sets[*set]));
            let pairs = of_row.map(|(_, sums)| [sums.a, sums.b].map(|sum| sum / f64::from(sums.count)));
            let paired = Paired::of(&pairs.collect::<Vec<_>>())?;
            Some(Row { set: name.to_owned(), measured, paired })
        };
        Measured::ALL.into_iter().filter_map(row).collect()
    };
    let mut rows: Vec<Row> = sets.iter().flat_map(|set| of(&set.name, &|other| other.name == set.name)).collect();
    rows.extend(of("all real", &|set| set.is_real));
    rows.extend(of("all synthetic", &|set| !set.is_real));
    rows.extend(of("all", &|_| true));
    rows
}

fn text(args: &Args, rows: &[Row], failed: [usize; 2]) -> String {
    let title = format!("B minus A\n  A: {}\n  B: {}\n", args.a, args.b);
    let mut table = Table::new(title, ["set", "measure", "number", "A", "B", "B - A", "s.e.", ""]);
    for Row { set, measured, paired } in rows {
        let decimals = 4;
        table.push(vec![
            set.as_str().into(),
            measured.name().into(),
            Cell::number(paired.count as f64, 0),
            Cell::number(paired.a, decimals),
            Cell::number(paired.b, decimals),
            format!("{:+.decimals$}", paired.difference).into(),
            paired.standard_error.map_or(Cell::Empty, |error| Cell::number(error, decimals)),
            if paired.is_marked() { "*" } else { "" }.into(),
        ]);
    }
    table.note(
        "* more than two standard errors. Number: objects; for F1 and time scenes. IoU of a missing object is 0.",
    );
    let [a, b] = failed;
    table.note(format!("Runs without a result: A {a}, B {b}."));
    table.to_text()
}

fn document(args: &Args, rows: &[Row], [a, b]: [usize; 2]) -> Value {
    let row = |Row { set, measured, paired }: &Row| {
        json!({
            "set": set,
            "measure": measured.name(),
            "number": paired.count,
            "a": paired.a,
            "b": paired.b,
            "difference": paired.difference,
            "standard_error": paired.standard_error,
            "marked": paired.is_marked(),
        })
    };
    json!({
        "a": args.a,
        "b": args.b,
        "seeds": args.seeds,
        "failed_runs": { "a": a, "b": b },
        "rows": rows.iter().map(row).collect::<Vec<_>>(),
    })
}

//! `quadlift export`: objects and cameras of a scene file in the formats of other programs.

mod cameras;
mod formats;
mod rerun;
mod tables;

use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift_io::write::csv::{objects_csv, views_csv};
use quadlift_io::write::{CheckedScene, Document};
use quadlift_io::{SceneFile, read_scene_file, write_file};
use serde_json::json;

use crate::error::{Outcome, usage};
use crate::files::{check_file, refuse_to_overwrite};
use crate::output::{Output, one_line};
use crate::words::{count, some_of};
use formats::Format;

/// Export objects and cameras to other formats
///
/// Exports estimated and true objects alike. Objects without a body are skipped (except in CSV and Parquet) and
/// counted. Conversions, assumptions and losses are printed.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  quadlift export ply objects.json -o objects.ply
  quadlift export glb objects.json -o objects.glb --enclosing
  quadlift export csv objects.json -o objects.csv --views residuals.csv
  quadlift export parquet objects.json -o objects/
  quadlift export kitti objects.json -o 0001.txt --calib training/calib/0001.txt
  quadlift export bop objects.json -o results.csv --scene-id 5
  quadlift export boxer objects.json -o boxer_3dbbs.csv --only-detected
  quadlift export coco objects.json -o annotations.json
  quadlift export geojson objects.json -o objects.geojson --origin 48.2,16.37,170
  quadlift export tum objects.json -o trajectory.txt
  quadlift export colmap objects.json -o sparse/
  quadlift export mcap objects.json -o objects.mcap
  quadlift export ros objects.json -o detections.json --frame-id map
  quadlift export rerun scene.json objects.json -o recording/

Exit codes: 0 the file was written; 1 a file could not be read or written, or there was nothing to write; 2 wrong usage."
)]
pub struct Args {
    #[command(subcommand)]
    format: Format,
}

/// Options of every format.
#[derive(clap::Args)]
pub struct Common {
    /// The scene file
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    /// Output path
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    match &args.format {
        Format::Tum { common, camera } => cameras::tum(common, camera.as_deref(), out),
        Format::Colmap { common } => cameras::colmap(common, out),
        Format::Parquet { common } => tables::run(common, out),
        Format::Rerun(args) => rerun::run(args, out),
        Format::Csv { common, views } => {
            let paths: Vec<&Path> =
                [Some(&common.output), views.as_ref()].into_iter().flatten().map(PathBuf::as_path).collect();
            let file = read(common, &paths)?;
            let objects = objects_csv(&file).map_err(|error| error.in_file(&common.scene))?;
            finish(out, &[objects, views_csv(&file)], &paths, &[])
        }
        Format::Bodies(format) => {
            let common = format.common();
            let paths = [common.output.as_path()];
            let file = read(common, &paths)?;
            let scene = CheckedScene::new(&file, format.choice()).map_err(|error| error.in_file(&common.scene))?;
            if scene.bodies() == 0 {
                bail!("{}: no object has a body: there is nothing to export", common.scene.display());
            }
            finish(out, &[format.document(&scene)?], &paths, scene.without_body())
        }
    }
}

/// Reads the scene, after checking that the files can be written. A scene without objects is rejected: an empty file
/// would look like a result.
fn read(common: &Common, outputs: &[&Path]) -> anyhow::Result<SceneFile> {
    for (index, path) in outputs.iter().enumerate() {
        check_file(path)?;
        refuse_to_overwrite(&common.scene, path)?;
        if outputs[..index].contains(path) {
            return usage(format!("two tables would be named {}", path.display()));
        }
    }
    let file = read_scene_file(&common.scene)?;
    if file.objects.is_empty() {
        bail!("{}: the file holds no \"objects\": there is nothing to export", common.scene.display());
    }
    Ok(file)
}

/// Writes the documents that have a path, and reports them.
fn finish(out: &Output, documents: &[Document], paths: &[&Path], without_body: &[String]) -> anyhow::Result<Outcome> {
    for (document, path) in documents.iter().zip(paths) {
        write_file(path, |out| out.write_all(&document.content))?;
    }
    let written = documents.iter().zip(paths).map(|(d, path)| (*path, d.counts.as_slice(), d.notes.as_slice()));
    tell(out, written, without_body)
}

/// Reports what was written: path, counts and notes of each.
fn tell<'a>(
    out: &Output,
    written: impl Iterator<Item = (&'a Path, &'a [(&'a str, usize)], &'a [String])>,
    without_body: &[String],
) -> anyhow::Result<Outcome> {
    let mut text = String::new();
    let mut files = Vec::new();
    for (path, counts, notes) in written {
        text.push_str(&wrote(path, counts));
        notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
        files.push(entry(path, counts, notes));
    }
    if !without_body.is_empty() {
        let objects = count(without_body.len(), "object");
        text.push_str(&format!("- skipped without a body: {objects} ({})\n", one_line(&some_of(without_body))));
    }
    out.report(&text)?;
    out.document(&json!({ "files": files, "without_body": without_body }))?;
    Ok(Outcome::Fine)
}

/// "wrote objects.ply: 3 objects, 20 cameras".
fn wrote(path: &Path, counts: &[(&str, usize)]) -> String {
    let counts: Vec<String> = counts.iter().map(|(name, n)| words_of(*n, name)).collect();
    format!("wrote {}: {}\n", path.display(), counts.join(", "))
}

/// A number of things whose name may end with an x.
fn words_of(n: usize, singular: &str) -> String {
    if singular.ends_with('x') && n != 1 { format!("{n} {singular}es") } else { count(n, singular) }
}

/// What the JSON document says about a file.
fn entry(path: &Path, counts: &[(&str, usize)], notes: &[String]) -> serde_json::Value {
    let counts: serde_json::Map<_, _> = counts.iter().map(|(name, n)| ((*name).to_owned(), json!(n))).collect();
    json!({ "output": path.display().to_string(), "counts": counts, "notes": notes })
}

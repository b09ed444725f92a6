//! `quadlift export`: objects and cameras of a scene file in the formats of other programs.

mod rerun;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::error::ErrorKind;
use clap::{ArgMatches, FromArgMatches};
use quadlift_io::write::{BodyChoice, CheckedScene, Document, EXPORTS, ExportFormat, WRITE, WriteOptions, Writer};
use quadlift_io::{EntryError, SceneFile, read_scene_file, write_file};
use quadlift_report::Labels;
use serde_json::json;

use crate::error::{Outcome, usage};
use crate::files::{check_file, refuse_to_overwrite};
use crate::output::{Output, one_line};
use crate::reading::{Given, arguments};
use crate::words::{count, some_of};

const ABOUT: &str = "Export objects and cameras to other formats";

const LONG_ABOUT: &str = "\
Export objects and cameras to other formats

Exports estimated and true objects alike. Objects without a body are skipped (except in CSV) and counted.
Conversions, assumptions and losses are printed.";

const AFTER: &str = "\
Examples:
  quadlift export ply objects.json -o objects.ply
  quadlift export glb objects.json -o objects.glb --enclosing
  quadlift export csv objects.json -o objects.csv --views residuals.csv
  quadlift export kitti objects.json -o 0001.txt --calib training/calib/0001.txt
  quadlift export geojson objects.json -o objects.geojson --origin 48.2,16.37,170
  quadlift export colmap objects.json -o sparse/
  quadlift export rerun scene.json objects.json -o recording/

Exit codes: 0 the file was written; 1 a file could not be read or written, or there was nothing to write; 2 wrong usage.";

/// A format and its output.
pub(crate) enum Args {
    /// A row of the table.
    Of(&'static ExportFormat, Common, Given<WriteOptions>),
    /// Rerun.
    Rerun(rerun::Args),
}

/// Options of every format.
#[derive(clap::Args)]
pub(crate) struct Common {
    /// The scene file
    #[arg(value_name = "SCENE.json")]
    scene: PathBuf,

    /// Output path
    #[arg(short, long, value_name = "PATH")]
    output: PathBuf,
}

impl clap::Args for Args {
    fn augment_args(command: clap::Command) -> clap::Command {
        let of_table = EXPORTS.iter().map(|format| {
            let command = Common::augment_args(clap::Command::new(format.name));
            let options = arguments(WRITE, |option| format.options.contains(&option));
            command.args(options).about(format.about).long_about(None::<&str>)
        });
        let rerun = rerun::Args::augment_args(clap::Command::new("rerun"));
        let rerun =
            rerun.about("Rerun: a folder that examples/to_rerun.py logs as a recording").long_about(None::<&str>);
        let command = command.about(ABOUT).long_about(LONG_ABOUT).after_help(AFTER);
        command.subcommand_required(true).arg_required_else_help(true).subcommands(of_table.chain([rerun]))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for Args {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let missing = || clap::Error::new(ErrorKind::MissingSubcommand);
        let (name, matches) = matches.subcommand().ok_or_else(missing)?;
        if let Some(format) = EXPORTS.iter().find(|format| format.name == name) {
            let given = Given::of(matches, WRITE, |option| format.options.contains(&option));
            return Ok(Self::Of(format, Common::from_arg_matches(matches)?, given));
        }
        Ok(Self::Rerun(rerun::Args::from_arg_matches(matches)?))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    match args {
        Args::Of(format, common, given) => {
            let options = WriteOptions { scene: common.scene.clone(), ..given.options() };
            export(&format.write, common, &options, out)
        }
        Args::Rerun(args) => rerun::run(args, out),
    }
}

fn export(writer: &Writer, common: &Common, options: &WriteOptions, out: &Output) -> anyhow::Result<Outcome> {
    let Common { scene, output } = common;
    let in_scene = |error: EntryError| error.in_file(scene);
    match writer {
        Writer::Bodies(write) => {
            let paths = [output.as_path()];
            let file = read(common, &paths)?;
            let choice = if options.enclosing { BodyChoice::Enclosing } else { BodyChoice::Body };
            let checked = CheckedScene::new(&file, choice).map_err(in_scene)?.in_unit(options.length_unit.as_deref());
            if checked.bodies() == 0 {
                bail!("{}: no object has a body: there is nothing to export", scene.display());
            }
            let labels = Labels::of_file(&file);
            let outcome = finish(out, &[write(&checked, options)?], &paths, Some((&checked.without_body, &labels)))?;
            out.report(&note("with another status than ok", &checked.not_ok, &labels))?;
            Ok(outcome)
        }
        Writer::Tables(write) => {
            let paths: Vec<&Path> =
                [Some(output), options.views.as_ref()].into_iter().flatten().map(PathBuf::as_path).collect();
            let documents = write(&read(common, &paths)?).map_err(in_scene)?;
            finish(out, &documents, &paths, None)
        }
        Writer::Cameras(write) => {
            check_file(output)?;
            refuse_to_overwrite(scene, output)?;
            let document = write(&read_scene_file(scene)?, options).map_err(in_scene)?;
            finish(out, &[document], &[output], None)
        }
        Writer::CameraFolder(names, write) => {
            let documents = write(&read_scene_file(scene)?).map_err(in_scene)?;
            std::fs::create_dir_all(output)
                .with_context(|| format!("{}: the folder cannot be made", output.display()))?;
            let paths = names.map(|name| output.join(name));
            for path in &paths {
                check_file(path)?;
                refuse_to_overwrite(scene, path)?;
            }
            finish(out, &documents, &paths.each_ref().map(PathBuf::as_path), None)
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
fn finish(
    out: &Output,
    documents: &[Document],
    paths: &[&Path],
    without_body: Option<(&[String], &Labels)>,
) -> anyhow::Result<Outcome> {
    for (document, path) in documents.iter().zip(paths) {
        write_file(path, |out| out.write_all(&document.content))?;
    }
    let written = documents.iter().zip(paths).map(|(d, path)| (*path, d.counts.as_slice(), d.notes.as_slice()));
    tell(out, written, without_body)
}

/// Reports what was written: path, counts and notes of each; and which objects have no body.
fn tell<'a>(
    out: &Output,
    written: impl Iterator<Item = (&'a Path, &'a [(&'a str, usize)], &'a [String])>,
    without_body: Option<(&[String], &Labels)>,
) -> anyhow::Result<Outcome> {
    let mut text = String::new();
    let mut files = Vec::new();
    for (path, counts, notes) in written {
        text.push_str(&wrote(path, counts));
        notes.iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
        files.push(entry(path, counts, notes));
    }
    text.push_str(&without_body.map_or_else(String::new, |(ids, labels)| note("skipped without a body", ids, labels)));
    out.report(&text)?;
    out.document(&json!({ "files": files, "without_body": without_body.map_or(&[][..], |(ids, _)| ids) }))?;
    Ok(Outcome::Fine)
}

/// "- skipped without a body: 2 objects (cup 3, cup 4)"; empty without objects.
fn note(what: &str, ids: &[String], labels: &Labels) -> String {
    if ids.is_empty() {
        return String::new();
    }
    format!("- {what}: {} ({})\n", count(ids.len(), "object"), one_line(&some_of(&labels.of_all(ids))))
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

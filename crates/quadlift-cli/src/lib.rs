//! The program `quadlift` as a function, for `main.rs` and the Python package; not an interface for others.
#![forbid(unsafe_code)]
#![doc(hidden)]

mod args;
mod call;
mod contact_sheet;
mod error;
mod files;
mod options;
mod help;
mod output;
mod corrections;
mod diagnosis;
mod next;
mod outputs;
mod pose_check;
mod progress;
mod reading;
mod report;
mod segmentation;
mod signals;
mod table;
mod threads;
mod words;
mod oddities;
mod association;
mod estimate_table;
mod evaluation;
mod localization;
mod commands;

use std::ffi::OsString;
use std::io::Write;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

use commands::{
    align, associate, calibrate_rig, completions, demo, evaluate, export, import, info, localize, man, relocalize,
    render, segment, stream, synth, view,
};
use error::Outcome;
use output::Output;
use outputs::Paths;
use quadlift_io::images::{DEFAULT_MAX_PIXELS, set_max_pixels};

const EXIT_CODES: &str = "\
Exit codes:
  0  success
  1  a file could not be read or written, a detection could not be segmented, or no object could
     be localized (of several scenes: in at least one)
  2  wrong usage: unknown options, values out of range, options that contradict each other
  3  the scene is inconsistent: poses, cameras and boxes contradict each other
     (--allow-inconsistent continues)

Outputs:
  -o - and /dev/stdout write to standard output; messages then go to standard error.
  Input files, and the images and masks that a scene names, are never overwritten.

To start:
  quadlift demo";

/// Largest `--max-pixels`: a mask of so many pixels takes 4 GiB.
const MAX_MAX_PIXELS: u64 = 1 << 32;

/// Lifts 2D object detections from posed images to 3D objects: ellipsoids and cuboids.
#[derive(Parser)]
#[command(name = "quadlift", version, after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Print one JSON document to standard output
    #[arg(long, global = true)]
    json: bool,

    /// Print details to standard error: rejected views, noise levels, times
    #[arg(short, long, global = true)]
    verbose: bool,

    /// Reject images and masks with more pixels before they are decoded, at most 4294967296
    #[arg(long, global = true, value_name = "N", default_value_t = DEFAULT_MAX_PIXELS, hide_short_help = true,
          value_parser = clap::value_parser!(u64).range(1..=MAX_MAX_PIXELS))]
    max_pixels: u64,

    /// Print errors only
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Args),
    Segment(segment::Args),
    Associate(associate::Args),
    Localize(Box<localize::Args>),
    Relocalize(relocalize::Args),
    Align(align::Args),
    CalibrateRig(calibrate_rig::Args),
    Stream(Box<stream::Args>),
    Evaluate(evaluate::Args),
    View(view::Args),
    Render(render::Args),
    Synth(synth::Args),
    Import(import::Args),
    Export(export::Args),
    Info(info::Args),
    Completions(completions::Args),
    #[command(hide = true)]
    Man(man::Args),
}

/// Runs the program and gives its exit code. `command` are the words by which a shell calls the program, for suggested
/// commands; `arguments` what follows them. Both may differ from those of the process, which may be Python.
pub fn main(command: Vec<OsString>, arguments: Vec<OsString>) -> u8 {
    call::begin(command, arguments.clone());
    let code = run_with(arguments);
    // Standard output is flushed at the end of a Rust program, but not of another one. All errors that matter are known.
    let _ = std::io::stdout().flush();
    code
}

fn run_with(arguments: Vec<OsString>) -> u8 {
    let json = arguments.iter().any(|word| word == "--json");
    let command = Cli::command().mut_subcommand("localize", localize::with_requirements);
    let words = std::iter::once("quadlift".into()).chain(arguments);
    let parsed = help::arrange(command).try_get_matches_from(words);
    let (matches, cli) = match parsed.and_then(|matches| Cli::from_arg_matches(&matches).map(|cli| (matches, cli))) {
        Ok(parsed) => parsed,
        Err(error) => return wrong_usage(&error, json),
    };
    let paths = Paths::new(&matches);
    let out = Output {
        json: cli.json,
        quiet: cli.quiet,
        verbose: cli.verbose,
        reports_to_stderr: paths.to_standard_output(),
    };
    signals::remove_temporary_files_at_the_end();
    quadlift_io::guard::protect_what_is_read();
    set_max_pixels(cli.max_pixels);
    let is_stream = matches!(cli.command, Command::Stream(_));
    let result = paths.check(cli.json).and_then(|()| run(cli.command, &out));
    match result {
        Ok(Outcome::Fine) => 0,
        Ok(Outcome::SomethingFailed) => 1,
        Ok(Outcome::Inconsistent) => 3,
        Err(error) => {
            out.error(&error::in_words(&error));
            // Best effort: the error has already been reported.
            let mut document = serde_json::json!({ "error": error::in_words(&error) });
            if let Some(error::InconsistentError { diagnosis, .. }) = error.downcast_ref() {
                document["diagnosis"] = serde_json::json!(diagnosis);
            }
            let _ = match is_stream && cli.json {
                true => out.product(&format!("{document}\n")),
                false => out.document(&document),
            };
            error::exit_code(&error)
        }
    }
}

/// Tells what is wrong with the command line, also as JSON if it asks for that; or the help or the version that it asks for.
fn wrong_usage(error: &clap::Error, json: bool) -> u8 {
    // Best effort: a closed pipe wants to know nothing more.
    let _ = error.print();
    let out = Output { json: json && error.use_stderr(), quiet: true, verbose: false, reports_to_stderr: false };
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default();
    let _ = out.document(&serde_json::json!({ "error": first.strip_prefix("error: ").unwrap_or(first) }));
    error.exit_code() as u8
}

/// Whether a text begins with the name of a command.
fn is_command(text: &str) -> bool {
    text.split(' ').next().is_some_and(|name| Cli::command().find_subcommand(name).is_some())
}

fn run(command: Command, out: &Output) -> anyhow::Result<Outcome> {
    match command {
        Command::Demo(args) => demo::run(&args, out),
        Command::Segment(args) => segment::run(&args, out),
        Command::Associate(args) => associate::run(&args, out),
        Command::Localize(args) => localize::run(&args, out),
        Command::Relocalize(args) => relocalize::run(&args, out),
        Command::Align(args) => align::run(&args, out),
        Command::CalibrateRig(args) => calibrate_rig::run(&args, out),
        Command::Stream(args) => stream::run(&args, out),
        Command::Evaluate(args) => evaluate::run(&args, out),
        Command::View(args) => view::run(&args, out),
        Command::Render(args) => render::run(&args, out),
        Command::Synth(args) => synth::run(&args, out),
        Command::Import(args) => import::run(&args, out),
        Command::Export(args) => export::run(&args, out),
        Command::Info(args) => info::run(&args, out),
        Command::Completions(args) => completions::run(&args, out),
        Command::Man(args) => man::run(&args, out),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        super::Cli::command().debug_assert();
    }

    #[test]
    fn every_command_is_in_the_manual_and_every_option_in_the_help() {
        let manual = include_str!("../../../docs/cli.md");
        let exports = include_str!("../../../docs/formats/exports.md");
        let cli = super::Cli::command();
        for command in cli.get_subcommands().chain([&cli]) {
            let name = command.get_name();
            assert!(name == "quadlift" || manual.contains(&format!("## quadlift {name}")), "{name}");
        }
        let mut formats = Vec::new();
        for command in ["import", "export"] {
            for format in cli.find_subcommand(command).unwrap().get_subcommands() {
                let name = format.get_name();
                // A test of quadlift-io sees that the formats of `import` have sections.
                let is_named = command == "import" || exports.contains(&format!("`{name}`"));
                assert!(is_named, "{command} {name}");
                formats.push(format);
            }
        }
        // The options are in the help alone, from which `scripts/reference.py` makes a page.
        for command in cli.get_subcommands().chain([&cli]).chain(formats) {
            for option in command.get_arguments().filter(|argument| argument.get_long().is_some()) {
                let help = option.get_help().map(ToString::to_string).unwrap_or_default();
                assert!(help.len() > 8, "{} --{}: {help}", command.get_name(), option.get_id());
            }
        }
    }
}

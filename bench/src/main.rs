//! The program: the experiments, and the comparison of two programs.
#![forbid(unsafe_code)]

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use clap::{Parser, Subcommand};
use indicatif::ProgressBar;
use quadlift_bench::data::data_folder;
use quadlift_bench::{CONVENTIONS, Experiment, Report, Run, compare, html_page, page, render, run, summary, verdicts};
use quadlift_io::write_file;
use serde_json::{Value, json};

/// Experiments of the paper "3D Pose from Detections" (ICCV 2015) and our own, and the comparison of two programs
///
/// Each table of an experiment has the paper's printed figures in the rows whose setting is "paper".
#[derive(Parser)]
#[command(
    name = "quadlift-bench",
    version,
    verbatim_doc_comment,
    after_help = "\
Examples:
  cargo run --release -p quadlift-bench -- synthetic
  cargo run --release -p quadlift-bench -- kitti --data ../shared/data --json
  cargo run --release -p quadlift-bench -- all --out docs
  cargo run --release -p quadlift-bench -- compare old/quadlift target/release/quadlift

Exit codes: 0 done; 1 there is no data, or a file cannot be read or written; 2 wrong usage."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Compare two programs, or two settings of one, on real and synthetic scenes
    Compare(compare::Args),
    /// Write a rendered scene: images, true masks and true objects
    Render(render::scene_files::Args),
    /// Noise of ellipses and of boxes, outliers (needs no data)
    Synthetic(Options),
    /// One object on a table, 100 views
    Accv(Options),
    /// Several objects on a table, 8 views
    Tuw(Options),
    /// Parked cars seen from a moving car
    Kitti(Options),
    /// Two and three views with a wide baseline
    Minimal(Options),
    /// Masks and ellipses from images, and bodies from them (without data: rendered images only)
    Segmentation(Options),
    /// Objects from detections without ids (without data: synthetic scenes only)
    Association(Options),
    /// How well left-out views predict the quality of estimates
    CrossValidation(Options),
    /// Coverage of the confidence regions of estimates (without data: synthetic scenes only)
    Trust(Options),
    /// The consistency check on correct and on corrupted scenes (without data: synthetic scenes only)
    Diagnosis(Options),
    /// Bodies of several kinds, standing and lying (needs no data)
    Kinds(Options),
    /// The default with 2 to 20 views, compared with a given noise level and a closed form (needs no data)
    FewViews(Options),
    /// The object map frame by frame, compared with association of all frames (not part of all; without data: synthetic scenes only)
    Online(Options),
    /// Depths and 3D boxes of single images beside boxes (not part of all; without data: synthetic scenes only)
    Cues(Options),
    /// Images located in maps of objects (not part of all; without data: synthetic scenes only)
    Cameras(Options),
    /// Which answers change when world, order, rounding, seed or boxes change by nothing that matters (not part of all; without data: synthetic scenes only)
    Stability(Options),
    /// What each command says about mistakes of its input, and about right scenes (not part of all; needs no data)
    Verdicts(VerdictOptions),
    /// Tuned constants, halved and doubled (not part of all; without data: synthetic scenes only)
    #[cfg(feature = "sensitivity")]
    Sensitivity(Options),
    /// All of them
    All(Options),
}

/// The options of experiments.
#[derive(clap::Args)]
#[command(after_help = "\
With --out DIR: NAME.md, NAME.json and the plots as NAME/*.svg and NAME/*.png, where NAME is the experiment, or \"results\" for all. \
The same seed gives the same files, with any number of threads.")]
struct Options {
    /// Folder of the real data, which contains `scenes` (default: QUADLIFT_DATA, or ../shared/data)
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Folder for the tables and plots; created if it does not exist
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Write one HTML page with the tables and plots
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,

    /// Print Markdown instead of aligned text
    #[arg(long, conflicts_with = "json")]
    markdown: bool,

    /// Print one JSON document
    #[arg(long)]
    json: bool,

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Few scenes of each kind: whether it runs, and roughly its figures
    #[arg(long)]
    short: bool,
}

/// The options of `verdicts`.
#[derive(clap::Args)]
struct VerdictOptions {
    #[command(flatten)]
    options: Options,

    #[command(flatten)]
    extent: verdicts::Extent,
}

impl Command {
    /// The experiments, the name of their files and their options; none for the comparison and rendering.
    fn experiments(&self) -> Option<(Vec<Experiment>, &Options)> {
        let (experiment, options) = match self {
            Self::Compare(_) | Self::Render(_) => return None,
            Self::Synthetic(options) => (Experiment::Synthetic, options),
            Self::Accv(options) => (Experiment::Accv, options),
            Self::Tuw(options) => (Experiment::Tuw, options),
            Self::Kitti(options) => (Experiment::Kitti, options),
            Self::Minimal(options) => (Experiment::Minimal, options),
            Self::Segmentation(options) => (Experiment::Segmentation, options),
            Self::Association(options) => (Experiment::Association, options),
            Self::CrossValidation(options) => (Experiment::CrossValidation, options),
            Self::Trust(options) => (Experiment::Trust, options),
            Self::Diagnosis(options) => (Experiment::Diagnosis, options),
            Self::Kinds(options) => (Experiment::Kinds, options),
            Self::FewViews(options) => (Experiment::FewViews, options),
            Self::Online(options) => (Experiment::Online, options),
            Self::Cues(options) => (Experiment::Cues, options),
            Self::Cameras(options) => (Experiment::Cameras, options),
            Self::Stability(options) => (Experiment::Stability, options),
            Self::Verdicts(VerdictOptions { options, extent }) => (Experiment::Verdicts(*extent), options),
            #[cfg(feature = "sensitivity")]
            Self::Sensitivity(options) => (Experiment::Sensitivity, options),
            Self::All(options) => return Some((Experiment::ALL.to_vec(), options)),
        };
        Some((vec![experiment], options))
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match (&cli.command, cli.command.experiments()) {
        (Command::Compare(args), _) => compare::run(args).and_then(|text| print(&text)),
        (Command::Render(args), _) => render::scene_files::run(args),
        (_, Some((experiments, options))) => run_all(&experiments, options),
        (_, None) => Ok(()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // Nobody is left to tell when standard error is closed.
            let _ = writeln!(io::stderr(), "error: {error:#}");
            ExitCode::from(1)
        }
    }
}

fn print(text: &str) -> anyhow::Result<()> {
    match io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

fn run_all(experiments: &[Experiment], options: &Options) -> anyhow::Result<()> {
    // Missing data is reported before long work starts.
    if experiments.iter().any(|experiment| experiment.needs_data()) {
        data_folder(options.data.as_deref())?;
    }
    if let Some(folder) = &options.out {
        make_folder(folder)?;
    }
    let show = |text: &str| if options.json { Ok(()) } else { print(text) };
    let name = if let [experiment] = experiments { experiment.name() } else { "results" };
    let mut reports = Vec::new();
    for &experiment in experiments {
        let report = with_progress(experiment, options)?;
        let text = if options.markdown { report.to_markdown(name) } else { report.to_text() };
        show(&format!("{text}\n"))?;
        reports.push(report);
    }
    let summary = summary(&reports);
    let text = if options.markdown { summary.to_markdown() } else { format!("{}\n", summary.to_text()) };
    show(&format!("{text}\n{CONVENTIONS}"))?;
    let document = document(&reports, options.seed);
    if let Some(folder) = &options.out {
        write_files(folder, name, &reports, &document, &command(name, options))?;
        show(&format!("\nWrote {0}/{name}.md, {0}/{name}.json and the plots in {0}/{name}.\n", folder.display()))?;
    }
    if let Some(path) = &options.report {
        let html = html_page(&reports, &command(name, options))?;
        write_file(path, |file| file.write_all(html.as_bytes()))?;
        show(&format!("\nWrote {}.\n", path.display()))?;
    }
    if options.json {
        print(&format!("{document}\n"))?;
    }
    Ok(())
}

fn make_folder(folder: &Path) -> anyhow::Result<()> {
    if folder.exists() && !folder.is_dir() {
        bail!("cannot write to {}: it is a file; expected a folder", folder.display());
    }
    if let Err(error) = std::fs::create_dir_all(folder) {
        bail!("cannot make the folder {}: {error}", folder.display());
    }
    Ok(())
}

fn with_progress(experiment: Experiment, options: &Options) -> anyhow::Result<Report> {
    // It is drawn only on a terminal.
    let bar = ProgressBar::new(0);
    let progress = |_: &str, done: usize, total: usize| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    };
    let settings = Run { data: options.data.as_deref(), seed: options.seed, short: options.short, progress: &progress };
    let report = run(experiment, &settings);
    bar.finish_and_clear();
    Ok(report?)
}

fn write_files(folder: &Path, name: &str, reports: &[Report], document: &Value, command: &str) -> anyhow::Result<()> {
    let write = |path: PathBuf, bytes: &[u8]| write_file(&path, |file| file.write_all(bytes));
    let json = serde_json::to_string_pretty(document)? + "\n";
    write(folder.join(format!("{name}.md")), page(reports, command, name).as_bytes())?;
    write(folder.join(format!("{name}.json")), json.as_bytes())?;
    let plots = folder.join(name);
    for plot in reports.iter().flat_map(Report::plots) {
        make_folder(&plots)?;
        write(plots.join(format!("{}.svg", plot.name)), plot.svg()?.as_bytes())?;
        write(plots.join(format!("{}.png", plot.name)), &plot.png()?)?;
    }
    Ok(())
}

/// The command that writes these files, without the folder of the data: that is the reader's own.
fn command(name: &str, options: &Options) -> String {
    let experiment = if name == "results" { "all" } else { name };
    let folder = options.out.as_ref().map(|folder| format!(" --out {}", folder.display())).unwrap_or_default();
    let seed = if options.seed == 0 { String::new() } else { format!(" --seed {}", options.seed) };
    let short = if options.short { " --short" } else { "" };
    format!("cargo run --release -p quadlift-bench -- {experiment}{folder}{seed}{short}")
}

fn document(reports: &[Report], seed: u64) -> Value {
    json!({
        "program": "quadlift-bench",
        "version": env!("CARGO_PKG_VERSION"),
        "seed": seed,
        "experiments": reports.iter().map(Report::to_json).collect::<Vec<_>>(),
    })
}

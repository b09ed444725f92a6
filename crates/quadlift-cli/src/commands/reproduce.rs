//! `quadlift reproduce`: the experiments of the paper, compared with its figures.

use std::path::{Path, PathBuf};

use anyhow::bail;
use quadlift_experiments::data::data_folder;
use quadlift_experiments::{CONVENTIONS, Experiment, Report, html_page, page, run as run_experiment, summary};
use quadlift_io::write_file;
use serde_json::{Value, json};

use crate::error::Outcome;
use crate::files::make_folder;
use crate::output::Output;
use crate::progress::counting_bar;
use crate::report::check_report;

/// Rerun the experiments of the paper and compare the figures (for research)
///
/// The paper is "3D Pose from Detections" (ICCV 2015). Each table has the paper's printed figures in the rows whose
/// setting is "paper".
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Experiments:
  synthetic     noise of ellipses and of boxes, outliers (needs no data)
  accv          one object on a table, 100 views
  tuw           several objects on a table, 8 views
  kitti         parked cars seen from a moving car
  minimal       two and three views with a wide baseline
  segmentation  masks and ellipses from images, and bodies from them (without data: rendered images only)
  association   objects from detections without ids (without data: synthetic scenes only)
  cross-validation  how well left-out views predict the quality of estimates
  trust         coverage of the confidence regions of estimates (without data: synthetic scenes only)
  diagnosis     the self-check on correct and on corrupted scenes (without data: synthetic scenes only)
  kinds         bodies of several kinds, standing and lying (needs no data)
  few-views     the default with 2 to 20 views, compared with a given noise level and a closed form (needs no data)
  online        the object map frame by frame, compared with association of all frames (not part of all; without data: synthetic
                scenes only)
  cues          depths and 3D boxes of single images beside boxes (not part of all; without data: synthetic scenes only)
  cameras       images located in maps of objects (not part of all; without data: synthetic scenes only)
  sensitivity   tuned constants, halved and doubled (needs the feature `sensitivity`; not part of all)
  all           all of them

With --out DIR: NAME.md, NAME.json and the plots as NAME/*.svg and NAME/*.png, where NAME is the experiment, or
\"results\" for all. The same seed gives the same files, with any number of threads.

Examples:
  quadlift reproduce synthetic
  quadlift reproduce kitti --data ../shared/data --json
  quadlift reproduce all --out docs

Exit codes: 0 done; 1 there is no data, or a file cannot be read or written; 2 wrong usage."
)]
pub struct Args {
    /// The experiment
    #[arg(value_enum, hide_possible_values = true)]
    experiment: Name,

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

    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum Name {
    Synthetic,
    Accv,
    Tuw,
    Kitti,
    Minimal,
    Segmentation,
    Association,
    CrossValidation,
    Trust,
    Diagnosis,
    Kinds,
    FewViews,
    Online,
    Cues,
    Cameras,
    #[cfg(feature = "sensitivity")]
    Sensitivity,
    All,
}

impl Name {
    fn experiments(self) -> Vec<Experiment> {
        match self {
            Self::Synthetic => vec![Experiment::Synthetic],
            Self::Accv => vec![Experiment::Accv],
            Self::Tuw => vec![Experiment::Tuw],
            Self::Kitti => vec![Experiment::Kitti],
            Self::Minimal => vec![Experiment::Minimal],
            Self::Segmentation => vec![Experiment::Segmentation],
            Self::Association => vec![Experiment::Association],
            Self::CrossValidation => vec![Experiment::CrossValidation],
            Self::Trust => vec![Experiment::Trust],
            Self::Diagnosis => vec![Experiment::Diagnosis],
            Self::Kinds => vec![Experiment::Kinds],
            Self::FewViews => vec![Experiment::FewViews],
            Self::Online => vec![Experiment::Online],
            Self::Cues => vec![Experiment::Cues],
            Self::Cameras => vec![Experiment::Cameras],
            #[cfg(feature = "sensitivity")]
            Self::Sensitivity => vec![Experiment::Sensitivity],
            Self::All => Experiment::ALL.to_vec(),
        }
    }
}

pub fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    let experiments = args.experiment.experiments();
    // Missing data is reported before long work starts.
    if experiments.iter().any(|experiment| experiment.needs_data()) {
        data_folder(args.data.as_deref())?;
    }
    if let Some(folder) = &args.out {
        if folder.exists() && !folder.is_dir() {
            bail!("cannot write to {}: it is a file; expected a folder", folder.display());
        }
        make_folder(folder)?;
    }
    check_report(args.report.as_ref(), &[])?;
    let mut reports = Vec::new();
    for experiment in experiments {
        let report = with_progress(experiment, args, out)?;
        let text = if args.markdown { report.to_markdown(plot_folder(args)) } else { report.to_text() };
        out.report(&format!("{text}\n"))?;
        reports.push(report);
    }
    let summary = summary(&reports);
    out.report(&format!(
        "{}\n{CONVENTIONS}",
        if args.markdown { summary.to_markdown() } else { format!("{}\n", summary.to_text()) }
    ))?;
    if let Some(folder) = &args.out {
        write_files(folder, &reports, args)?;
        out.report(&format!(
            "\nWrote {0}/{1}.md, {0}/{1}.json and the plots in {0}/{1}.\n",
            folder.display(),
            name(args)
        ))?;
    }
    if let Some(path) = &args.report {
        let html = html_page(&reports, &command(args))?;
        write_file(path, |file| file.write_all(html.as_bytes()))?;
        out.report(&format!("\nWrote {}.\n", path.display()))?;
    }
    out.document(&document(&reports, args))?;
    Ok(Outcome::Fine)
}

fn with_progress(experiment: Experiment, args: &Args, out: &Output) -> anyhow::Result<Report> {
    let bar = counting_bar("", "steps", out);
    let report = run_experiment(experiment, args.data.as_deref(), args.seed, &|name, done, total| {
        bar.set_message(name.to_owned());
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    Ok(report?)
}

/// The name of the files.
fn name(args: &Args) -> &'static str {
    match args.experiment {
        Name::Synthetic => "synthetic",
        Name::Accv => "accv",
        Name::Tuw => "tuw",
        Name::Kitti => "kitti",
        Name::Minimal => "minimal",
        Name::Segmentation => "segmentation",
        Name::Association => "association",
        Name::CrossValidation => "cross-validation",
        Name::Trust => "trust",
        Name::Diagnosis => "diagnosis",
        Name::Kinds => "kinds",
        Name::FewViews => "few-views",
        Name::Online => "online",
        Name::Cues => "cues",
        Name::Cameras => "cameras",
        #[cfg(feature = "sensitivity")]
        Name::Sensitivity => "sensitivity",
        Name::All => "results",
    }
}

/// The folder of the plots, beside the page.
fn plot_folder(args: &Args) -> &'static str {
    name(args)
}

fn write_files(folder: &Path, reports: &[Report], args: &Args) -> anyhow::Result<()> {
    let write = |path: PathBuf, bytes: &[u8]| write_file(&path, |file| file.write_all(bytes));
    let mut json = serde_json::to_string_pretty(&document(reports, args))?;
    json.push('\n');
    write(folder.join(format!("{}.md", name(args))), page(reports, &command(args), plot_folder(args)).as_bytes())?;
    write(folder.join(format!("{}.json", name(args))), json.as_bytes())?;
    let plots = folder.join(plot_folder(args));
    for plot in reports.iter().flat_map(Report::plots) {
        make_folder(&plots)?;
        write(plots.join(format!("{}.svg", plot.name)), plot.svg()?.as_bytes())?;
        write(plots.join(format!("{}.png", plot.name)), &plot.png()?)?;
    }
    Ok(())
}

/// The command that writes these files, without the folder of the data: that is the reader's own.
fn command(args: &Args) -> String {
    let experiment = if args.experiment == Name::All { "all" } else { name(args) };
    let folder = args.out.as_ref().map(|folder| format!(" --out {}", folder.display())).unwrap_or_default();
    let seed = if args.seed == 0 { String::new() } else { format!(" --seed {}", args.seed) };
    format!("quadlift reproduce {experiment}{folder}{seed}")
}

fn document(reports: &[Report], args: &Args) -> Value {
    json!({
        "program": "quadlift",
        "version": env!("CARGO_PKG_VERSION"),
        "seed": args.seed,
        "experiments": reports.iter().map(Report::to_json).collect::<Vec<_>>(),
    })
}

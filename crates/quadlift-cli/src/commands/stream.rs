//! `quadlift stream`: an object map that is updated frame by frame.

mod lines;
mod map_file;
mod rerun;
mod source;
mod words;
mod session;

use std::path::{Path, PathBuf};

use clap::builder::RangedU64ValueParser;
use quadlift::online::OnlineOptions;
use quadlift::run::{AssociateWhen, RunOptions};
use quadlift::solve::PoseNoise;
use quadlift_io::guard::{allow_overwriting, check_not_read};
use quadlift_io::mcap::McapOptions;
use quadlift_io::mcap::is_mcap;
use quadlift_io::run::FileOptions;
use quadlift_io::stream::{StoredPriors, lasting_options};
use serde_json::{Map, Value, json};

use crate::diagnosis::tell_of_map;
use crate::error::{Outcome, usage};
use crate::files::{check_file, check_result_name};
use crate::localization::{file_options, prior_source};
use crate::next::Next;
use crate::options::{Chosen, Stream, StreamMap};
use crate::output::Output;
use crate::reading::{self, Reading};
use crate::report::check_report;
use crate::threads;
use map_file::MapFiles;
use rerun::{Live, Target};
use session::Session;
use source::Source;

/// Update an object map frame by frame
///
/// Reads posed frames with their detections as JSON Lines, or replays a scene, and writes a line of events for each frame:
/// which object each detection belongs to, and which objects are new, confirmed, merged, gone or back. On a terminal the
/// lines are text; --json prints JSON Lines there too.
#[derive(clap::Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
A line of the input:
  {\"frame\": \"000017\", \"time\": 0.57, \"camera\": \"left\", \"cam_from_world\": [[...], [...], [...]],
   \"detections\": [{\"box\": [x0, y0, x1, y1], \"category\": \"cup\", \"score\": 0.9, \"object\": \"track 3\"}]}

A line of the output:
  {\"frame\": \"000017\", \"objects\": [\"object_0001\"], \"events\": [{\"type\": \"confirmed\", \"object\": \"object_0001\"}]}

Examples:
  quadlift stream scene.json --map objects.json
  quadlift stream log.mcap --map objects.json > events.jsonl
  tracker | quadlift stream --map objects.json --save-every 100 --state map.state --resume > events.jsonl

Ctrl-C, SIGTERM and a closed output end the stream: map, state and report are written. A second signal ends the program at
once.

Exit codes: 0 the stream has ended; 1 a file cannot be read or written, or --strict and a line is wrong; 2 wrong usage;
3 poses, cameras and boxes are inconsistent: no object of the map is ok."
)]
pub(crate) struct Args {
    /// Frames: - for JSON Lines on the standard input (default), a file of such lines, a scene file (.json), or a log in MCAP
    #[arg(value_name = "INPUT")]
    input: Option<PathBuf>,

    /// Write the objects of the map with their kept views, a result file that evaluate, view and export read
    #[arg(long, value_name = "OUT.json")]
    map: Option<PathBuf>,

    /// Write map and state every N frames too, not only at the end
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    save_every: Option<u64>,

    /// Write what --resume needs to go on
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,

    /// Go on from --state, if the file exists: frames of the input that were observed before are passed over
    #[arg(long, requires = "state")]
    resume: bool,

    /// End at the first line or frame that is wrong, with exit code 1
    #[arg(long)]
    strict: bool,

    /// Write a report at the end, an HTML page
    #[arg(long, value_name = "OUT.html")]
    report: Option<PathBuf>,

    /// Show frames, objects and events live in Rerun: in the viewer on this machine, which is started if there is none, in that
    /// of an address (HOST:PORT), or in a recording (OUT.rrd); needs Python with rerun-sdk
    #[arg(long, value_name = "TARGET", num_args = 0..=1, require_equals = true, default_missing_value = "",
          value_parser = Target::parse)]
    rerun: Option<Target>,

    /// Write the map without covariances and figures of single views: a third of the size
    #[arg(long)]
    compact: bool,

    /// Use only the detections of this source of a scene file; required if the scene has several
    #[arg(long, value_name = "NAME")]
    source: Option<String>,

    /// What is known about categories: "builtin" (for scenes in meters) or a TOML file
    #[arg(long, value_name = "builtin|FILE.toml")]
    priors: Option<PathBuf>,

    #[command(flatten)]
    of_map: Chosen<StreamMap>,

    #[command(flatten)]
    chosen: Chosen<Stream>,

    /// Number of threads for the map file [default: one per core]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..=1024))]
    threads: Option<usize>,

    #[command(flatten)]
    log: Reading<reading::Stream>,
}

impl Args {
    /// The input, where it is not the standard input.
    fn input(&self) -> Option<&Path> {
        self.input.as_deref().filter(|path| path.as_os_str() != "-")
    }

    /// The recording, where that is what `--rerun` names.
    fn recording(&self) -> Option<&PathBuf> {
        match &self.rerun {
            Some(Target::File(path)) => Some(path),
            _ => None,
        }
    }

    /// How the objects of the map file are estimated.
    fn options(&self) -> anyhow::Result<FileOptions> {
        // The views of a map name their objects.
        let run = RunOptions { associate: AssociateWhen::Never, ..self.chosen.options()? };
        file_options(run, prior_source(self.priors.as_deref()))
    }

    /// How a log is read. Refuses options of logs if the input is none.
    fn log_options(&self) -> anyhow::Result<McapOptions> {
        if let Some(option) = self.log.given.first_except(&[])
            && !self.input().is_some_and(is_mcap)
        {
            return usage(format!("{option} is an option of logs in MCAP; the input is none"));
        }
        Ok(McapOptions { skip_errors: true, ..McapOptions::from(&self.log.given.options()) })
    }

    /// The options of the map.
    fn posterior_options(&self, options: &FileOptions) -> anyhow::Result<OnlineOptions> {
        let options = OnlineOptions { priors: options.category_priors(), ..self.of_map.options()? };
        match options.validate() {
            Ok(()) => Ok(options),
            Err(error) => usage(error.to_string()),
        }
    }

    /// The options that the map depends on, by their names: a state goes on with the same.
    fn lasting_options(&self, posterior_options: &OnlineOptions, pose_noise: Option<PoseNoise>) -> Map<String, Value> {
        let priors = self.priors.as_ref().map(|path| StoredPriors::Name(path.display().to_string()));
        let mut options = lasting_options(posterior_options, priors.as_ref(), pose_noise, self.source.as_deref());
        let log = self.log.given.options();
        options.extend([
            ("topics".to_owned(), json!(Some(log.topics).filter(|topics| !topics.is_empty()))),
            ("world_frame".to_owned(), json!(log.world_frame)),
            ("camera_frame".to_owned(), json!(log.camera_frame)),
            ("rectified".to_owned(), json!(log.rectified.then_some(true))),
        ]);
        options
    }

    /// Checks the names of what is written, before anything is read.
    fn check_outputs(&self) -> anyhow::Result<()> {
        if let Some(map) = &self.map {
            check_result_name(map, true)?;
        }
        let files: Vec<&Path> = [&self.map, &self.state].into_iter().flatten().map(PathBuf::as_path).collect();
        files.iter().try_for_each(|path| check_file(path))?;
        check_report(self.report.as_ref(), &files)?;
        self.recording().map_or(Ok(()), |path| check_file(path))?;
        if let (Some(Target::Local), Some(input)) = (&self.rerun, self.input())
            && (input.extension().is_some_and(|end| end == "rrd") || input.to_string_lossy().contains("://"))
        {
            return usage(format!(
                "the input {0} cannot be read; to show the stream there: --rerun={0}",
                input.display()
            ));
        }
        if self.save_every.is_some() && files.is_empty() {
            return usage("--save-every says how often --map and --state are written; neither is given");
        }
        Ok(())
    }
}

pub(crate) fn run(args: &Args, out: &Output) -> anyhow::Result<Outcome> {
    threads::start(args.threads)?;
    args.check_outputs()?;
    let options = args.options()?;
    let posterior_options = args.posterior_options(&options)?;
    let pose_noise = options.run.localize.method.posterior_options().and_then(|map| map.pose_noise);
    let lasting = args.lasting_options(&posterior_options, pose_noise);
    let mut session = Session::new(posterior_options, args, (&lasting, pose_noise), out)?;
    let mut source = Source::open(args.input(), args.source.as_deref(), args.log_options()?, out)?;
    // Reading the state does not keep it from being written.
    args.state.as_deref().map(allow_overwriting);
    let outputs = [args.map.as_ref(), args.state.as_ref(), args.report.as_ref(), args.recording()];
    outputs.iter().flatten().try_for_each(|path| check_not_read(path))?;
    let files = MapFiles {
        map: args.map.as_deref(),
        state: args.state.as_deref(),
        report: args.report.as_deref(),
        input: args.input().unwrap_or(Path::new("stream.jsonl")),
        detail: args.compact.into(),
        options: &options,
        lasting: &lasting,
    };
    if let Some(target) = &args.rerun {
        session.show(Live::start(target, args.input(), out)?);
    }
    let ended = session.run(&mut source, &files);
    // Whatever ended the stream, what was seen is written.
    let (text, written) = session.end(&files);
    ended?;
    let check = written?;
    let wrote: String = outputs.iter().flatten().map(|path| format!("wrote {}\n", path.display())).collect();
    out.report(&format!("{text}\n{wrote}"))?;
    if let Some(map) = &args.map {
        let mut next = Next::default();
        if args.report.is_none() {
            next = next.command(["view".into(), map.as_path().into()], "look at it in the browser");
        }
        next.command(
            ["export ply".into(), map.as_path().into(), "-o objects.ply".into()],
            "the same for other programs",
        )
        .tell(out)?;
    }
    let title = args.input().map_or_else(|| "the stream".to_owned(), |path| path.display().to_string());
    let outcome = tell_of_map(&check, &title, out);
    Ok(outcome.and(if session.has_failed_writes() { Outcome::SomethingFailed } else { Outcome::Fine }))
}

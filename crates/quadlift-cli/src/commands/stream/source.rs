//! Where frames come from: lines, which another thread reads, the frames of a scene, or those of a log.

use std::fs::File;
use std::io::{self, BufRead, BufReader, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::{Context, bail};
use quadlift::scene::SourceError;
use quadlift_io::mcap::{Frames, McapLog, McapOptions, Next, Problem, is_mcap};
use quadlift_io::stream::{AboutRecord, FrameLine, open, scene_to_frames};

use super::lines::{LineReader, NextLine};
use crate::files::read_scene;
use crate::output::{Output, one_line};
use crate::signals;
use crate::words::some_of;

/// Lines that wait to be observed, at most: the program that writes them waits, too.
const WAITING: usize = 4;

/// What comes next.
pub(super) enum Item {
    /// A line of the input.
    Line(NextLine),
    /// A frame of a scene or of a log.
    Frame(Box<FrameLine>),
    /// A part of a log that cannot be used.
    Problem(Problem),
    /// Nothing: the input ends here, or a signal has ended it.
    End,
}

/// What the thread that reads says.
enum Message {
    Line(NextLine),
    Failed(io::Error),
    End,
    /// A signal came.
    Stop,
}

/// Where frames come from.
pub(super) struct Source {
    kind: Kind,
    is_stopped: Arc<AtomicBool>,
}

enum Kind {
    Lines { from: PathBuf, receiver: Receiver<Message> },
    Scene { about: Option<AboutRecord>, frames: std::vec::IntoIter<FrameLine> },
    Log { about: Option<AboutRecord>, path: PathBuf, frames: Box<Frames<BufReader<File>>> },
}

impl Source {
    /// Opens the input; `None` is the standard input. Names that end with `.json` are scene files, logs are known by their
    /// first bytes.
    pub(super) fn open(
        path: Option<&Path>,
        source: Option<&str>,
        log_options: McapOptions,
        out: &Output,
    ) -> anyhow::Result<Self> {
        let is_stopped = Arc::new(AtomicBool::new(false));
        if let Some(path) = path.filter(|path| is_mcap(path)) {
            let kind = open_log(path, source, log_options, out)?;
            let stop = is_stopped.clone();
            signals::call_instead_of_ending(move || stop.store(true, Ordering::Relaxed));
            return Ok(Self { kind, is_stopped });
        }
        if let Some(path) = path.filter(|path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"))) {
            let (file, scene) = read_scene(path)?;
            let source = match scene.source_index(source) {
                Err(error @ SourceError::Several(_)) => bail!("{}: {error} (--source SOURCE)", path.display()),
                source => source.with_context(|| path.display().to_string())?,
            };
            let (about, frames) = scene_to_frames(file, &scene, source);
            let stop = is_stopped.clone();
            signals::call_instead_of_ending(move || stop.store(true, Ordering::Relaxed));
            return Ok(Self { kind: Kind::Scene { about: Some(about), frames: frames.into_iter() }, is_stopped });
        }
        let (sender, receiver) = sync_channel(WAITING);
        let (stop, to_receiver) = (is_stopped.clone(), sender.clone());
        signals::call_instead_of_ending(move || {
            stop.store(true, Ordering::Relaxed);
            // Where there is no room the receiver has something to do, and looks at the flag then.
            let _ = to_receiver.try_send(Message::Stop);
        });
        let (from, input): (_, Box<dyn BufRead + Send>) = match path {
            Some(path) => (path.to_owned(), open(path)?),
            None => (PathBuf::from("standard input"), Box::new(BufReader::new(io::stdin()))),
        };
        let read = move || send_lines(input, &sender);
        std::thread::Builder::new().name("input".to_owned()).spawn(read).context("cannot start a thread")?;
        Ok(Self { kind: Kind::Lines { from, receiver }, is_stopped })
    }

    /// Says on a terminal that the program waits for lines.
    pub(super) fn tell_that_it_waits(&self, out: &Output) {
        if let Kind::Lines { from, .. } = &self.kind
            && from.as_os_str() == "standard input"
            && io::stdin().is_terminal()
        {
            out.warning("reading frames from the terminal, a line each; Ctrl-D ends");
        }
    }

    /// Name, unit, direction and cameras of a scene file or a log, the first time.
    pub(super) fn about(&mut self) -> Option<AboutRecord> {
        match &mut self.kind {
            Kind::Lines { .. } => None,
            Kind::Scene { about, .. } | Kind::Log { about, .. } => about.take(),
        }
    }

    /// The next line or frame; waits for it.
    pub(super) fn next(&mut self) -> anyhow::Result<Item> {
        if self.is_stopped.load(Ordering::Relaxed) {
            return Ok(Item::End);
        }
        match &mut self.kind {
            Kind::Scene { frames, .. } => Ok(frames.next().map_or(Item::End, |frame| Item::Frame(Box::new(frame)))),
            Kind::Log { path, frames, .. } => {
                let next = frames.next_frame().with_context(|| format!("cannot read {}", path.display()))?;
                Ok(match next {
                    Some(Next::Frame(frame)) => Item::Frame(frame),
                    Some(Next::Problem(problem) | Next::Outside(problem)) => Item::Problem(problem),
                    None => Item::End,
                })
            }
            Kind::Lines { from, receiver } => match receiver.recv() {
                Ok(Message::Line(line)) => Ok(Item::Line(line)),
                Ok(Message::Failed(error)) => Err(error).with_context(|| format!("cannot read {}", from.display())),
                Ok(Message::End | Message::Stop) | Err(_) => Ok(Item::End),
            },
        }
    }
}

/// Opens a log; what is used of it is reported.
fn open_log(path: &Path, source: Option<&str>, mut options: McapOptions, out: &Output) -> anyhow::Result<Kind> {
    // What cannot be used is an event.
    options.skip_errors = true;
    options.topics.extend(source.map(str::to_owned));
    let log = McapLog::open(path, options)?;
    if !log.has_detections() {
        bail!(
            "{}: there are no 2D detections (vision_msgs/Detection2DArray or foxglove.ImageAnnotations)",
            path.display()
        );
    }
    let rivals = log.rival_topics();
    if !rivals.is_empty() {
        let topics = some_of(&rivals);
        bail!("{}: one camera has several topics of detections ({topics}): choose one with --topics", path.display());
    }
    let mut text = format!("{}: mcap\n", path.display());
    log.notes().iter().for_each(|note| text.push_str(&format!("- {}\n", one_line(note))));
    out.report(&text)?;
    let about = Some(log.about());
    Ok(Kind::Log { about, path: path.to_owned(), frames: Box::new(log.frames()?) })
}

/// Sends the lines of an input until it ends or nobody wants them.
fn send_lines(input: impl BufRead, sender: &SyncSender<Message>) {
    let mut reader = LineReader::new(input);
    loop {
        let (message, is_last) = match reader.next_line() {
            Ok(Some(line)) => (Message::Line(line), false),
            Ok(None) => (Message::End, true),
            Err(error) => (Message::Failed(error), true),
        };
        if sender.send(message).is_err() || is_last {
            return;
        }
    }
}

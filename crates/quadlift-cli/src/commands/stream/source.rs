//! Where frames come from: lines, which another thread reads, or the frames of a scene.

use std::io::{self, BufReader, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use anyhow::{Context, bail};
use quadlift::scene::SourceError;
use quadlift_io::stream::{AboutRecord, FrameLine, Input, LineReader, NextLine, open, scene_to_frames};

use crate::files::read_scene;
use crate::output::Output;
use crate::signals;

/// Lines that wait to be observed, at most: the program that writes them waits, too.
const WAITING: usize = 4;

/// What comes next.
pub enum Item {
    /// A line of the input.
    Line(NextLine),
    /// A frame of a scene.
    Frame(Box<FrameLine>),
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
pub struct Source {
    kind: Kind,
    is_stopped: Arc<AtomicBool>,
}

enum Kind {
    Lines { from: PathBuf, receiver: Receiver<Message> },
    Scene { about: Option<AboutRecord>, frames: std::vec::IntoIter<FrameLine> },
}

impl Source {
    /// Opens the input; `None` is the standard input. Names that end with `.json` are scene files.
    pub fn open(path: Option<&Path>, source: Option<&str>) -> anyhow::Result<Self> {
        let is_stopped = Arc::new(AtomicBool::new(false));
        if let Some(path) = path.filter(|path| path.extension().is_some_and(|end| end.eq_ignore_ascii_case("json"))) {
            let (file, scene) = read_scene(path)?;
            let source = match scene.source_index(source) {
                Err(error @ SourceError::Several(_)) => bail!("{}: {error} (--source NAME)", path.display()),
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
        let (from, input): (_, Input) = match path {
            Some(path) => (path.to_owned(), open(path)?),
            None => (PathBuf::from("standard input"), Box::new(BufReader::new(io::stdin()))),
        };
        let read = move || send_lines(input, &sender);
        std::thread::Builder::new().name("input".to_owned()).spawn(read).context("cannot start a thread")?;
        Ok(Self { kind: Kind::Lines { from, receiver }, is_stopped })
    }

    /// Says on a terminal that the program waits for lines.
    pub fn tell_that_it_waits(&self, out: &Output) {
        if let Kind::Lines { from, .. } = &self.kind
            && from.as_os_str() == "standard input"
            && io::stdin().is_terminal()
        {
            out.warning("reading frames from the terminal, a line each; Ctrl-D ends");
        }
    }

    /// Name, unit, direction and cameras of a scene file, the first time.
    pub fn about(&mut self) -> Option<AboutRecord> {
        match &mut self.kind {
            Kind::Lines { .. } => None,
            Kind::Scene { about, .. } => about.take(),
        }
    }

    /// The next line or frame; waits for it.
    pub fn next(&mut self) -> anyhow::Result<Item> {
        if self.is_stopped.load(Ordering::Relaxed) {
            return Ok(Item::End);
        }
        match &mut self.kind {
            Kind::Scene { frames, .. } => Ok(frames.next().map_or(Item::End, |frame| Item::Frame(Box::new(frame)))),
            Kind::Lines { from, receiver } => match receiver.recv() {
                Ok(Message::Line(line)) => Ok(Item::Line(line)),
                Ok(Message::Failed(error)) => Err(error).with_context(|| format!("cannot read {}", from.display())),
                Ok(Message::End | Message::Stop) | Err(_) => Ok(Item::End),
            },
        }
    }
}

/// Sends the lines of an input until it ends or nobody wants them.
fn send_lines(input: Input, sender: &SyncSender<Message>) {
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

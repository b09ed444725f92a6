//! A stream from its first line to its end.

use std::io::IsTerminal;

use anyhow::{anyhow, bail};
use quadlift::online::{ObjectMap, OnlineOptions};
use quadlift::run::Check;
use quadlift::solve::PoseNoise;
use quadlift_io::priors::check_meters;
use quadlift_io::run::PriorSource;
use quadlift_io::stream::{
    AboutRecord, FrameLine, Line, LineError, OutputLine, PoseRecord, StreamState, StreamedScene, parse_line,
    read_state_file,
};
use serde_json::{Map, Value};

use super::Args;
use super::lines::{MAX_LINE, NextLine};
use super::map_file::MapFiles;
use super::rerun::Live;
use super::source::{Item, Source};
use super::words::in_words;
use crate::error;
use crate::output::{HEADING, Output};
use crate::words::count;

/// The state of a stream.
pub(super) struct Session<'a> {
    stream: StreamState,
    /// What is passed over of an input that is fed again.
    passed: Option<Passed>,
    save_every: Option<u64>,
    strict: bool,
    pose_noise: Option<PoseNoise>,
    out: &'a Output,
    /// Whether somebody reads the events.
    is_read: bool,
    /// Whether a person reads them, on a terminal.
    as_text: bool,
    live: Option<Live<'a>>,
    errors: u64,
    first_error: Option<String>,
    failed_writes: u64,
}

/// What was observed before the input was fed again.
struct Passed {
    time: f64,
    frame: String,
    /// Lines of new poses that followed the last frame.
    poses: u64,
    /// Whether the last frame came by; only poses are passed over then.
    is_over: bool,
    /// Frames that were passed over, and those of them that the state knows.
    frames: u64,
    known: u64,
}

impl Passed {
    /// Passes over a frame.
    ///
    /// # Errors
    /// It is not the frame that was observed under its id.
    fn pass(&mut self, line: &FrameLine, scene: &StreamedScene) -> anyhow::Result<()> {
        let id = &line.record.id;
        self.frames += 1;
        match scene.is_as_given(line) {
            Some(false) => {
                bail!("frame {id:?} has another pose or other boxes than when it was observed. {OTHER_RECORDING}")
            }
            Some(true) => self.known += 1,
            None => {}
        }
        // Times never go back: what is earlier was observed or refused, up to the last frame.
        self.is_over = line.record.time.unwrap_or_default() == self.time && *id == self.frame;
        Ok(())
    }

    /// That the frames that came by were those of the state.
    ///
    /// # Errors
    /// None of them was.
    fn end(&self) -> anyhow::Result<()> {
        if self.frames > 0 && self.known == 0 {
            let frames = count(self.frames as usize, "frame");
            bail!("the state knows none of the {frames} up to its time {}. {OTHER_RECORDING}", self.time);
        }
        Ok(())
    }
}

/// What to do about it.
const OTHER_RECORDING: &str =
    "The state is that of another recording; name its own with --state, or start anew without --resume";

impl<'a> Session<'a> {
    /// A stream from its beginning, or from where its state is.
    pub(super) fn new(
        posterior_options: OnlineOptions,
        args: &Args,
        (lasting, pose_noise): (&Map<String, Value>, Option<PoseNoise>),
        out: &'a Output,
    ) -> anyhow::Result<Self> {
        let stored = args.state.as_deref().filter(|path| args.resume && path.exists());
        let stream = match stored {
            Some(path) => read_state_file(path, posterior_options, lasting)?,
            None => StreamState { map: ObjectMap::new(posterior_options)?, scene: Default::default(), poses_since: 0 },
        };
        let last = stream.map.last_frame();
        let passed = last.map(|(frame, time)| Passed {
            time,
            frame: frame.to_owned(),
            poses: stream.poses_since,
            is_over: false,
            frames: 0,
            known: 0,
        });
        Ok(Self {
            passed,
            stream,
            save_every: args.save_every,
            strict: args.strict,
            pose_noise,
            out,
            is_read: true,
            as_text: !out.json && std::io::stdout().is_terminal(),
            live: None,
            errors: 0,
            first_error: None,
            failed_writes: 0,
        })
    }

    /// Shows the stream in Rerun from now on.
    pub(super) fn show(&mut self, live: Live<'a>) {
        self.live = Some(live);
    }

    /// Observes all frames of the input, until it ends, a signal comes or nobody reads the events.
    pub(super) fn run(&mut self, source: &mut Source, files: &MapFiles) -> anyhow::Result<()> {
        source.tell_that_it_waits(self.out);
        let needs_meters = matches!(files.options.priors, PriorSource::Builtin);
        if let Some(about) = source.about() {
            self.about(None, &about)?;
        }
        while self.is_read {
            let before = self.stream.map.frames();
            let (number, line) = match source.next()? {
                Item::End => return self.passed.as_ref().map_or(Ok(()), Passed::end),
                Item::Frame(frame) => (None, Ok(Line { frames: vec![*frame], ..Line::default() })),
                Item::Problem(problem) => (None, Err(LineError::new(problem))),
                Item::Line(NextLine::Text(number, text)) => (Some(number), parse_line(&text)),
                Item::Line(NextLine::TooLong(number)) => {
                    let problem = format!("the line is longer than {MAX_LINE} bytes");
                    (Some(number), Err(LineError::new(problem)))
                }
            };
            match line {
                Ok(line) => self.line(number, line, needs_meters)?,
                Err(error) => self.error(number, error)?,
            }
            let after = self.stream.map.frames();
            if let Some(every) = self.save_every
                && after / every > before / every
                && files.any_on_the_way()
                && let Err(error) = files.write(&self.stream, self.out)
            {
                // It may work the next time.
                self.out.error(&error::in_words(&error));
                self.failed_writes += 1;
            }
        }
        Ok(())
    }

    fn line(&mut self, number: Option<u64>, line: Line, needs_meters: bool) -> anyhow::Result<()> {
        let Line { about, frames, poses, is_list } = line;
        if about != AboutRecord::default() {
            self.about(number, &about)?;
        }
        for (index, frame) in frames.into_iter().enumerate() {
            if needs_meters && let Err(problem) = check_meters(self.stream.scene.about().length_unit.as_deref()) {
                bail!("{problem}");
            }
            self.frame(number, is_list.then_some(index), frame)?;
        }
        poses.map_or(Ok(()), |poses| self.poses(number, &poses))
    }

    fn about(&mut self, number: Option<u64>, about: &AboutRecord) -> anyhow::Result<()> {
        match self.stream.scene.take_in(about) {
            Ok(()) => {
                if let (Some(live), Some(up)) = (&mut self.live, about.up) {
                    live.up(up);
                }
                Ok(())
            }
            Err(error) => self.error(number, LineError::of_entry(&error)),
        }
    }

    /// Observes a frame; `index` is its place in the list of the line.
    fn frame(&mut self, number: Option<u64>, index: Option<usize>, frame: FrameLine) -> anyhow::Result<()> {
        let (id, time) = (frame.record.id.clone(), frame.record.time.unwrap_or_default());
        if let Some(passed) = &mut self.passed {
            if !passed.is_over && time <= passed.time {
                return passed.pass(&frame, &self.stream.scene);
            }
            passed.end()?;
        }
        let error = |mut error: LineError| {
            if let Some(index) = index {
                error.message = format!("frames[{index}]: {}", error.message);
            }
            error.in_frame(&id)
        };
        let image = frame.record.image.clone();
        let checked = self.stream.scene.check(frame, &self.stream.map);
        let mut checked = match checked {
            Ok(checked) => checked,
            Err(problem) => return self.error(number, error(LineError::of_entry(&problem))),
        };
        checked.frame.pose_noise = checked.frame.pose_noise.or(self.pose_noise);
        let update = match self.stream.map.observe(&checked.frame, &checked.detections()) {
            Ok(update) => update,
            Err(problem) => return self.error(number, error(LineError::new(problem))),
        };
        if let Some(live) = &mut self.live {
            live.frame(&self.stream.map, (&checked, image.as_deref()), &update);
        }
        self.stream.scene.keep(checked, &self.stream.map);
        self.stream.poses_since = 0;
        self.passed = None;
        self.print(&OutputLine::of_frame(&id, &update))
    }

    fn poses(&mut self, number: Option<u64>, poses: &[PoseRecord]) -> anyhow::Result<()> {
        if let Some(passed) = &mut self.passed {
            // Those before the last frame, and so many after it, are in the map.
            if !passed.is_over {
                return Ok(());
            }
            if let Some(left) = passed.poses.checked_sub(1) {
                passed.poses = left;
                return Ok(());
            }
        }
        match self.stream.scene.take_in_poses(poses) {
            Ok(updates) => {
                let update = self.stream.map.update_poses(&updates);
                self.stream.poses_since += 1;
                if let Some(live) = &mut self.live {
                    live.others(&self.stream.map, &update);
                }
                self.print(&OutputLine::of_poses(updates.len(), &update))
            }
            Err(error) => self.error(number, LineError::of_entry(&error)),
        }
    }

    /// Reports a line or a frame that is wrong.
    fn error(&mut self, number: Option<u64>, error: LineError) -> anyhow::Result<()> {
        if self.passed.as_ref().is_some_and(|passed| !passed.is_over) {
            // It was reported when it was read for the first time.
            return Ok(());
        }
        self.errors += 1;
        let message = error.message.clone();
        let line = number.map_or(String::new(), |number| format!("line {number}: "));
        self.first_error.get_or_insert_with(|| format!("{line}{message}"));
        if let Some(live) = &mut self.live {
            let frame = error.frame.as_ref().map_or(String::new(), |id| format!("{id}: "));
            live.error(&self.stream.map, format!("{line}{frame}{message}"));
        }
        self.print(&OutputLine::of_error(number, error))?;
        if self.strict {
            bail!("{line}{message}");
        }
        Ok(())
    }

    fn print(&mut self, line: &OutputLine) -> anyhow::Result<()> {
        if self.is_read {
            let text = if self.as_text { in_words(line, &self.stream.map) } else { line.to_text() };
            self.is_read = self.out.stream_line(&text)?;
        }
        Ok(())
    }

    /// Settles the map, prints what that has changed, and writes the files; returns what has come out, in one line, and the
    /// consistency check. Nothing is written if the input has no frame but errors: an earlier map would be lost.
    pub(super) fn end(&mut self, files: &MapFiles) -> (String, anyhow::Result<Check>) {
        if let Some(first) = self.first_error.as_ref().filter(|_| self.stream.map.frames() == 0) {
            let errors = count(self.errors as usize, "error");
            return (String::new(), Err(anyhow!("no frame could be read; {errors} in the input, the first: {first}")));
        }
        let mut settled = self.stream.map.clone();
        let update = settled.settle();
        if let Some(mut live) = self.live.take() {
            live.others(&settled, &update);
            live.finish();
        }
        let printed = match update.events.is_empty() {
            true => Ok(()),
            false => self.print(&OutputLine::of_end(settled.frames(), &update)),
        };
        let written = printed.and_then(|()| files.write_at_end(&self.stream, &settled, self.out));
        (self.in_words(&settled), written)
    }

    /// Whether files could not be written on the way.
    pub(super) fn has_failed_writes(&self) -> bool {
        self.failed_writes > 0
    }

    /// What has come out, in one line.
    fn in_words(&self, settled: &ObjectMap) -> String {
        let gone = settled.objects().filter(|object| object.presence == quadlift::online::Presence::Gone).count();
        let frames = count(settled.frames() as usize, "frame");
        let mut text = format!("{HEADING}{frames}{HEADING:#}: {}", count(settled.objects().count(), "object"));
        if gone > 0 {
            text.push_str(&format!(", {gone} gone"));
        }
        if self.errors > 0 {
            let first = self.first_error.as_deref().unwrap_or_default();
            text.push_str(&format!("; {} in the input, the first: {first}", count(self.errors as usize, "error")));
        }
        text
    }
}

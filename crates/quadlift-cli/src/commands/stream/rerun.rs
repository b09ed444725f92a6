//! A live view of the map in Rerun. A Python process logs the records of the map with Rerun's SDK, through the same module as the
//! Python package.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, channel, sync_channel};
use std::thread::{Builder, sleep};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use nalgebra::Vector3;
use quadlift::online::{FrameUpdate, ObjectMap};
use quadlift_io::stream::CheckedFrame;
use quadlift_report::{LiveEvent, LiveMap, LiveRecord};
use serde_json::json;

use crate::output::Output;

/// Also a module of the Python package, which links to it.
const SCRIPT: &str = include_str!("rerun_log.py");

/// Runs the script, which stands before the records on the standard input. Modules of the current folder are not used, and a
/// viewer that it starts inherits neither records nor answers.
const START: &str = r#"
import os, sys
sys.path[:] = [path for path in sys.path if path]
lines, status = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "w")
os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
os.dup2(2, 1)
scope = {"__name__": "rerun_log"}
try:
    exec(compile(lines.read(int(sys.argv[1])), "rerun_log.py", "exec"), scope)
    import rerun
except ImportError as error:
    print(f"error: {error}; install Rerun's SDK with `{sys.executable} -m pip install rerun-sdk`", file=status, flush=True)
else:
    scope["serve"](lines, status)
"#;

/// Names the interpreter.
const PYTHON: &str = "QUADLIFT_PYTHON";

/// Records that wait to be logged, at most.
const WAITING: usize = 64;

/// How long Rerun may take nothing, before it is given up; the script gives up a viewer earlier.
const PATIENCE: Duration = Duration::from_secs(30);

/// How long Python may take to import Rerun's SDK and to open the target.
const PATIENCE_AT_START: Duration = Duration::from_secs(120);

/// Why there are no answers.
const ENDED: &str = "the Python process has ended";

/// Where records go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Target {
    /// The viewer on this machine, which is started if there is none.
    Local,
    /// A viewer with this address.
    Address(String),
    /// A recording.
    File(PathBuf),
}

impl Target {
    /// Reads the value of `--rerun`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let lower = text.to_ascii_lowercase();
        if text.is_empty() {
            return Ok(Self::Local);
        }
        if lower.ends_with(".rrd") && !lower.contains("://") {
            return Ok(Self::File(text.into()));
        }
        let (scheme, rest) = text.split_once("://").unwrap_or(("rerun+http", text));
        let (host, path) = rest.split_once('/').unwrap_or((rest, "proxy"));
        let has_port =
            host.rsplit_once(':').is_some_and(|(name, port)| !name.is_empty() && port.parse::<u16>().is_ok());
        match has_port && ["rerun", "rerun+http", "rerun+https"].contains(&scheme) {
            true => Ok(Self::Address(format!("{scheme}://{host}/{}", if path.is_empty() { "proxy" } else { path }))),
            false => Err("expected a recording, OUT.rrd, or the address of a viewer, such as 127.0.0.1:9876 or \
                      rerun+http://127.0.0.1:9876/proxy"
                .to_owned()),
        }
    }
}

/// A live view.
pub(super) struct Live<'a> {
    map: LiveMap,
    /// The folder that paths of images are relative to.
    folder: PathBuf,
    /// The direction against gravity, until it is logged.
    up: Option<[f64; 3]>,
    /// `None` once Rerun is gone.
    records: Option<SyncSender<String>>,
    answers: Receiver<String>,
    child: Child,
    out: &'a Output,
}

impl<'a> Live<'a> {
    /// Starts Python, and waits until it has opened the target.
    pub(super) fn start(target: &Target, input: Option<&Path>, out: &'a Output) -> anyhow::Result<Self> {
        let python =
            std::env::var_os(PYTHON).unwrap_or_else(|| if cfg!(windows) { "python" } else { "python3" }.into());
        let shown = python.to_string_lossy().into_owned();
        let mut command = Command::new(&python);
        command.arg("-c").arg(START).arg(SCRIPT.len().to_string());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        if out.quiet {
            command.stderr(Stdio::null());
        }
        let mut child = command.spawn().with_context(|| {
            format!("--rerun needs Python with Rerun's SDK (rerun-sdk); cannot start {shown} ({PYTHON} names another)")
        })?;
        let target = json!({
            "name": input.map(|path| path.display().to_string()),
            "file": match target { Target::File(path) => Some(path), _ => None },
            "address": match target { Target::Address(address) => Some(address), _ => None },
        });
        let (records, to_writer) = sync_channel(WAITING);
        let (to_us, answers) = channel();
        if let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) {
            let first = format!("{SCRIPT}{target}\n");
            Builder::new().name("rerun".to_owned()).spawn(move || write_all(input, &first, &to_writer))?;
            let read = move || {
                let answers = BufReader::new(output.take(1 << 20)).lines().map_while(Result::ok);
                answers.take_while(|answer| to_us.send(answer.clone()).is_ok()).for_each(drop);
            };
            Builder::new().name("rerun answers".to_owned()).spawn(read)?;
        }
        let answer = answers.recv_timeout(PATIENCE_AT_START);
        if answer.as_deref() != Ok("ready") {
            let _ = child.kill();
            let _ = child.wait();
        }
        match answer.as_deref() {
            Ok("ready") => {}
            Ok(problem) => bail!("--rerun: {}", problem.trim_start_matches("error: ")),
            Err(_) => bail!("--rerun: {shown} has failed; it needs Rerun's SDK (pip install rerun-sdk)"),
        }
        let folder = input.and_then(Path::parent).unwrap_or(Path::new("")).to_owned();
        Ok(Self { map: LiveMap::default(), folder, up: None, records: Some(records), answers, child, out })
    }

    /// The direction against gravity, from the next record on.
    pub(super) fn up(&mut self, up: [f64; 3]) {
        self.up = Vector3::from(up).try_normalize(0.0).map(Into::into);
    }

    /// Logs a frame that was observed, and its image.
    pub(super) fn frame(
        &mut self,
        map: &ObjectMap,
        (checked, image): (&CheckedFrame, Option<&str>),
        update: &FrameUpdate,
    ) {
        let mut record = self.map.frame(map, &checked.frame, &checked.detections(), update);
        // Boxes are those of a pinhole camera, and so are images without a lens.
        if let (Some(frame), Some(image), None) = (&mut record.frame, image, &checked.frame.lens) {
            frame.image = self.folder.join(image).to_str().map(str::to_owned);
        }
        self.log(record);
    }

    /// Logs new poses, or the end.
    pub(super) fn others(&mut self, map: &ObjectMap, update: &FrameUpdate) {
        let record = self.map.others(map, update);
        self.log(record);
    }

    /// Logs an error in the input.
    pub(super) fn error(&mut self, map: &ObjectMap, text: String) {
        self.log(LiveRecord::of_event(map, LiveEvent::error(text)));
    }

    fn log(&mut self, record: LiveRecord) {
        let record = LiveRecord { up: self.up.take(), ..record };
        let Some(records) = &self.records else { return };
        let Ok(mut line) = serde_json::to_string(&record) else { return };
        line.push('\n');
        let began = Instant::now();
        loop {
            line = match records.try_send(line) {
                Ok(()) => return,
                Err(TrySendError::Full(line)) if began.elapsed() < PATIENCE => line,
                Err(_) => return self.give_up(),
            };
            sleep(Duration::from_millis(1));
        }
    }

    /// Waits until everything is logged.
    pub(super) fn finish(mut self) {
        if self.records.take().is_none() {
            return;
        }
        match self.answers.recv_timeout(PATIENCE) {
            Ok(answer) if answer == "done" => drop(self.child.wait()),
            Ok(answer) => self.end(&answer),
            Err(RecvTimeoutError::Timeout) => self.end("it does not end"),
            Err(RecvTimeoutError::Disconnected) => self.end(ENDED),
        }
    }

    fn give_up(&mut self) {
        self.records = None;
        match self.answers.recv_timeout(Duration::from_secs(1)) {
            Ok(answer) => self.end(&answer),
            Err(RecvTimeoutError::Timeout) => self.end("it takes no more records"),
            Err(RecvTimeoutError::Disconnected) => self.end(ENDED),
        }
    }

    fn end(&mut self, reason: &str) {
        let reason = reason.trim_start_matches("error: ");
        self.out.warning(&format!("Rerun shows no more of the stream, which goes on without it: {reason}"));
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes records until there are no more or nobody reads them.
fn write_all(mut input: ChildStdin, first: &str, records: &Receiver<String>) {
    if input.write_all(first.as_bytes()).is_err() {
        return;
    }
    for line in records {
        if input.write_all(line.as_bytes()).is_err() {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets() {
        let address = |text: &str| Ok(Target::Address(text.to_owned()));
        assert_eq!(Target::parse(""), Ok(Target::Local));
        assert_eq!(Target::parse("a/out.rrd"), Ok(Target::File("a/out.rrd".into())));
        assert_eq!(Target::parse("robot:9876"), address("rerun+http://robot:9876/proxy"));
        assert_eq!(Target::parse("[::1]:9876"), address("rerun+http://[::1]:9876/proxy"));
        for given in ["rerun+http://robot:1/proxy", "rerun+http://robot:1", "rerun+http://robot:1/"] {
            assert_eq!(Target::parse(given), address("rerun+http://robot:1/proxy"));
        }
        for wrong in ["scene.json", "http://robot:9876", "robot", "rerun://", "robot:port", ":9876"] {
            assert!(Target::parse(wrong).is_err(), "{wrong}");
        }
    }
}

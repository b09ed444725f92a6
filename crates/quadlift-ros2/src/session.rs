//! What the node does with its messages, without a network: messages as bytes in, actions out.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use quadlift::online::{Event, ObjectMap};
use quadlift::scene;
use quadlift_io::mcap::{LiveFrames, Next};
use quadlift_io::scene_file::CameraRecord;
use quadlift_io::stream::{
    AboutRecord, FrameLine, LineError, OutputLine, StreamState, inconsistency_in_words, read_state_file, write_state,
};
use quadlift_io::{write_file, write_scene_file};

use crate::arguments::Level;
use crate::bytes::Bytes;
use crate::estimation::{Estimate, Snapshot, text_message};
use crate::options::Options;
use crate::query::{Query, refusal};
use crate::status::{Status, StatusLevel};

/// What the node has to do.
#[derive(Debug)]
pub enum Action {
    /// Send a message.
    Publish(Output, Bytes),
    /// Tell the user.
    Log(Level, String),
    /// Estimate a map, on another thread, and give the estimate to [`Session::estimated`].
    Estimate(Box<Snapshot>),
}

/// What the node publishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// `vision_msgs/Detection3DArray`, latched.
    Map,
    /// `visualization_msgs/MarkerArray`, latched.
    Markers,
    /// `std_msgs/String`: the objects as a scene file, latched.
    ObjectsJson,
    /// `std_msgs/String`: what a frame has changed, a line of `quadlift stream`.
    Events,
    /// `diagnostic_msgs/DiagnosticArray`: whether poses, cameras and boxes are consistent.
    Diagnostics,
}

/// The map with what it is made from.
#[derive(Debug)]
pub struct Session {
    options: Options,
    live: LiveFrames,
    stream: StreamState,
    /// The last image of each camera, by the id of the camera; all are of the last second.
    last_images: BTreeMap<String, (f64, scene::Frame)>,
    latest: Option<Arc<Estimate>>,
    /// Whether the map has changed since the last snapshot.
    has_changed: bool,
    is_estimating: bool,
    /// When the last snapshot was made.
    last_snapshot: f64,
    /// When the last diagnostic status was published.
    last_status: f64,
    actions: VecDeque<Action>,
}

/// Images that are older than this, compared with the newest one, are not in view; seconds.
const IN_VIEW: f64 = 1.0;

/// How often a diagnostic status is published, seconds: as `diagnostic_updater` does.
const STATUS_PERIOD: f64 = 1.0;

impl Session {
    /// An empty map, or the one of the state if the node goes on.
    ///
    /// # Errors
    /// A text that names the parameter or the file.
    pub fn new(options: Options) -> Result<Self, String> {
        let live = LiveFrames::new(options.live.clone())?;
        let stream = new_stream(&options)?;
        let mut session = Self {
            live,
            stream,
            last_images: BTreeMap::new(),
            latest: None,
            has_changed: true,
            is_estimating: false,
            last_snapshot: f64::NEG_INFINITY,
            last_status: f64::NEG_INFINITY,
            actions: VecDeque::new(),
            options,
        };
        if session.options.resume && session.options.files.state.as_ref().is_some_and(|path| path.exists()) {
            let text = session.load()?;
            session.log(Level::Info, text);
        }
        Ok(session)
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The options that can change.
    pub fn set(&mut self, files: crate::options::Files, publish_period: f64) {
        self.options.files = files;
        self.options.publish_period = publish_period;
    }

    /// A `tf2_msgs/TFMessage`; `is_fixed`: its transforms hold at every time.
    pub fn transforms(&mut self, topic: &str, message: &Bytes, is_fixed: bool) {
        self.live.transforms(topic, &message.0, is_fixed);
    }

    /// A `sensor_msgs/CameraInfo`.
    pub fn calibration(&mut self, topic: &str, message: &Bytes) {
        self.live.calibration(topic, &message.0);
    }

    /// A `vision_msgs/Detection2DArray` that came at `now`, seconds from any origin.
    pub fn detections(&mut self, topic: &str, message: &Bytes, now: f64) {
        self.live.detections(topic, &message.0, now);
    }

    /// Observes the frames that are ready at `now`, and says what is to be done.
    pub fn work(&mut self, now: f64) -> impl Iterator<Item = Action> {
        while let Some(next) = self.live.next_frame(now) {
            match next {
                Next::Frame(frame) => self.frame(*frame),
                Next::Problem(problem) | Next::Outside(problem) => {
                    // The options of the program are parameters here.
                    let text = problem.to_string().replace("--max-gap", "max_gap");
                    self.log(Level::Warn, text.replace("--time-tolerance", "time_tolerance"));
                }
            }
        }
        if self.has_changed && !self.is_estimating && now - self.last_snapshot >= self.options.publish_period {
            self.has_changed = false;
            self.is_estimating = true;
            self.last_snapshot = now;
            self.actions.push_back(Action::Estimate(Box::new(Snapshot::new(&self.stream))));
        }
        if now - self.last_status >= STATUS_PERIOD {
            self.last_status = now;
            let status = self.status().message(self.stream.map.last_frame());
            self.actions.push_back(Action::Publish(Output::Diagnostics, status));
        }
        std::mem::take(&mut self.actions).into_iter()
    }

    /// Whether poses, cameras and boxes are consistent, by the frames so far and the last estimate.
    fn status(&self) -> Status {
        let map = &self.stream.map;
        let of_estimate = self.latest.as_ref().and_then(|estimate| estimate.result.run_record()?.diagnosis);
        let of_estimate = of_estimate.filter(|found| !found.consistent).and_then(|found| found.of_map_in_words());
        let level = match (map.consistent(), &of_estimate) {
            (Some(false), _) => StatusLevel::Error(inconsistency_in_words(map.diagnosis())),
            (_, Some(words)) => StatusLevel::Error(words.clone()),
            (Some(true), None) => StatusLevel::Ok,
            (None, None) => StatusLevel::NotChecked,
        };
        Status { name: self.options.status_name.clone(), level, frames: map.frames(), objects: map.objects().count() }
    }

    /// Whether detections wait, so that [`Self::work`] should be called soon.
    pub fn is_waiting(&self) -> bool {
        self.live.waiting() > 0
    }

    /// Publishes an estimate that was asked for.
    pub fn estimated(&mut self, estimate: Result<Estimate, String>) {
        self.is_estimating = false;
        match estimate {
            Ok(estimate) => {
                let Estimate { detections, markers, json, .. } = &estimate;
                let messages = [
                    (Output::Map, detections.clone()),
                    (Output::Markers, markers.clone()),
                    (Output::ObjectsJson, json.clone()),
                ];
                self.actions.extend(messages.map(|(output, message)| Action::Publish(output, message)));
                self.latest = Some(Arc::new(estimate));
            }
            Err(problem) => self.log(Level::Error, format!("the map cannot be estimated: {problem}")),
        }
    }

    fn log(&mut self, level: Level, text: String) {
        self.actions.push_back(Action::Log(level, text));
    }

    fn frame(&mut self, mut frame: FrameLine) {
        let id = frame.record.id.clone();
        self.name_camera(&mut frame);
        let camera = frame.camera.as_ref().and_then(|camera| camera.id.clone()).unwrap_or_default();
        let refused = |error: LineError| format!("the frame {id} is dropped: {}", error.message);
        let checked = self.stream.scene.check(frame, &self.stream.map).map_err(|e| LineError::of_entry(&e));
        let mut checked = match checked {
            Ok(checked) => checked,
            Err(error) => return self.log(Level::Warn, refused(error)),
        };
        checked.frame.pose_noise = checked.frame.pose_noise.or(self.options.pose_noise);
        let update = match self.stream.map.observe(&checked.frame, &checked.detections()) {
            Ok(update) => update,
            Err(error) => return self.log(Level::Warn, refused(LineError::new(error))),
        };
        let frame = &checked.frame;
        let image = scene::Frame {
            id: frame.id.clone(),
            projection: frame.projection,
            image_size: frame.image_size,
            lens: frame.lens,
            rig: None,
        };
        let now = frame.time;
        self.last_images.insert(camera_name(&camera).to_owned(), (now, image));
        self.last_images.retain(|_, (time, _)| now - *time <= IN_VIEW);
        self.stream.scene.keep(checked, &self.stream.map);
        self.stream.poses_since = 0;
        self.has_changed = true;
        for event in &update.events {
            if let Event::Inconsistent { diagnosis } = event {
                self.log(Level::Error, format!("the scene is inconsistent: {}", inconsistency_in_words(diagnosis)));
            }
        }
        let line = OutputLine::of_frame(&id, &update).to_text();
        self.actions.push_back(Action::Publish(Output::Events, text_message(line.trim_end())));
        self.log(Level::Debug, line.trim_end().to_owned());
    }

    /// Gives a camera another id if the map, which may be that of an earlier day, has one with other numbers.
    fn name_camera(&self, frame: &mut FrameLine) {
        let Some(camera) = &mut frame.camera else { return };
        let Some(id) = camera.id.clone() else { return };
        let is_other = |known: &CameraRecord| {
            known.model != camera.model
                || known.params != camera.params
                || (known.width, known.height) != (camera.width, camera.height)
        };
        let names = std::iter::once(id.clone()).chain((2..).map(|n| format!("{}#{n}", camera_name(&id))));
        let mut free = names.filter(|name| !self.stream.scene.camera(name).is_some_and(is_other));
        camera.id = free.next();
    }

    /// Writes the state and the result, those of them that have a file.
    ///
    /// # Errors
    /// A text that names the file.
    pub fn save(&mut self) -> Result<String, String> {
        let files = self.options.files.clone();
        let mut written = Vec::new();
        if let Some(path) = &files.state {
            write_file(path, |out| write_state(out, &self.stream, &self.options.lasting))
                .map_err(|error| error.to_string())?;
            written.push(path.display().to_string());
        }
        if let Some(path) = &files.map {
            let result = Snapshot::new(&self.stream).result(&self.options)?;
            write_scene_file(path, &result).map_err(|error| error.to_string())?;
            written.push(path.display().to_string());
        }
        match written.as_slice() {
            [] => Err("nothing is written: the parameters state_file and map_file are empty".to_owned()),
            names => Ok(format!("wrote {} ({} frames)", names.join(" and "), self.stream.map.frames())),
        }
    }

    /// Goes on from the state in its file.
    ///
    /// # Errors
    /// A text that names the file; then the map stays as it is.
    pub fn load(&mut self) -> Result<String, String> {
        let path = self.options.files.state.clone().ok_or("the parameter state_file is empty")?;
        let stored = read_state_file(&path, self.options.map.clone(), &self.options.lasting);
        self.stream = stored.map_err(|error| error.to_string())?;
        self.has_changed = true;
        self.last_images.clear();
        let map = &self.stream.map;
        Ok(format!("goes on from {}: {} objects, {} frames", path.display(), map.objects().count(), map.frames()))
    }

    /// Begins with an empty map.
    ///
    /// # Errors
    /// None in practice: the options were checked.
    pub fn reset(&mut self) -> Result<String, String> {
        self.stream = new_stream(&self.options)?;
        self.has_changed = true;
        self.last_images.clear();
        Ok("the map is empty".to_owned())
    }

    /// Answers a request of `quadlift_msgs/QueryObjects` from the last estimate.
    pub fn query(&self, request: &Bytes) -> Bytes {
        let Some(estimate) = &self.latest else { return refusal("there is no estimate so far") };
        let views: Vec<_> = self.last_images.iter().map(|(id, (_, frame))| (id.clone(), frame.clone())).collect();
        let at = (self.options.live.world_frame.as_str(), estimate.stamp);
        let answer = Query::read(&request.0).and_then(|query| query.answer(&estimate.result, &views, at));
        answer.unwrap_or_else(|problem| refusal(&problem))
    }
}

/// The id of a camera without the number of its calibration.
fn camera_name(id: &str) -> &str {
    id.split_once('#').map_or(id, |(name, _)| name)
}

fn new_stream(options: &Options) -> Result<StreamState, String> {
    let map = ObjectMap::new(options.map.clone()).map_err(|error| error.to_string())?;
    let mut stream = StreamState { map, scene: Default::default(), poses_since: 0 };
    // REP 103: meters; frames of robots and maps have z up, those of cameras do not.
    let up = (!options.live.world_frame.contains("optical")).then_some([0.0, 0.0, 1.0]);
    let about = AboutRecord { length_unit: Some("m".to_owned()), up, ..AboutRecord::default() };
    stream.scene.take_in(&about).map_err(|error| format!("{}: {}", error.entry, error.problem))?;
    Ok(stream)
}

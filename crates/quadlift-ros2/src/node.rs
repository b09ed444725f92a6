//! The node in a network: DDS on one side, a [`Session`] on the other. All decisions are the session's.

use std::collections::HashMap;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use futures::stream::{BoxStream, StreamExt, select_all};
use quadlift_io::mcap::CdrWriter;
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::ros2::LogLevel;
use ros2_client::{
    Context, ContextOptions, MessageTypeName, Name, Node, NodeName, NodeOptions, ParameterValue, Publisher, QosProfile,
    RmwRequestId, Server, ServiceMapping, ServiceTypeName, Subscription, rosout,
};

use crate::arguments::{Arguments, Level};
use crate::bytes::Bytes;
use crate::estimation::{Estimate, Snapshot};
use crate::options::Options;
use crate::options::{Files, publish_period};
use crate::parameters::{self, Value};
use crate::session::Session;
use crate::session::{Action, Output};

/// Messages between the threads, at most; then DDS keeps the newest ones.
const MAX_EVENTS: usize = 1000;
/// How often waiting detections are looked at.
const SOON: Duration = Duration::from_millis(10);
/// How often anything else is looked at.
const SELDOM: Duration = Duration::from_millis(100);
/// The same message is written once in this time.
const QUIET: Duration = Duration::from_secs(5);

/// What a subscription gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Input {
    Transforms,
    FixedTransforms,
    Calibration,
    Detections,
}

/// The services.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Service {
    Save,
    Load,
    Reset,
    Query,
}

/// What another thread says.
enum Event {
    Message(Input, Arc<str>, Bytes),
    Request(Service, RmwRequestId, Bytes),
    Estimate(Box<Result<Estimate, String>>),
    /// What a thread could not do.
    Problem(String),
    /// A signal came.
    Stop,
}

type Servers = Vec<(Service, Arc<Server<Bytes, Bytes>>)>;

/// Runs the node until a signal comes.
///
/// # Errors
/// A text if the node cannot start.
pub fn run(arguments: &Arguments) -> Result<(), String> {
    let options = Options::new(arguments)?;
    let mut session = Session::new(options)?;
    let (sender, receiver) = sync_channel(MAX_EVENTS);
    stop_on_signals(sender.clone())?;
    let is_running = Arc::new(AtomicBool::new(false));
    let mut node = create_node(arguments, is_running.clone())?;
    let inputs = subscribe(&mut node, arguments, session.options())?;
    let outputs = publish(&mut node, arguments)?;
    let servers = serve(&mut node, arguments)?;
    let spinner = node.spinner().map_err(|error| format!("cannot start the services of parameters: {error}"))?;
    is_running.store(true, Ordering::Relaxed);
    start_thread("services of parameters", move || {
        // It ends with the node.
        let _ = futures::executor::block_on(spinner.spin());
    })?;
    let (to_inputs, to_estimates) = (sender.clone(), sender);
    let requests = servers.clone();
    start_thread("messages", move || futures::executor::block_on(forward(&inputs, &requests, &to_inputs)))?;
    let jobs = start_estimation(session.options().clone(), to_estimates)?;
    let log = Log { node, level: arguments.log_level, last: HashMap::new() };
    Runner { log, outputs, servers, jobs, start: Instant::now() }.run(&mut session, &receiver)
}

fn start_thread(name: &str, work: impl FnOnce() + Send + 'static) -> Result<(), String> {
    let thread = thread::Builder::new().name(name.to_owned()).spawn(work);
    thread.map(drop).map_err(|error| format!("cannot start a thread: {error}"))
}

fn stop_on_signals(sender: SyncSender<Event>) -> Result<(), String> {
    let signals = signal_hook::iterator::Signals::new([signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM]);
    let mut signals = signals.map_err(|error| format!("cannot watch signals: {error}"))?;
    start_thread("signals", move || {
        for (count, _) in signals.forever().enumerate() {
            if count > 0 {
                std::process::exit(130);
            }
            let _ = sender.send(Event::Stop);
        }
    })
}

fn create_node(arguments: &Arguments, is_running: Arc<AtomicBool>) -> Result<Node, String> {
    let domain = match std::env::var("ROS_DOMAIN_ID") {
        Ok(text) if !text.is_empty() => {
            text.parse().map_err(|_| format!("ROS_DOMAIN_ID is \"{text}\"; expected a number from 0 to 232"))?
        }
        _ => 0,
    };
    let context = Context::with_options(ContextOptions::new().domain_id(domain));
    let context = context.map_err(|error| format!("cannot join the network: {error}"))?;
    let name = NodeName::new(&arguments.namespace, &arguments.name)
        .map_err(|error| format!("the node's name {}: {error}", arguments.full_name()))?;
    let mut options = NodeOptions::new();
    for (name, value) in arguments.parameters.iter() {
        options = options.declare_parameter(name, parameter_value(value));
    }
    let changing: Vec<&str> = parameters::all().iter().filter(|p| p.can_change).map(|p| p.name).collect();
    options = options.parameter_validator(Box::new(move |name, value| {
        if is_running.load(Ordering::Relaxed) && !changing.contains(&name) {
            return Err(format!("{name} is read when the node starts; {} can be set", changing.join(", ")));
        }
        match value {
            ParameterValue::Double(seconds) if name == "publish_period" => publish_period(*seconds).map(drop),
            ParameterValue::NotSet => Err(format!("{name} cannot be deleted")),
            _ => Ok(()),
        }
    }));
    context.new_node(name, options).map_err(|error| format!("cannot create the node: {error}"))
}

fn parameter_value(value: &Value) -> ParameterValue {
    match value {
        Value::Bool(x) => ParameterValue::Boolean(*x),
        Value::Integer(x) => ParameterValue::Integer(*x),
        Value::Double(x) => ParameterValue::Double(*x),
        Value::Text(x) => ParameterValue::String(x.clone()),
        Value::Doubles(x) => ParameterValue::DoubleArray(x.clone()),
        Value::Texts(x) => ParameterValue::StringArray(x.clone()),
    }
}

/// A name of a topic or a service in its two parts.
fn split_name(name: &str) -> Result<Name, String> {
    let (namespace, base) = name.rsplit_once('/').unwrap_or(("", name));
    let namespace = if namespace.is_empty() { "/" } else { namespace };
    Name::new(namespace, base).map_err(|error| format!("the name {name}: {error}"))
}

fn reliable(depth: usize) -> QosProfile {
    QosProfile::publisher_default().reliability_reliable(WhenFull::Fail).history(History::KeepLast { depth })
}

fn latched(depth: usize) -> QosProfile {
    reliable(depth).durability(Durability::TransientLocal)
}

/// Depth of the queue of messages that the node receives.
const DEPTH: usize = 100;

type Inputs = Vec<(Input, Arc<str>, Subscription<Bytes>)>;

fn subscribe(node: &mut Node, arguments: &Arguments, options: &Options) -> Result<Inputs, String> {
    // Matches both kinds of publishers; calibrations come again.
    let unreliable = reliable(DEPTH).reliability_best_effort();
    let detections = if options.reliable_detections { reliable(DEPTH) } else { unreliable.clone() };
    let mut all = vec![
        (Input::FixedTransforms, arguments.resolve("/tf_static"), "tf2_msgs/TFMessage", latched(DEPTH)),
        (Input::Transforms, arguments.resolve("/tf"), "tf2_msgs/TFMessage", reliable(DEPTH)),
    ];
    for topic in &options.camera_info_topics {
        all.push((Input::Calibration, topic.clone(), "sensor_msgs/CameraInfo", unreliable.clone()));
    }
    for topic in &options.detections_topics {
        all.push((Input::Detections, topic.clone(), "vision_msgs/Detection2DArray", detections.clone()));
    }
    let subscriptions = all.into_iter().map(|(input, topic, kind, qos)| {
        let in_words = |error| format!("cannot subscribe to {topic}: {error}");
        let (package, name) = kind.split_once('/').unwrap_or_default();
        let dds =
            node.create_topic(&split_name(&topic)?, MessageTypeName::new(package, name), &qos).map_err(in_words)?;
        let subscription = node.create_subscription(&dds, Some(qos)).map_err(in_words)?;
        Ok((input, topic.as_str().into(), subscription))
    });
    subscriptions.collect()
}

type Outputs = Vec<(Output, Publisher<Bytes>)>;

fn publish(node: &mut Node, arguments: &Arguments) -> Result<Outputs, String> {
    let all = [
        (Output::Map, "~/map", ("vision_msgs", "Detection3DArray"), latched(1)),
        (Output::Markers, "~/markers", ("visualization_msgs", "MarkerArray"), latched(1)),
        (Output::ObjectsJson, "~/objects_json", ("std_msgs", "String"), latched(1)),
        (Output::Events, "~/events", ("std_msgs", "String"), reliable(DEPTH)),
        (Output::Diagnostics, "/diagnostics", ("diagnostic_msgs", "DiagnosticArray"), reliable(10)),
    ];
    let publishers = all.into_iter().map(|(output, name, (package, kind), qos)| {
        let topic = arguments.resolve(name);
        let in_words = |error| format!("cannot publish {topic}: {error}");
        let dds =
            node.create_topic(&split_name(&topic)?, MessageTypeName::new(package, kind), &qos).map_err(in_words)?;
        Ok((output, node.create_publisher(&dds, Some(qos)).map_err(in_words)?))
    });
    publishers.collect()
}

fn serve(node: &mut Node, arguments: &Arguments) -> Result<Servers, String> {
    let trigger = ("std_srvs", "Trigger");
    let all = [
        (Service::Save, "~/save", trigger),
        (Service::Load, "~/load", trigger),
        (Service::Reset, "~/reset", trigger),
        (Service::Query, "~/query", ("quadlift_msgs", "QueryObjects")),
    ];
    let servers = all.into_iter().map(|(service, name, (package, kind))| {
        let name = arguments.resolve(name);
        let kind = ServiceTypeName::new(package, kind);
        let mapping = ServiceMapping::Enhanced;
        let server = node.create_server(mapping, &split_name(&name)?, &kind, reliable(10), reliable(10));
        let server = server.map_err(|error| format!("cannot offer the service {name}: {error}"))?;
        Ok((service, Arc::new(server)))
    });
    servers.collect()
}

/// Sends what comes from the network to the session, until it has gone.
async fn forward(inputs: &Inputs, servers: &Servers, sender: &SyncSender<Event>) {
    let mut streams: Vec<BoxStream<Event>> = Vec::new();
    for (input, topic, subscription) in inputs {
        let event = move |message| match message {
            Ok((message, _)) => Event::Message(*input, topic.clone(), message),
            Err(error) => Event::Problem(format!("{topic}: a message is lost: {error}")),
        };
        streams.push(subscription.async_stream().map(event).boxed());
    }
    for (service, server) in servers {
        let event = move |request| match request {
            Ok((id, request)) => Event::Request(*service, id, request),
            Err(error) => Event::Problem(format!("a request is lost: {error}")),
        };
        streams.push(server.receive_request_stream().map(event).boxed());
    }
    let mut all = select_all(streams);
    while let Some(event) = all.next().await {
        if sender.send(event).is_err() {
            return;
        }
    }
}

/// Starts the thread that estimates maps.
fn start_estimation(options: Options, sender: SyncSender<Event>) -> Result<mpsc::Sender<Box<Snapshot>>, String> {
    let (jobs, receiver) = mpsc::channel::<Box<Snapshot>>();
    start_thread("estimation", move || {
        for snapshot in receiver {
            if sender.send(Event::Estimate(Box::new(snapshot.estimate(&options)))).is_err() {
                return;
            }
        }
    })?;
    Ok(jobs)
}

/// The running node.
struct Runner {
    log: Log,
    outputs: Outputs,
    servers: Servers,
    jobs: mpsc::Sender<Box<Snapshot>>,
    start: Instant,
}

impl Runner {
    fn run(mut self, session: &mut Session, events: &Receiver<Event>) -> Result<(), String> {
        let Options { detections_topics, camera_info_topics, live, .. } = session.options();
        let text = format!(
            "detections: {}; calibrations: {}; world frame: {}",
            detections_topics.join(", "),
            camera_info_topics.join(", "),
            live.world_frame
        );
        self.log.write(Level::Info, &text);
        loop {
            let wait = if session.is_waiting() { SOON } else { SELDOM };
            match events.recv_timeout(wait) {
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => break,
                Err(RecvTimeoutError::Timeout) => {}
                Ok(event) => self.event(session, event),
            }
            self.follow_parameters(session);
            let now = self.start.elapsed().as_secs_f64();
            for action in session.work(now) {
                self.act(action);
            }
        }
        self.follow_parameters(session);
        if session.options().files != Files::default() {
            let text = session.save()?;
            self.log.write(Level::Info, &text);
        }
        Ok(())
    }

    fn event(&mut self, session: &mut Session, event: Event) {
        match event {
            Event::Message(Input::Transforms, topic, message) => session.transforms(&topic, &message, false),
            Event::Message(Input::FixedTransforms, topic, message) => session.transforms(&topic, &message, true),
            Event::Message(Input::Calibration, topic, message) => session.calibration(&topic, &message),
            Event::Message(Input::Detections, topic, message) => {
                session.detections(&topic, &message, self.start.elapsed().as_secs_f64());
            }
            Event::Request(service, id, request) => {
                self.follow_parameters(session);
                let response = match service {
                    Service::Query => session.query(&request),
                    Service::Save => self.triggered(session.save()),
                    Service::Load => self.triggered(session.load()),
                    Service::Reset => self.triggered(session.reset()),
                };
                let server = self.servers.iter().find(|(known, _)| *known == service);
                if let Some(Err(error)) = server.map(|(_, server)| server.send_response(id, response)) {
                    self.log.write(Level::Error, &format!("an answer cannot be sent: {error}"));
                }
            }
            Event::Estimate(estimate) => session.estimated(*estimate),
            Event::Problem(text) => self.log.write(Level::Warn, &text),
            Event::Stop => {}
        }
    }

    /// The answer of `std_srvs/Trigger`.
    fn triggered(&mut self, result: Result<String, String>) -> Bytes {
        let (level, is_ok, text) = match result {
            Ok(text) => (Level::Info, true, text),
            Err(text) => (Level::Error, false, text),
        };
        self.log.write(level, &text);
        let mut message = CdrWriter::default();
        message.u8(is_ok.into()).text(&text);
        Bytes(message.finish())
    }

    fn act(&mut self, action: Action) {
        match action {
            Action::Log(level, text) => self.log.write(level, &text),
            Action::Estimate(snapshot) => drop(self.jobs.send(snapshot)),
            Action::Publish(output, message) => {
                let publisher = self.outputs.iter().find(|(known, _)| *known == output);
                if let Some(Err(error)) = publisher.map(|(_, publisher)| publisher.publish(message)) {
                    self.log.write(Level::Warn, &format!("a message of {output:?} is dropped: {error}"));
                }
            }
        }
    }

    /// Takes over the parameters that can change.
    fn follow_parameters(&self, session: &mut Session) {
        let text = |name| match self.log.node.get_parameter(name) {
            Some(ParameterValue::String(text)) => text,
            _ => String::new(),
        };
        let period = match self.log.node.get_parameter("publish_period") {
            Some(ParameterValue::Double(seconds)) => seconds,
            _ => session.options().publish_period,
        };
        session.set(Files::new(&text("state_file"), &text("map_file")), period);
    }
}

/// Writes messages to the standard error, in the form of ROS 2, and to `/rosout`.
struct Log {
    node: Node,
    level: Level,
    /// When a message was written last, by its text without digits.
    last: HashMap<String, (Instant, u64)>,
}

/// Different messages that are remembered, at most.
const MAX_TEXTS: usize = 1000;

impl Log {
    fn write(&mut self, level: Level, text: &str) {
        if level < self.level {
            return;
        }
        let mut text = text.to_owned();
        if level == Level::Warn {
            let key: String = text.chars().filter(|c| !c.is_ascii_digit()).collect();
            let now = Instant::now();
            match self.last.get_mut(&key) {
                Some((last, more)) if now.duration_since(*last) < QUIET => {
                    *more += 1;
                    return;
                }
                Some((last, more)) => {
                    if *more > 0 {
                        text.push_str(&format!(" (and {more} like it before)"));
                    }
                    (*last, *more) = (now, 0);
                }
                None => {
                    if self.last.len() >= MAX_TEXTS {
                        self.last.clear();
                    }
                    self.last.insert(key, (now, 0));
                }
            }
        }
        let (name, of_ros) = match level {
            Level::Debug => ("DEBUG", LogLevel::Debug),
            Level::Info => ("INFO", LogLevel::Info),
            Level::Warn => ("WARN", LogLevel::Warn),
            Level::Error => ("ERROR", LogLevel::Error),
        };
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let text = quadlift_io::escape(&text);
        // Nobody may read it.
        let _ = writeln!(
            std::io::stderr(),
            "[{name}] [{}.{:09}] [{}]: {text}",
            since.as_secs(),
            since.subsec_nanos(),
            self.node.fully_qualified_name().trim_start_matches('/').replace('/', ".")
        );
        rosout!(self.node, of_ros, "{text}");
    }
}

//! The command line of a ROS 2 node: `--ros-args -p NAME:=VALUE -r FROM:=TO --params-file FILE`.

use std::path::PathBuf;

use crate::parameters::Parameters;
use crate::params_file;

/// What the command line says.
#[derive(Debug, Clone, PartialEq)]
pub struct Arguments {
    /// The name of the node.
    pub name: String,
    /// Its namespace, which begins with a slash.
    pub namespace: String,
    /// Names that are replaced.
    remaps: Vec<(String, String)>,
    /// The parameters.
    pub parameters: Parameters,
    /// Messages of lower levels are not written.
    pub log_level: Level,
}

/// How important a message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Every frame.
    Debug,
    /// What the node does.
    Info,
    /// What was dropped or ignored.
    Warn,
    /// What failed.
    Error,
}

/// What the program does.
#[derive(Debug, Clone, PartialEq)]
pub enum Wish {
    /// The node runs.
    Run(Box<Arguments>),
    /// The text is printed.
    Print(String),
}

impl Arguments {
    /// Reads the words after the program's name, and the files of parameters that they name. Later ones win.
    ///
    /// # Errors
    /// A text that names the word.
    pub fn read(words: impl IntoIterator<Item = String>) -> Result<Wish, String> {
        let mut arguments = Self {
            name: "quadlift".to_owned(),
            namespace: "/".to_owned(),
            remaps: Vec::new(),
            parameters: Parameters::default(),
            log_level: Level::Info,
        };
        let mut sets: Vec<Set> = Vec::new();
        let mut words = words.into_iter();
        let mut of_ros = false;
        while let Some(word) = words.next() {
            let mut next = || words.next().ok_or_else(|| format!("there is nothing after {word}"));
            match word.as_str() {
                "--ros-args" => of_ros = true,
                "--" => of_ros = false,
                "-h" | "--help" => return Ok(Wish::Print(help())),
                "-V" | "--version" => return Ok(Wish::Print(format!("quadlift-ros2 {}\n", env!("CARGO_PKG_VERSION")))),
                _ if !of_ros => return Err(format!("found {word}; expected --ros-args (see --help)")),
                "-p" | "--param" => {
                    let (name, value) = assignment(&next()?)?;
                    sets.push(Set::Parameter(name, value));
                }
                "-r" | "--remap" => arguments.remap(assignment(&next()?)?),
                "--params-file" => sets.push(Set::File(PathBuf::from(next()?))),
                "--log-level" => {
                    let text = next()?;
                    arguments.log_level = level(text.rsplit(":=").next().unwrap_or_default())?;
                }
                "--log-config-file" | "-e" | "--enclave" => drop(next()?),
                _ if word.contains(":=") => return Err(format!("found {word}; expected -p or -r before it")),
                // Switches of loggers.
                _ if word.starts_with("--disable-") || word.starts_with("--enable-") => {}
                _ => return Err(format!("found {word}; expected -p, -r, --params-file or --log-level (see --help)")),
            }
        }
        for set in sets {
            match set {
                Set::Parameter(name, value) => arguments.parameters.set(&name, &value)?,
                Set::File(path) => {
                    let text = std::fs::read_to_string(&path)
                        .map_err(|error| format!("cannot read {}: {error}", path.display()))?;
                    for (name, value) in params_file::parse(&path, &text, &arguments.full_name())? {
                        let result = arguments.parameters.set(&name, &value);
                        result.map_err(|problem| format!("{}: {problem}", path.display()))?;
                    }
                }
            }
        }
        Ok(Wish::Run(Box::new(arguments)))
    }

    fn remap(&mut self, (from, to): (String, String)) {
        match from.rsplit(':').next() {
            Some("__node" | "__name") => self.name = to,
            Some("__ns") => self.namespace = if to.starts_with('/') { to } else { format!("/{to}") },
            // The name of a node before a colon: there is only one.
            Some(name) => self.remaps.push((name.to_owned(), to)),
            None => {}
        }
    }

    /// The name of the node with its namespace.
    pub fn full_name(&self) -> String {
        self.absolute(&self.name)
    }

    /// The absolute name of a topic or a service, after replacing it.
    pub fn resolve(&self, name: &str) -> String {
        let absolute = self.absolute(name);
        let replaced = self.remaps.iter().find(|(from, _)| from == name || self.absolute(from) == absolute);
        replaced.map_or(absolute, |(_, to)| self.absolute(to))
    }

    fn absolute(&self, name: &str) -> String {
        let namespace = self.namespace.trim_end_matches('/');
        match (name.strip_prefix("~/"), name.starts_with('/')) {
            (Some(rest), _) => format!("{namespace}/{}/{rest}", self.name),
            (None, true) => name.to_owned(),
            (None, false) => format!("{namespace}/{name}"),
        }
    }
}

enum Set {
    Parameter(String, String),
    File(PathBuf),
}

fn assignment(word: &str) -> Result<(String, String), String> {
    let (name, value) = word.split_once(":=").ok_or_else(|| format!("found {word}; expected NAME:=VALUE"))?;
    Ok((name.to_owned(), value.to_owned()))
}

fn level(text: &str) -> Result<Level, String> {
    match text.to_lowercase().as_str() {
        "debug" => Ok(Level::Debug),
        "info" => Ok(Level::Info),
        "warn" => Ok(Level::Warn),
        "error" | "fatal" => Ok(Level::Error),
        _ => Err(format!("found the level {text}; expected debug, info, warn or error")),
    }
}

fn help() -> String {
    let mut text = "\
A ROS 2 node that keeps a map of 3D objects from 2D detections

Usage: quadlift-ros2 [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] [--log-level LEVEL]]

Topics in: detections, camera_info, /tf, /tf_static; out: ~/map, ~/markers, ~/objects_json, ~/events
Services: ~/save, ~/load, ~/reset (std_srvs/Trigger), ~/query (quadlift_msgs/QueryObjects)
The domain is that of the environment variable ROS_DOMAIN_ID.

Parameters:
"
    .to_owned();
    for parameter in crate::parameters::all() {
        use crate::parameters::Value;
        let default = match parameter.default {
            Value::Bool(x) => x.to_string(),
            Value::Integer(x) => x.to_string(),
            // These stand for none.
            Value::Double(0.0) => String::new(),
            Value::Text(x) if x.is_empty() => String::new(),
            Value::Doubles(x) if x.is_empty() => String::new(),
            Value::Double(x) => format!("{x:?}"),
            Value::Text(x) => format!("{x:?}"),
            Value::Doubles(x) => format!("{x:?}"),
            Value::Texts(x) => format!("{x:?}"),
        };
        let default = if default.is_empty() { default } else { format!(" [default: {default}]") };
        let (first, rest) = parameter.meaning.split_at(1);
        text.push_str(&format!("  {:<23} {}{rest}{default}\n", parameter.name, first.to_uppercase()));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(words: &[&str]) -> Result<Wish, String> {
        Arguments::read(words.iter().map(|word| (*word).to_owned()))
    }

    fn arguments(words: &[&str]) -> Arguments {
        match read(words).unwrap() {
            Wish::Run(arguments) => *arguments,
            Wish::Print(text) => panic!("{text}"),
        }
    }

    #[test]
    fn names_are_resolved_and_replaced() {
        let plain = arguments(&[]);
        assert_eq!(plain.resolve("detections"), "/detections");
        assert_eq!((plain.resolve("~/map"), plain.resolve("/tf")), ("/quadlift/map".into(), "/tf".into()));
        let named = arguments(&[
            "--ros-args",
            "-r",
            "__node:=objects",
            "-r",
            "__ns:=/robot",
            "-r",
            "detections:=/yolo/boxes",
            "-r",
            "/tf:=tf",
            "-r",
            "quadlift:~/map:=things",
            "--log-level",
            "quadlift:=warn",
        ]);
        assert_eq!(named.full_name(), "/robot/objects");
        let names = ["detections", "/tf", "~/map", "~/markers"].map(|name| named.resolve(name));
        assert_eq!(names, ["/yolo/boxes", "/robot/tf", "/robot/things", "/robot/objects/markers"]);
        assert_eq!(named.log_level, Level::Warn);
    }

    #[test]
    fn parameters_are_set_and_later_ones_win() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("p.yaml");
        std::fs::write(&file, "/**:\n  ros__parameters:\n    min_views: 5\n    max_gap: 0.5\n").unwrap();
        let file = file.to_str().unwrap();
        let found = arguments(&["--ros-args", "-p", "min_views:=4", "--params-file", file, "-p", "max_gap:=2.0"]);
        assert_eq!((found.parameters.size("min_views"), found.parameters.double("max_gap")), (5, 2.0));
        std::fs::write(file, "/**:\n  ros__parameters:\n    min_view: 5\n").unwrap();
        let error = read(&["--ros-args", "--params-file", file]).unwrap_err();
        assert!(error.contains("p.yaml: there is no parameter \"min_view\""), "{error}");
    }

    #[test]
    fn words_that_are_wrong_are_named() {
        assert_eq!(read(&["-p", "a:=1"]).unwrap_err(), "found -p; expected --ros-args (see --help)");
        assert_eq!(read(&["--ros-args", "-p"]).unwrap_err(), "there is nothing after -p");
        assert_eq!(read(&["--ros-args", "-p", "a"]).unwrap_err(), "found a; expected NAME:=VALUE");
        assert!(read(&["--ros-args", "--params-file", "no.yaml"]).unwrap_err().starts_with("cannot read no.yaml"));
        assert!(read(&["--ros-args", "a:=b"]).unwrap_err().contains("expected -p or -r"));
        let Wish::Print(help) = read(&["--help"]).unwrap() else { panic!() };
        assert!(crate::parameters::all().iter().all(|parameter| help.contains(parameter.name)));
    }
}

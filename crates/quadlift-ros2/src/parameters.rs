//! The parameters of the node: names, defaults and types.

use quadlift_io::options::{Command, Kind, MAP, RUN, Spec, Value as Choice};
use std::collections::BTreeMap;

/// A value of a parameter.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Double(f64),
    /// A text.
    Text(String),
    /// A list of numbers.
    Doubles(Vec<f64>),
    /// A list of texts.
    Texts(Vec<String>),
}

/// A parameter with its default.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name.
    pub name: &'static str,
    /// Its default, which also has its type.
    pub default: Value,
    /// What it means, for `--help`.
    pub meaning: &'static str,
    /// Whether it can be set while the node runs.
    pub can_change: bool,
}

/// All parameters, in the order of `--help`.
pub fn all() -> Vec<Parameter> {
    let fixed = |name, default, meaning| Parameter { name, default, meaning, can_change: false };
    let changing = |name, default, meaning| Parameter { name, default, meaning, can_change: true };
    let text = |text: &str| Value::Text(text.to_owned());
    let texts = |text: &str| Value::Texts(vec![text.to_owned()]);
    let mut list = vec![
        fixed("detections_topics", texts("detections"), "topics of vision_msgs/Detection2DArray, one for each camera"),
        fixed("camera_info_topics", texts("camera_info"), "topics of sensor_msgs/CameraInfo, one for each camera"),
        fixed("detections_reliability", text("reliable"), "reliable, or best_effort for detectors that publish so"),
        fixed("world_frame", text("map"), "the frame in which objects are located"),
        fixed(
            "rectified",
            Value::Bool(false),
            "the boxes were measured in the rectified image (P, R), not in the raw one (K, D)",
        ),
        fixed("pixel_centers", text("half"), "origin of the pixels of calibrations: half, or integer as in OpenCV"),
        fixed(
            "time_tolerance",
            Value::Double(0.02),
            "maximum time to the nearest transform beyond the last one, seconds",
        ),
        fixed("max_gap", Value::Double(1.0), "maximum time between two transforms that is interpolated, seconds"),
        fixed("transform_timeout", Value::Double(1.0), "how long detections wait for transforms, seconds"),
        fixed("transform_buffer", Value::Double(10.0), "how long transforms are kept, seconds"),
        fixed(
            "reorder_time",
            Value::Double(0.1),
            "with several topics, how long detections wait for earlier ones, seconds",
        ),
        fixed("queue_size", Value::Integer(100), "messages of detections that wait, at most"),
        fixed("priors", text(""), "what is known about categories: builtin, or a TOML file"),
        changing("publish_period", Value::Double(1.0), "time between estimates of the whole map, seconds"),
        changing("state_file", text(""), "file of the map's state: ~/save writes it, ~/load reads it"),
        changing("map_file", text(""), "result file that ~/save writes"),
        fixed("resume", Value::Bool(false), "go on from state_file, if the file exists"),
        fixed("use_sim_time", Value::Bool(false), "without effect: all times are those of the messages"),
    ];
    list.extend(declared(MAP).chain(declared(RUN)));
    list
}

/// The parameters that are options of a table of the library.
fn declared<O: Default>(rows: &'static [Spec<O>]) -> impl Iterator<Item = Parameter> {
    rows.iter().filter(|row| row.is_of(Command::Node)).map(|row| Parameter {
        name: row.name,
        default: match (row.kind, row.default()) {
            (Kind::Flag, default) => Value::Bool(default == Choice::Flag(true)),
            (Kind::Whole(_), default) => Value::Integer(default.whole().and_then(|n| n.try_into().ok()).unwrap_or(0)),
            // Zero and the empty list stand for none.
            (Kind::Number(_), default) => Value::Double(default.number().unwrap_or(0.0)),
            (Kind::Numbers(_), _) => Value::Doubles(Vec::new()),
            (_, default) => Value::Text(default.text().unwrap_or_default().to_owned()),
        },
        meaning: row.help,
        can_change: false,
    })
}

/// The parameters that were chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters(BTreeMap<&'static str, Value>);

impl Default for Parameters {
    fn default() -> Self {
        Self(all().into_iter().map(|parameter| (parameter.name, parameter.default)).collect())
    }
}

impl Parameters {
    /// Sets a parameter from text, as it stands on a command line or in a file of parameters.
    ///
    /// # Errors
    /// A text that names the parameter, what was found and what was expected.
    pub fn set(&mut self, name: &str, text: &str) -> Result<(), String> {
        let Some(value) = self.0.get_mut(name) else {
            let names: Vec<&str> = all().iter().map(|parameter| parameter.name).collect();
            return Err(format!("there is no parameter \"{name}\"; there are {}", names.join(", ")));
        };
        let refuse = |expected: &str| Err(format!("the parameter {name} is \"{text}\"; expected {expected}"));
        let items = || {
            let inner = text.trim().strip_prefix('[').and_then(|text| text.strip_suffix(']'));
            let items = inner.unwrap_or(text).split(',').map(|item| unquoted(item.trim()).to_owned());
            items.filter(|item| !item.is_empty()).collect::<Vec<String>>()
        };
        *value = match value {
            Value::Bool(_) => match text.to_lowercase().as_str() {
                "true" | "yes" | "on" => Value::Bool(true),
                "false" | "no" | "off" => Value::Bool(false),
                _ => return refuse("true or false"),
            },
            Value::Integer(_) => match text.parse() {
                Ok(number) => Value::Integer(number),
                Err(_) => return refuse("a whole number"),
            },
            Value::Double(_) => match text.parse() {
                Ok(number) => Value::Double(number),
                Err(_) => return refuse("a number"),
            },
            Value::Text(_) => Value::Text(unquoted(text).to_owned()),
            Value::Doubles(_) => match items().iter().map(|item| item.parse()).collect() {
                Ok(numbers) => Value::Doubles(numbers),
                Err(_) => return refuse("a list of numbers"),
            },
            Value::Texts(_) => Value::Texts(items()),
        };
        Ok(())
    }

    /// All parameters with their values.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &Value)> {
        self.0.iter().map(|(name, value)| (*name, value))
    }

    /// The text of a parameter; empty if it is of another type.
    pub fn text(&self, name: &str) -> &str {
        if let Some(Value::Text(text)) = self.0.get(name) { text } else { "" }
    }

    /// The number of a parameter; 0 if it is of another type.
    pub fn double(&self, name: &str) -> f64 {
        if let Some(Value::Double(number)) = self.0.get(name) { *number } else { 0.0 }
    }

    /// The whole number of a parameter, if it is not negative; 0 otherwise.
    pub fn size(&self, name: &str) -> usize {
        let Some(Value::Integer(number)) = self.0.get(name) else { return 0 };
        usize::try_from(*number).unwrap_or(0)
    }

    /// Whether a parameter is `true`.
    pub fn is_set(&self, name: &str) -> bool {
        self.0.get(name) == Some(&Value::Bool(true))
    }

    /// The parameters of a table of the library, as options.
    pub fn chosen<O: Default>(&self, rows: &'static [Spec<O>]) -> Vec<(&'static str, Choice)> {
        let rows = rows.iter().filter(|row| row.is_of(Command::Node));
        let choice = |row: &Spec<O>| match self.0.get(row.name) {
            Some(Value::Bool(flag)) => (*flag).into(),
            // A negative number is refused as one that is too small.
            Some(Value::Integer(n)) => Choice::Whole(u64::try_from(*n).unwrap_or(0)),
            Some(Value::Double(x)) if *x != 0.0 => (*x).into(),
            Some(Value::Text(text)) if !text.is_empty() => text.as_str().into(),
            Some(Value::Doubles(numbers)) if !numbers.is_empty() => Choice::Numbers(numbers.clone()),
            _ => Choice::Unset,
        };
        rows.map(|row| (row.name, choice(row))).collect()
    }

    /// The texts of a parameter.
    pub fn texts(&self, name: &str) -> &[String] {
        if let Some(Value::Texts(texts)) = self.0.get(name) { texts } else { &[] }
    }
}

fn unquoted(text: &str) -> &str {
    let inner = |quote| text.strip_prefix(quote)?.strip_suffix(quote);
    inner('"').or(inner('\'')).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_by_their_types() {
        let mut parameters = Parameters::default();
        for (name, text) in [
            ("min_views", "4"),
            ("max_gap", "2"),
            ("rectified", "True"),
            ("world_frame", "'odom'"),
            ("detections_topics", "[/left/boxes, '/right/boxes']"),
            ("pose_noise", "[0.003, 0.1]"),
        ] {
            parameters.set(name, text).unwrap();
        }
        assert_eq!((parameters.size("min_views"), parameters.double("max_gap")), (4, 2.0));
        assert!(parameters.is_set("rectified"));
        assert_eq!(parameters.text("world_frame"), "odom");
        assert_eq!(parameters.texts("detections_topics"), ["/left/boxes", "/right/boxes"]);
        let noise = parameters.chosen(RUN).into_iter().find(|(name, _)| *name == "pose_noise").unwrap();
        assert_eq!(noise.1, Choice::Numbers(vec![0.003, 0.1]));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let mut parameters = Parameters::default();
        let mut error = |name, text| parameters.set(name, text).unwrap_err();
        assert_eq!(error("min_views", "2.5"), "the parameter min_views is \"2.5\"; expected a whole number");
        assert_eq!(error("upright", "maybe"), "the parameter upright is \"maybe\"; expected true or false");
        assert!(error("max_gap", "long").ends_with("expected a number"));
        assert!(error("pose_noise", "[a]").ends_with("expected a list of numbers"));
        assert!(error("min_view", "3").starts_with("there is no parameter \"min_view\"; there are detections_topics"));
    }
}

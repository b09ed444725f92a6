//! The declaration of an option: one row for the program, Python, the ROS 2 node and results.
//!
//! A row has a name, a kind of value, its texts, and how the value is read from and written to a struct of options. Each struct
//! has a table of rows: [`RUN`], [`MAP`], [`ASSOCIATION`]; that of [`crate::segmentation::Settings`] stands beside it.

mod run;
mod map;
mod association;
mod record;

pub use association::ASSOCIATION;
pub use map::MAP;
pub use record::check_needs_posterior;
pub(crate) use record::{option_value, value_record};
pub use run::RUN;

use std::fmt::{Display, Formatter, Result as FmtResult};
use std::str::FromStr;

use quadlift::UnknownName;

/// A place where options are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `quadlift localize`.
    Localize,
    /// `quadlift associate`.
    Associate,
    /// `quadlift segment`.
    Segment,
    /// `quadlift stream`.
    Stream,
    /// Functions of Python with the table's options, such as `quadlift.localize`.
    Python,
    /// The ROS 2 node.
    Node,
}

/// A declared option of the struct `O`.
#[derive(Debug)]
pub struct Spec<O: 'static> {
    /// The name with underscores: the keyword of Python, the parameter of the node, the key in results. The program writes
    /// dashes.
    pub name: &'static str,
    /// The kind of value.
    pub kind: Kind,
    /// What stands for the value in the help of the program; empty for a flag.
    pub placeholder: &'static str,
    /// The text of `-h`: three to eight words.
    pub short: &'static str,
    /// The whole text.
    pub help: &'static str,
    /// The heading in the help of the program.
    pub group: Group,
    /// Where the option is available.
    pub of: &'static [Command],
    /// Another option and the value that it must have.
    pub only: Option<(&'static str, &'static str)>,
    /// Another option that must be given.
    pub needs: Option<&'static str>,
    /// Whether it concerns whole scenes, so that tables of single objects do not take it.
    pub whole_scene: bool,
    /// Reads the value from the options.
    pub get: fn(&O) -> Value,
    /// Writes a value of the kind, or [`Value::Unset`], into the options; says what was expected.
    pub set: fn(&mut O, Value) -> Result<(), String>,
}

/// A heading in the help of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// What is read, and what of it is used.
    Input,
    /// What is assumed of objects and of the noise.
    Model,
    /// Which detections show the same object.
    Association,
    /// The poses of cameras.
    Poses,
    /// Corrections of the input.
    Corrections,
    /// What is written.
    Output,
    /// How a command runs.
    Run,
    /// What the defaults do better.
    Research,
}

impl Group {
    /// The heading.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Input => "Input",
            Self::Model => "Model",
            Self::Association => "Association",
            Self::Poses => "Camera poses",
            Self::Corrections => "Input corrections",
            Self::Output => "Output",
            Self::Run => "Run",
            Self::Research => "Research",
        }
    }
}

/// The kind of value of an option.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// Yes or no.
    Flag,
    /// A number.
    Number(Range),
    /// A whole number, and the smallest that is allowed.
    Whole(u64),
    /// One of these names.
    Choice(&'static [&'static str]),
    /// One of these names; the first argument stands for an option without a value.
    ChoiceOr(&'static str, &'static [&'static str]),
    /// Positive numbers with these names.
    Numbers(&'static [&'static str]),
    /// Text.
    Text,
    /// Numbers by name.
    Levels,
}

/// A range of numbers. All are finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Range {
    /// All numbers.
    Finite,
    /// Zero and above.
    NotNegative,
    /// Above zero.
    Positive,
    /// From zero to one.
    Share,
}

/// The value of an option.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Value {
    /// None.
    #[default]
    Unset,
    /// Of [`Kind::Flag`].
    Flag(bool),
    /// Of [`Kind::Number`].
    Number(f64),
    /// Of [`Kind::Whole`].
    Whole(u64),
    /// Of [`Kind::Text`], [`Kind::Choice`] and [`Kind::ChoiceOr`].
    Text(String),
    /// Of [`Kind::Numbers`].
    Numbers(Vec<f64>),
    /// Of [`Kind::Levels`].
    Levels(Vec<(String, f64)>),
}

impl Range {
    /// Whether a number is in the range.
    fn contains(self, x: f64) -> bool {
        x.is_finite()
            && match self {
                Self::Finite => true,
                Self::NotNegative => x >= 0.0,
                Self::Positive => x > 0.0,
                Self::Share => (0.0..=1.0).contains(&x),
            }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Finite => "a finite number",
            Self::NotNegative => "a finite number that is not negative",
            Self::Positive => "a number above 0",
            Self::Share => "a number from 0 to 1",
        }
    }
}

impl Kind {
    /// The values that are allowed, as text.
    pub fn expected(&self) -> String {
        match self {
            Self::Flag => "true or false".to_owned(),
            Self::Number(range) => range.expected().to_owned(),
            Self::Whole(0) => "a whole number that is not negative".to_owned(),
            Self::Whole(least) => format!("a whole number of at least {least}"),
            Self::Choice(names) | Self::ChoiceOr(_, names) => format!("one of {}", names.join(", ")),
            Self::Numbers(names) => format!("{} positive numbers: {}", names.len(), names.join(", ")),
            Self::Text => "a text".to_owned(),
            Self::Levels => "numbers by name, such as edge_noise=0.03".to_owned(),
        }
    }

    /// A value of this kind that is in its range. A whole number may stand for a number.
    ///
    /// # Errors
    /// What was expected.
    pub(crate) fn check(&self, value: Value) -> Result<Value, String> {
        let fits = match (self, &value) {
            (_, Value::Unset)
            | (Self::Flag, Value::Flag(_))
            | (Self::Text, Value::Text(_))
            | (Self::Levels, Value::Levels(_)) => true,
            (Self::Number(range), Value::Number(x)) => range.contains(*x),
            (Self::Number(range), Value::Whole(n)) if range.contains(*n as f64) => return Ok(Value::Number(*n as f64)),
            (Self::Whole(least), Value::Whole(n)) => n >= least,
            (Self::Choice(names) | Self::ChoiceOr(_, names), Value::Text(text)) => names.contains(&text.as_str()),
            (Self::Numbers(names), Value::Numbers(numbers)) => {
                numbers.len() == names.len() && numbers.iter().all(|x| Range::Positive.contains(*x))
            }
            _ => false,
        };
        if fits { Ok(value) } else { Err(format!("expected {}", self.expected())) }
    }

    /// Reads a value from text: numbers with commas between them, levels as `NAME=X,...`.
    ///
    /// # Errors
    /// What was expected.
    pub fn read(&self, text: &str) -> Result<Value, String> {
        let expected = || format!("expected {}", self.expected());
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| expected());
        let value = match self {
            Self::Flag => Value::Flag(text.parse().map_err(|_| expected())?),
            Self::Number(_) => Value::Number(number(text)?),
            Self::Whole(_) => Value::Whole(text.trim().parse().map_err(|_| expected())?),
            Self::Numbers(_) => Value::Numbers(text.split(',').map(number).collect::<Result<_, _>>()?),
            Self::Choice(_) | Self::ChoiceOr(..) | Self::Text => Value::Text(text.to_owned()),
            Self::Levels => {
                let level = |part: &str| {
                    let (name, x) = part.split_once('=').ok_or_else(|| format!("\"{part}\": expected NAME=X"))?;
                    let x = x.trim().parse().ok().filter(|x: &f64| x.is_finite());
                    let x = x.ok_or_else(|| format!("\"{part}\": expected a finite number"))?;
                    Ok::<_, String>((name.trim().to_owned(), x))
                };
                Value::Levels(text.split(',').map(level).collect::<Result<_, _>>()?)
            }
        };
        self.check(value)
    }
}

/// The setters of rows get a value of their kind, or none; anything else would be a mistake in a table.
impl Value {
    /// A flag; `None` if unset.
    pub(crate) fn flag(&self) -> Option<bool> {
        if let Self::Flag(flag) = self { Some(*flag) } else { None }
    }

    /// A number; `None` if unset.
    pub fn number(&self) -> Option<f64> {
        if let Self::Number(x) = self { Some(*x) } else { None }
    }

    /// A whole number; `None` if unset.
    pub fn whole(&self) -> Option<u64> {
        if let Self::Whole(n) = self { Some(*n) } else { None }
    }

    /// A number of things.
    ///
    /// # Errors
    /// What was expected.
    pub(crate) fn count(&self) -> Result<usize, String> {
        let count = self.whole().and_then(|n| usize::try_from(n).ok());
        count.ok_or_else(|| format!("expected {}", Kind::Whole(0).expected()))
    }

    /// A choice by its name.
    ///
    /// # Errors
    /// What was expected.
    pub(crate) fn named<T: FromStr<Err = UnknownName>>(&self) -> Result<T, String> {
        let name = self.text().unwrap_or("none");
        name.parse().map_err(|error: UnknownName| format!("expected one of {}", error.expected.join(", ")))
    }

    /// A text; `None` if unset.
    pub fn text(&self) -> Option<&str> {
        if let Self::Text(text) = self { Some(text) } else { None }
    }

    /// Two numbers; `None` if unset.
    pub(crate) fn pair(&self) -> Option<[f64; 2]> {
        if let Self::Numbers(numbers) = self { numbers.as_slice().try_into().ok() } else { None }
    }
}

impl From<bool> for Value {
    fn from(flag: bool) -> Self {
        Self::Flag(flag)
    }
}

impl From<usize> for Value {
    fn from(n: usize) -> Self {
        Self::Whole(n as u64)
    }
}

impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Value {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl<T: Into<Self>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Unset, Into::into)
    }
}

impl Display for Value {
    fn fmt(&self, f: &mut Formatter<'_>) -> FmtResult {
        match self {
            Self::Unset => f.pad("none"),
            Self::Flag(flag) => write!(f, "{flag}"),
            Self::Number(x) => write!(f, "{x}"),
            Self::Whole(n) => write!(f, "{n}"),
            Self::Text(text) => write!(f, "\"{text}\""),
            Self::Numbers(numbers) => write!(f, "{numbers:?}"),
            Self::Levels(levels) => {
                let levels: Vec<String> = levels.iter().map(|(name, x)| format!("{name}={x}")).collect();
                f.pad(&levels.join(","))
            }
        }
    }
}

/// How options are written in messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spelling {
    /// `--min-views 3`, of the program.
    Flag,
    /// `min_views=3`, of Python.
    Keyword,
    /// `min_views`, of the ROS 2 node.
    Parameter,
}

impl Spelling {
    /// An option.
    pub fn option(self, name: &str) -> String {
        match self {
            Self::Flag => format!("--{}", name.replace('_', "-")),
            Self::Keyword => name.to_owned(),
            Self::Parameter => format!("the parameter {name}"),
        }
    }

    /// An option with a value.
    pub fn with_value(self, name: &str, value: &str) -> String {
        match self {
            Self::Flag => format!("{} {value}", self.option(name)),
            Self::Keyword => format!("{name}=\"{value}\""),
            Self::Parameter => format!("{name}:={value}"),
        }
    }
}

impl<O> Spec<O> {
    /// What most rows have: a flag of whole scenes, of no command and without texts.
    pub(crate) const ROW: Self = Self {
        name: "",
        kind: Kind::Flag,
        placeholder: "",
        short: "",
        help: "",
        group: Group::Model,
        of: &[],
        only: None,
        needs: None,
        whole_scene: true,
        get: |_| Value::Unset,
        set: |_, _| Ok(()),
    };
}

impl<O: Default> Spec<O> {
    /// The value that the option has if it is not given.
    pub fn default(&self) -> Value {
        (self.get)(&O::default())
    }

    /// Whether the option is available at a place.
    pub fn is_of(&self, command: Command) -> bool {
        self.of.contains(&command)
    }
}

/// Sets the options that are given by name, in the order of their rows. A value that is the default counts as not given.
///
/// # Errors
/// A text that names the first option that is unknown, wrong, or does not fit the others.
pub fn set_options<O: Default>(
    rows: &[Spec<O>],
    given: &[(&str, Value)],
    options: &mut O,
    spelling: Spelling,
) -> Result<(), String> {
    let value_of = |name: &str| given.iter().rev().find(|(known, _)| *known == name).map(|(_, value)| value);
    if let Some((name, _)) = given.iter().find(|(name, _)| rows.iter().all(|row| row.name != *name)) {
        let names: Vec<&str> = rows.iter().map(|row| row.name).collect();
        return Err(format!("there is no option {name}; expected one of {}", names.join(", ")));
    }
    for row in rows {
        let Some(found) = value_of(row.name) else { continue };
        let name = spelling.option(row.name);
        let refused = |expected: String| format!("{name} is {found}; {expected}");
        let value = row.kind.check(found.clone()).map_err(refused)?;
        if value == row.default() {
            continue;
        }
        if let Some((other, needed)) = row.only
            && let Some(other) = rows.iter().find(|row| row.name == other)
            && (other.get)(options).text() != Some(needed)
        {
            return Err(format!("{name} is an option of {} only", spelling.with_value(other.name, needed)));
        }
        if let Some(other) = row.needs
            && value_of(other).is_none_or(|value| *value == Value::Unset)
        {
            return Err(format!("{name} needs {}", spelling.option(other)));
        }
        (row.set)(options, value).map_err(refused)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_and_checked_by_their_kind() {
        let levels = Value::Levels(vec![("edge_noise".to_owned(), 0.03), ("edge_noise_px".to_owned(), 2.0)]);
        assert_eq!(Kind::Levels.read("edge_noise=0.03, edge_noise_px=2"), Ok(levels));
        assert_eq!(Kind::Numbers(&["RAD", "LENGTH"]).read("0.003, 0.1"), Ok(Value::Numbers(vec![0.003, 0.1])));
        assert_eq!(Kind::Number(Range::Positive).check(Value::Whole(2)), Ok(Value::Number(2.0)));
        for (kind, wrong, expected) in [
            (Kind::Number(Range::Finite), "nan", "a finite number"),
            (Kind::Number(Range::NotNegative), "-1", "not negative"),
            (Kind::Number(Range::Positive), "0", "above 0"),
            (Kind::Number(Range::Share), "1.1", "from 0 to 1"),
            (Kind::Whole(3), "2", "at least 3"),
            (Kind::Choice(&["a", "b"]), "c", "one of a, b"),
            (Kind::Numbers(&["RAD", "LENGTH"]), "1", "2 positive numbers: RAD, LENGTH"),
            (Kind::Numbers(&["RAD", "LENGTH"]), "1,-1", "2 positive numbers"),
            (Kind::Levels, "edge", "\"edge\": expected NAME=X"),
        ] {
            assert!(kind.read(wrong).unwrap_err().contains(expected), "{kind:?} {wrong}");
        }
    }
}

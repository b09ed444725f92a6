//! Declared options ([`Spec`]) as arguments of commands.

use std::marker::PhantomData;
use std::path::Path;

use clap::builder::{PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{Arg, ArgAction, ArgMatches, Args, FromArgMatches};
use quadlift::online::{ONLINE, OnlineOptions};
use quadlift::options::{Command, Kind, Spec, Spelling, Value, set_options};
use quadlift::run::{RUN, RunOptions};
use quadlift_io::read_scene_file;

use crate::error::usage;

/// The options of a command: a table of rows, and the command.
pub(crate) trait List {
    /// The struct of the options.
    type Options: Default + 'static;
    /// The rows.
    const ROWS: &'static [Spec<Self::Options>];
    /// The command that takes those of them that are its own.
    const COMMAND: Command;
}

/// A command that takes options of a run.
pub(crate) trait OfRun {
    /// The command.
    const COMMAND: Command;
}

impl<T: OfRun> List for T {
    type Options = RunOptions;
    const ROWS: &'static [Spec<RunOptions>] = RUN;
    const COMMAND: Command = T::COMMAND;
}

/// The options of a run in `localize`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Localize {}

impl OfRun for Localize {
    const COMMAND: Command = Command::Localize;
}

/// The options of a run in `associate`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Associate {}

impl OfRun for Associate {
    const COMMAND: Command = Command::Associate;
}

/// The options of a run in `segment`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Segment {}

impl OfRun for Segment {
    const COMMAND: Command = Command::Segment;
}

/// The options of a run in `stream`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {}

impl OfRun for Stream {
    const COMMAND: Command = Command::Stream;
}

/// The options of the object map in `stream`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum StreamMap {}

impl List for StreamMap {
    type Options = OnlineOptions;
    const ROWS: &'static [Spec<OnlineOptions>] = ONLINE;
    const COMMAND: Command = Command::Stream;
}

/// The options of a command as they were given.
#[derive(Debug, Clone)]
pub(crate) struct Chosen<L: List> {
    given: Vec<(&'static str, Value)>,
    list: PhantomData<L>,
}

impl<L: List> Chosen<L> {
    /// The options with what was given. Reads the file that a value names.
    pub(crate) fn options(&self) -> anyhow::Result<L::Options> {
        let mut given = self.given.clone();
        for (name, value) in &mut given {
            let is_levels = rows::<L>().any(|row| row.name == *name && row.kind == Kind::Levels);
            if let Some(path) = value.text().filter(|_| is_levels) {
                let path = Path::new(path);
                let levels = read_scene_file(path)?.noise_levels().map_err(|error| error.in_file(path))?;
                *value = Value::from(&levels);
            }
        }
        let mut options = L::Options::default();
        set_options(L::ROWS, &given, &mut options, Spelling::Flag).or_else(usage)?;
        Ok(options)
    }
}

fn rows<L: List>() -> impl Iterator<Item = &'static Spec<L::Options>> {
    L::ROWS.iter().filter(|row| row.is_of(L::COMMAND))
}

impl<L: List> Args for Chosen<L> {
    fn augment_args(command: clap::Command) -> clap::Command {
        command.args(rows::<L>().map(argument))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

impl<L: List> FromArgMatches for Chosen<L> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let value = |row: &Spec<L::Options>| match row.kind {
            Kind::Flag => matches.get_flag(row.name).then(|| Value::Flag(!is_on(row))),
            _ => matches.get_one::<Value>(row.name).cloned(),
        };
        let given = rows::<L>().filter_map(|row| Some((row.name, value(row)?))).collect();
        Ok(Self { given, list: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Whether a flag is on by default: the argument then turns it off.
fn is_on<O: Default>(row: &Spec<O>) -> bool {
    row.default() == Value::Flag(true)
}

/// The argument of an option.
fn argument<O: Default + 'static>(row: &'static Spec<O>) -> Arg {
    let name = row.name.replace('_', "-");
    let arg = Arg::new(row.name);
    let arg = if row.group.is_empty() { arg } else { arg.help_heading(row.group) };
    let arg = match row.kind {
        Kind::Flag if is_on(row) => {
            return arg
                .long(format!("no-{name}"))
                .action(ArgAction::SetTrue)
                .help(format!("Do not {}", lowered(row.help)));
        }
        Kind::Flag => return arg.long(name).action(ArgAction::SetTrue).help(row.help),
        Kind::Number(_) => arg.value_name("X"),
        Kind::Whole(_) => arg.value_name("N"),
        Kind::Numbers(names) => arg.value_name(names.join(",")),
        Kind::Levels => arg.value_name("RESULT.json|NAME=X,..."),
        Kind::Choice(_) | Kind::Text => arg.value_name(row.name.to_uppercase()),
        Kind::ChoiceOr(bare, _) => {
            arg.value_name(row.name.to_uppercase()).num_args(0..=1).require_equals(true).default_missing_value(bare)
        }
    };
    let arg = arg.long(name).help(row.help).value_parser(parser(row)).hide_possible_values(true);
    match row.default() {
        Value::Unset => arg,
        Value::Text(text) => arg.default_value(text),
        value => arg.default_value(value.to_string()),
    }
}

/// Reads the value of an option, and tries it.
fn parser<O: Default + 'static>(row: &'static Spec<O>) -> ValueParser {
    match row.kind {
        Kind::Choice(names) | Kind::ChoiceOr(_, names) => PossibleValuesParser::new(names).map(Value::Text).into(),
        kind => ValueParser::from(move |text: &str| {
            if kind == Kind::Levels && !text.contains('=') {
                let is_file = Path::new(text).exists();
                return is_file.then(|| text.into()).ok_or_else(|| "neither a file nor NAME=X,...".to_owned());
            }
            let value = kind.read(text)?;
            (row.set)(&mut O::default(), value.clone())?;
            Ok::<Value, String>(value)
        }),
    }
}

/// A text with a lower first letter.
fn lowered(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_lowercase().chain(letters).collect())
}

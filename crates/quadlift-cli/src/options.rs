//! Declared options ([`Spec`]) as arguments of commands.

use std::marker::PhantomData;
use std::path::Path;

use clap::builder::{PossibleValuesParser, TypedValueParser, ValueParser};
use clap::{Arg, ArgAction, ArgMatches, Args, FromArgMatches};
use quadlift::association::AssociateOptions;
use quadlift::online::OnlineOptions;
use quadlift::run::RunOptions;
use quadlift_io::options::{ASSOCIATION, Command, Kind, MAP, RUN, Spec, Spelling, Value, set_options};
use quadlift_io::read_scene_file;
use quadlift_io::segmentation::{SEGMENTATION, Settings};

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
    const ROWS: &'static [Spec<OnlineOptions>] = MAP;
    const COMMAND: Command = Command::Stream;
}

/// The options of the association in `associate`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum OfAssociation {}

impl List for OfAssociation {
    type Options = AssociateOptions;
    const ROWS: &'static [Spec<AssociateOptions>] = ASSOCIATION;
    const COMMAND: Command = Command::Associate;
}

/// The options of the segmentation in `segment`.
#[derive(Debug, Clone, Copy)]
pub(crate) enum OfSegmentation {}

impl List for OfSegmentation {
    type Options = Settings;
    const ROWS: &'static [Spec<Settings>] = SEGMENTATION;
    const COMMAND: Command = Command::Segment;
}

/// Whether an option of a command is a row of a table, which has its texts.
pub(crate) fn is_declared(command: &str, option: &str) -> bool {
    fn has<L: List>(option: &str) -> bool {
        rows::<L>().any(|row| row.name == option)
    }
    match command {
        "localize" => has::<Localize>(option),
        "associate" => has::<Associate>(option) || has::<OfAssociation>(option),
        "segment" => has::<Segment>(option) || has::<OfSegmentation>(option),
        "stream" => has::<Stream>(option) || has::<StreamMap>(option),
        _ => false,
    }
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

/// Options of tables come after the others of their heading.
const AFTER_OTHERS: usize = 1000;

fn rows<L: List>() -> impl Iterator<Item = &'static Spec<L::Options>> {
    L::ROWS.iter().filter(|row| row.is_of(L::COMMAND))
}

impl<L: List> Args for Chosen<L> {
    fn augment_args(command: clap::Command) -> clap::Command {
        let arguments = rows::<L>().enumerate().map(|(place, row)| argument(row).display_order(AFTER_OTHERS + place));
        command.args(arguments)
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
    let arg = Arg::new(row.name).help_heading(row.group.title()).help(row.short);
    let arg = match row.kind {
        Kind::Flag if is_on(row) => {
            let help = format!("Do not {}", lowered(row.help));
            return arg.long(format!("no-{name}")).action(ArgAction::SetTrue).long_help(help);
        }
        Kind::Flag => return arg.long(name).action(ArgAction::SetTrue).long_help(row.help),
        Kind::ChoiceOr(bare, _) => arg.num_args(0..=1).require_equals(true).default_missing_value(bare),
        _ => arg,
    };
    let arg = arg.long(name).value_name(row.placeholder).long_help(row.help);
    let arg = arg.value_parser(parser(row)).hide_possible_values(true);
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

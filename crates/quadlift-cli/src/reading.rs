//! Options of formats, which are declared in tables ([`READ`]), as arguments of `import`, `export`, `localize` and `stream`.

use std::marker::PhantomData;

use clap::builder::ValueParser;
use clap::{Arg, ArgAction, ArgMatches, Args, FromArgMatches};
use quadlift_io::formats::{detections, poses};
use quadlift_io::read::{FormatOption, READ, ReadOptions};

use crate::error::usage;

/// The heading of options that only logs have.
const LOGS: &str = "Logs in MCAP";

/// Options of formats that were given, with their texts.
#[derive(Debug, Clone)]
pub(crate) struct Given<O: 'static>(Vec<(&'static FormatOption<O>, String)>);

impl<O: Default> Given<O> {
    /// Those of a command that takes some of the declared ones.
    pub(crate) fn of(matches: &ArgMatches, all: &'static [FormatOption<O>], takes: impl Fn(&str) -> bool) -> Self {
        let text = |row: &FormatOption<O>| match row.value {
            "" => matches.get_flag(row.name).then(String::new),
            _ => matches.get_one::<String>(row.name).cloned(),
        };
        Self(all.iter().filter(|row| takes(row.name)).filter_map(|row| Some((row, text(row)?))).collect())
    }

    /// The options.
    pub(crate) fn options(&self) -> O {
        let mut options = O::default();
        for (row, text) in &self.0 {
            // It was tried when the argument was read.
            let _ = (row.set)(&mut options, text);
        }
        options
    }

    /// The first of them that is none of these, as it is written.
    pub(crate) fn first_except(&self, names: &[&str]) -> Option<String> {
        self.0.iter().find(|(row, _)| !names.contains(&row.name)).map(|(row, _)| flag(row))
    }

    /// Refuses options that none of the files takes; `found` says what these are.
    pub(crate) fn check(&self, taken: &[&[&str]], found: &str) -> anyhow::Result<()> {
        let is_taken = |row: &FormatOption<O>| taken.iter().any(|names| names.contains(&row.name));
        match self.0.iter().find(|(row, _)| !is_taken(row)) {
            Some((row, _)) => {
                usage(format!("{} is an option of {}; {found}", flag(row), formats_with(row.name).join(", ")))
            }
            None => Ok(()),
        }
    }
}

fn flag<O>(row: &FormatOption<O>) -> String {
    format!("--{}", row.name.replace('_', "-"))
}

/// The names of the formats that have an option.
fn formats_with(name: &str) -> Vec<&'static str> {
    let all = poses().map(|format| (format.name, format.options));
    let all = all.chain(detections().map(|format| (format.name, format.options)));
    all.filter(|(_, options)| options.contains(&name)).map(|(format, _)| format).collect()
}

/// The arguments of those options that a command takes.
pub(crate) fn arguments<O: Default>(
    all: &'static [FormatOption<O>],
    takes: impl Fn(&str) -> bool,
) -> impl Iterator<Item = Arg> {
    all.iter().filter(move |row| takes(row.name)).map(|row| {
        let arg = Arg::new(row.name).long(row.name.replace('_', "-")).help(row.help);
        if row.value.is_empty() {
            return arg.action(ArgAction::SetTrue);
        }
        // Coordinates may be negative.
        let are_numbers = row.value.contains(',') && !row.value.ends_with("...");
        arg.value_name(row.value).allow_hyphen_values(are_numbers).value_parser(ValueParser::from(move |text: &str| {
            (row.set)(&mut O::default(), text).map(|()| text.to_owned())
        }))
    })
}

/// A command that takes options of readers.
pub(crate) trait Reader {
    /// Whether it takes an option.
    fn takes(name: &str) -> bool;
}

/// `localize`, which reads every format.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Localize {}

impl Reader for Localize {
    fn takes(_: &str) -> bool {
        true
    }
}

/// `stream`, which reads logs.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Stream {}

impl Reader for Stream {
    fn takes(name: &str) -> bool {
        !["skip_errors", "write_images"].contains(&name) && formats_with(name).contains(&"mcap")
    }
}

/// The options of readers of a command, as they were given.
#[derive(Debug, Clone)]
pub(crate) struct Reading<R> {
    /// What was given.
    pub given: Given<ReadOptions>,
    reader: PhantomData<R>,
}

impl<R: Reader> Args for Reading<R> {
    fn augment_args(command: clap::Command) -> clap::Command {
        command.args(arguments(READ, R::takes).map(|arg| {
            let of_logs = formats_with(arg.get_id().as_str()) == ["mcap"];
            arg.help_heading(if of_logs { LOGS } else { "Files of other programs" })
        }))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

impl<R: Reader> FromArgMatches for Reading<R> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        Ok(Self { given: Given::of(matches, READ, R::takes), reader: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

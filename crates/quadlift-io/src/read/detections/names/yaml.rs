//! The `names` of a YAML file.

use std::collections::BTreeMap;
use std::path::Path;

use saphyr_parser::{Event, Parser, ScanError, Span};

use super::ClassNames;
use crate::error::ReadError;

/// The events of a YAML file with their places.
struct Events<'a> {
    path: &'a Path,
    parser: Parser<'a, saphyr_parser::StrInput<'a>>,
}

impl<'a> Events<'a> {
    fn next(&mut self) -> Result<(Event<'a>, Span), ReadError> {
        let invalid = |error: ScanError| {
            let place = *error.marker();
            ReadError::new(self.path, format!("this is not valid YAML: {}", error.info()))
                .at(place.line(), place.col() + 1)
        };
        match self.parser.next() {
            Some(event) => event.map_err(invalid),
            None => Err(ReadError::new(self.path, "the file ends too early")),
        }
    }

    fn unexpected(&self, span: &Span, problem: &str) -> ReadError {
        ReadError::new(self.path, problem).at(span.start.line(), span.start.col() + 1)
    }

    /// Passes over the rest of a value whose first event this is.
    fn skip(&mut self, first: &Event) -> Result<(), ReadError> {
        let mut depth = 0_usize;
        let mut event = first.clone();
        loop {
            match event {
                Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
                Event::SequenceEnd | Event::MappingEnd => depth = depth.saturating_sub(1),
                Event::StreamEnd => return Ok(()),
                _ => {}
            }
            if depth == 0 {
                return Ok(());
            }
            event = self.next()?.0;
        }
    }
}

/// The names after `names:`.
pub(super) fn names(path: &Path, text: &str) -> Result<ClassNames, ReadError> {
    let mut events = Events { path, parser: Parser::new_from_str(text) };
    let (first, span) = loop {
        let (event, span) = events.next()?;
        if !matches!(event, Event::StreamStart | Event::DocumentStart(_) | Event::Nothing) {
            break (event, span);
        }
    };
    if !matches!(first, Event::MappingStart(..)) {
        return Err(events.unexpected(&span, "expected keys and values, and among them \"names:\""));
    }
    loop {
        let (key, _) = events.next()?;
        let is_names = match &key {
            Event::MappingEnd => return Err(ReadError::new(path, "there is no \"names:\"")),
            Event::Scalar(text, ..) => text == "names",
            _ => false,
        };
        events.skip(&key)?;
        let (value, span) = events.next()?;
        match value {
            Event::SequenceStart(..) if is_names => return listed_names(&mut events),
            Event::MappingStart(..) if is_names => return numbered_names(&mut events),
            _ if is_names => {
                return Err(
                    events.unexpected(&span, "expected a list of names, or numbers with names, after \"names:\"")
                );
            }
            value => events.skip(&value)?,
        }
    }
}

/// Names in a list.
fn listed_names(events: &mut Events) -> Result<ClassNames, ReadError> {
    let mut names = BTreeMap::new();
    loop {
        match events.next()? {
            (Event::SequenceEnd, _) => return Ok(ClassNames(names)),
            (Event::Scalar(name, ..), _) => drop(names.insert(names.len() as u64, name.into_owned())),
            (_, span) => return Err(events.unexpected(&span, "expected the name of a class")),
        }
    }
}

/// Names with their numbers before them.
fn numbered_names(events: &mut Events) -> Result<ClassNames, ReadError> {
    let mut names = BTreeMap::new();
    loop {
        let (key, span) = events.next()?;
        let class = match key {
            Event::MappingEnd => return Ok(ClassNames(names)),
            Event::Scalar(number, ..) => number.parse().ok(),
            _ => None,
        };
        let class = class.ok_or_else(|| events.unexpected(&span, "expected the number of a class"))?;
        match events.next()? {
            (Event::Scalar(name, ..), _) => drop(names.insert(class, name.into_owned())),
            (_, span) => return Err(events.unexpected(&span, "expected the name of a class")),
        }
    }
}

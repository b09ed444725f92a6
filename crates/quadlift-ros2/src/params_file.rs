//! Files of parameters in YAML, as launch files and `--params-file` give them.

use std::path::Path;

use saphyr_parser::{Event, Parser, ScanError, StrInput};

/// How deep names are within each other.
const DEEPEST: usize = 16;

/// A value of YAML.
enum Yaml {
    Scalar(String),
    List(Vec<String>),
    Map(Vec<(String, Yaml)>),
}

/// The parameters of a node in the text of a file, as names and texts; the path is used in messages. `full_name` is that of the node,
/// such as `/robot/quadlift`.
///
/// # Errors
/// A text with the path and the line.
pub fn parse(path: &Path, text: &str, full_name: &str) -> Result<Vec<(String, String)>, String> {
    let mut parser = Parser::new_from_str(text);
    let in_file = |problem: String| format!("{}: {problem}", path.display());
    let root = loop {
        match next(&mut parser).map_err(in_file)? {
            Event::StreamEnd | Event::DocumentEnd => return Ok(Vec::new()),
            Event::StreamStart | Event::DocumentStart(_) | Event::Nothing => {}
            event => break value(&mut parser, event, 0).map_err(in_file)?,
        }
    };
    let Yaml::Map(nodes) = root else {
        return Err(in_file("expected names of nodes, and below them \"ros__parameters:\"".to_owned()));
    };
    let mut found = Vec::new();
    nodes.into_iter().for_each(|(name, content)| of_nodes(&name, content, full_name, &mut found));
    Ok(found)
}

/// Collects the parameters below a name that is this node's, in a namespace or not.
fn of_nodes(name: &str, content: Yaml, full_name: &str, found: &mut Vec<(String, String)>) {
    let Yaml::Map(members) = content else { return };
    for (key, value) in members {
        if key == "ros__parameters" {
            if is_name_of(name, full_name) {
                collect("", value, found);
            }
        } else {
            of_nodes(
                &format!("{}/{}", name.trim_end_matches('/'), key.trim_start_matches('/')),
                value,
                full_name,
                found,
            );
        }
    }
}

/// Whether a name in a file means this node: `/**` and `*` stand for any part.
fn is_name_of(name: &str, full_name: &str) -> bool {
    let tail = name.trim_start_matches('/');
    let full = full_name.trim_start_matches('/');
    match tail {
        "**" | "*" => true,
        _ => match tail.strip_prefix("**/") {
            Some(last) => full == last || full.ends_with(&format!("/{last}")),
            None => full == tail || !name.starts_with('/') && full.rsplit('/').next() == Some(tail),
        },
    }
}

fn collect(prefix: &str, value: Yaml, found: &mut Vec<(String, String)>) {
    match value {
        Yaml::Scalar(text) => found.push((prefix.to_owned(), text)),
        Yaml::List(items) => found.push((prefix.to_owned(), format!("[{}]", items.join(", ")))),
        Yaml::Map(members) => {
            for (key, value) in members {
                let name = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
                collect(&name, value, found);
            }
        }
    }
}

fn next<'a>(parser: &mut Parser<'a, StrInput<'a>>) -> Result<Event<'a>, String> {
    let invalid =
        |error: ScanError| format!("line {}: this is not valid YAML: {}", error.marker().line(), error.info());
    match parser.next() {
        Some(event) => event.map(|(event, _)| event).map_err(invalid),
        None => Err("the file ends too early".to_owned()),
    }
}

fn value<'a>(parser: &mut Parser<'a, StrInput<'a>>, first: Event<'a>, depth: usize) -> Result<Yaml, String> {
    if depth > DEEPEST {
        return Err(format!("the YAML has more than {DEEPEST} levels"));
    }
    match first {
        Event::Scalar(text, ..) => Ok(Yaml::Scalar(text.into_owned())),
        Event::SequenceStart(..) => {
            let mut items = Vec::new();
            loop {
                match next(parser)? {
                    Event::SequenceEnd => return Ok(Yaml::List(items)),
                    Event::Scalar(text, ..) => items.push(text.into_owned()),
                    _ => return Err("found a list in a list; expected numbers or texts".to_owned()),
                }
            }
        }
        Event::MappingStart(..) => {
            let mut members = Vec::new();
            loop {
                match next(parser)? {
                    Event::MappingEnd => return Ok(Yaml::Map(members)),
                    Event::Scalar(key, ..) => {
                        let first = next(parser)?;
                        members.push((key.into_owned(), value(parser, first, depth + 1)?));
                    }
                    _ => return Err("found a key that is no text".to_owned()),
                }
            }
        }
        _ => Err("anchors and aliases are not supported".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
/**:
  ros__parameters:
    world_frame: odom
    detections_topics: [/left/boxes, \"/right/boxes\"]
other:
  ros__parameters: {world_frame: wrong}
/robot:
  quadlift:
    ros__parameters:
      min_views: 4
quadlift:
  ros__parameters:
    state: {file: a.state}
";

    fn parsed(text: &str, name: &str) -> Result<Vec<(String, String)>, String> {
        parse("p.yaml".as_ref(), text, name)
    }

    #[test]
    fn parameters_of_the_node_are_found() {
        let text = |pairs: &[(&str, &str)]| -> Vec<(String, String)> {
            pairs.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect()
        };
        let all = [
            ("world_frame", "odom"),
            ("detections_topics", "[/left/boxes, /right/boxes]"),
            ("min_views", "4"),
            ("state.file", "a.state"),
        ];
        assert_eq!(parsed(TEXT, "/robot/quadlift").unwrap(), text(&all));
        assert_eq!(parsed(TEXT, "/map").unwrap(), text(&all[..2]));
        assert_eq!(parsed("", "/map").unwrap(), []);
    }

    #[test]
    fn files_that_are_wrong_are_named() {
        assert!(parsed("a: [", "/a").unwrap_err().starts_with("p.yaml: line "));
        assert!(parsed("- a", "/a").unwrap_err().contains("expected names of nodes"));
        assert!(parsed("a: *b", "/a").is_err());
    }
}

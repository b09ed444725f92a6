//! Layout of `-h` and `--help`: lines of at most 100 columns; the short help of `localize` has only the most important
//! options, the long help groups them.

use clap::{Arg, Command};

/// Columns of a line.
const WIDTH: usize = 100;
/// Minimum width of a help text beside an option; otherwise it is printed below the option.
const LEAST: usize = 46;

/// Options in the short help of `localize`, with shorter texts.
const SHORT: [(&str, &str); 10] = [
    ("scenes", "Scene files, folders that hold them, or patterns in quotes"),
    ("output", "Output file"),
    ("report", "Write a report, an HTML page"),
    ("cameras", "Cameras of another program (COLMAP, nerfstudio, KITTI, ...)"),
    ("detections", "Detections of another program (YOLO, COCO, CSV, ...)"),
    ("source", "Use only the detections of this source"),
    ("body", "ellipsoid, cuboid, cylinder, superellipsoid:Q or auto"),
    ("associate", "Associate detections first: auto (if any lack an id), never or always"),
    ("priors", "Typical sizes of categories"),
    ("fix", "Apply the corrections that the self-check proposes"),
];

/// The end of the short help of `localize`.
const AFTER_SHORT: &str = "\
Examples:
  quadlift localize scene.json -o objects.json --report objects.html
  quadlift localize --cameras sparse/0 --detections runs/detect/predict -o objects.json

quadlift localize --help explains all options and exit codes.";

/// Groups of options of `localize` that are not declared in tables, which have groups of their own.
const GROUPS: [(&str, &[&str]); 2] = [("Quality of the result", &["calibration"]), ("Running", &["detail", "threads"])];

/// The command line with its help arranged.
pub fn arrange(command: Command) -> Command {
    let command = command.mut_subcommand("localize", |localize| {
        let localize = GROUPS.iter().fold(localize, |command, (heading, names)| {
            names.iter().fold(command, |command, name| command.mut_arg(name, |arg| arg.help_heading(*heading)))
        });
        let ids = localize.get_arguments().map(|arg| arg.get_id().to_string()).collect::<Vec<_>>();
        let localize = ids.iter().filter(|id| *id != "help").fold(localize, |command, id| {
            let short = SHORT.iter().find(|(name, _)| name == id);
            command.mut_arg(id, |arg| {
                let long = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
                match short {
                    Some((_, text)) => arg.long_help(long).help(*text),
                    None => arg.hide_short_help(true),
                }
            })
        });
        let after = localize.get_after_help().map(ToString::to_string).unwrap_or_default();
        localize.after_long_help(after).after_help(AFTER_SHORT)
    });
    wrapped(command)
}

/// The command and its subcommands with lines that fit.
fn wrapped(command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let column = 2 + names.iter().map(|name| name.len()).max().unwrap_or(0) + 2;
    let command = names.iter().fold(command, |command, name| {
        command.mut_subcommand(name, |sub| {
            let about = sub.get_about().map(|about| fill(&about.to_string(), WIDTH - column));
            let sub = wrapped(sub);
            match about {
                Some(about) => sub.about(about),
                None => sub,
            }
        })
    });
    let long_about = command.get_long_about().map(ToString::to_string);
    let after = command.get_after_help().map(ToString::to_string);
    let after_long = command.get_after_long_help().map(ToString::to_string);
    let mut command = command;
    if let Some(text) = long_about {
        command = command.long_about(paragraphs(&text, WIDTH));
    }
    if let Some(text) = after {
        command = command.after_help(paragraphs(&text, WIDTH));
    }
    if let Some(text) = after_long {
        command = command.after_long_help(paragraphs(&text, WIDTH));
    }
    let in_short = command.get_arguments().filter(|arg| !arg.is_hide_short_help_set());
    let left = in_short.map(left_columns).max().unwrap_or(0);
    // The long help, if there is one, has the texts below the options.
    let has_long = command.get_long_about().is_some();
    let below = WIDTH < left + LEAST;
    let width = if below { WIDTH - 10 } else { WIDTH - left };
    command.next_line_help(below).mut_args(|arg| {
        let suffix = suffix(&arg);
        let help = arg.get_help().map(ToString::to_string);
        let long = arg.get_long_help().map(ToString::to_string).or(help.clone().filter(|_| has_long));
        let arg = help.into_iter().fold(arg, |arg, text| arg.help(help_text(&text, width, &suffix)));
        long.into_iter().fold(arg, |arg, text| arg.long_help(help_text(&text, WIDTH - 10, &suffix)))
    })
}

/// Width of an argument before its help text.
fn left_columns(arg: &Arg) -> usize {
    let long = arg.get_long().map_or(0, |name| name.len() + 4);
    let takes_values = !matches!(
        arg.get_action(),
        clap::ArgAction::SetTrue | clap::ArgAction::Count | clap::ArgAction::Help | clap::ArgAction::Version
    );
    let names = arg.get_value_names().filter(|_| takes_values);
    let values: usize = names.map_or(0, |names| names.iter().map(|name| name.len() + 3).sum());
    2 + 2 + long + values + 4
}

/// What clap writes behind the help text of an argument.
fn suffix(arg: &Arg) -> String {
    let mut suffix = String::new();
    let defaults: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
    let takes_values = arg.get_action().takes_values();
    if takes_values && !defaults.is_empty() && !arg.is_hide_default_value_set() {
        suffix += &format!(" [default: {}]", defaults.join(" "));
    }
    if takes_values && !arg.is_hide_possible_values_set() {
        let values: Vec<String> = arg.get_possible_values().iter().map(|value| value.get_name().to_owned()).collect();
        if !values.is_empty() {
            suffix += &format!(" [possible values: {}]", values.join(", "));
        }
    }
    suffix
}

/// A help text in lines of this width; if the suffix does not fit, it follows on a separate line.
fn help_text(text: &str, width: usize, suffix: &str) -> String {
    let filled = paragraphs(text, width);
    let last = filled.lines().last().unwrap_or_default().chars().count();
    if last + suffix.chars().count() > width { filled + "\n" } else { filled }
}

/// A text with filled paragraphs of this width; indented lines, and lines that follow them, are not changed.
fn paragraphs(text: &str, width: usize) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut paragraph = String::new();
    let finish = |paragraph: &mut String, lines: &mut Vec<String>| {
        if !paragraph.is_empty() {
            lines.push(fill(paragraph, width));
            paragraph.clear();
        }
    };
    for line in text.lines() {
        if line.is_empty() || line.starts_with(' ') {
            finish(&mut paragraph, &mut lines);
            lines.push(hanging(line, width));
        } else {
            if !paragraph.is_empty() {
                paragraph.push(' ');
            }
            paragraph.push_str(line);
            if line.ends_with(':') {
                finish(&mut paragraph, &mut lines);
            }
        }
    }
    finish(&mut paragraph, &mut lines);
    lines.join("\n")
}

/// A line of a list in lines that fit, with what follows the first below the text of the entry.
fn hanging(line: &str, width: usize) -> String {
    let indent = line.len() - line.trim_start().len();
    let column = line[indent..].find("  ").map_or(indent, |gap| {
        let rest = &line[indent + gap..];
        indent + gap + (rest.len() - rest.trim_start().len())
    });
    if line.chars().count() <= width || !line.is_char_boundary(column) {
        return line.to_owned();
    }
    let below = format!("\n{}", " ".repeat(column));
    line[..column].to_owned() + &fill(&line[column..], width - column).replace('\n', &below)
}

/// A text in lines that fit, each behind so many blanks.
pub fn fill_indented(text: &str, blanks: usize) -> String {
    let indent = " ".repeat(blanks);
    fill(text, WIDTH - blanks).lines().map(|line| format!("{indent}{line}")).collect::<Vec<_>>().join("\n")
}

/// The words of a text in lines of at most this many columns.
fn fill(text: &str, width: usize) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let last = lines.len() - 1;
        let columns = lines[last].chars().count();
        if columns > 0 && columns + 1 + word.chars().count() > width {
            lines.push(word.to_owned());
        } else {
            if columns > 0 {
                lines[last].push(' ');
            }
            lines[last].push_str(word);
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    /// All commands with their names.
    fn all(command: Command) -> Vec<(String, Command)> {
        let mut list = vec![(command.get_name().to_owned(), command.clone())];
        for sub in command.get_subcommands() {
            list.extend(
                all(sub.clone()).into_iter().map(|(name, sub)| (format!("{} {name}", command.get_name()), sub)),
            );
        }
        list
    }

    /// All commands as the program has them.
    fn commands() -> Vec<(String, Command)> {
        let mut command = arrange(crate::Cli::command());
        command.build();
        all(command)
    }

    #[test]
    fn every_help_fits_a_hundred_columns() {
        for (name, mut command) in commands() {
            for text in [command.render_help().to_string(), command.render_long_help().to_string()] {
                for line in text.lines() {
                    assert!(line.chars().count() <= WIDTH, "{name}: {} columns: {line}", line.chars().count());
                }
            }
        }
    }

    #[test]
    fn the_short_help_of_localize_shows_what_people_need_and_the_long_one_all() {
        let mut localize = commands().into_iter().find(|(name, _)| name == "quadlift localize").unwrap().1;
        let (short, long) = (localize.render_help().to_string(), localize.render_long_help().to_string());
        assert!(short.lines().count() <= 40, "{short}");
        // Without the scenes, which are no option, and with --json and --help.
        assert_eq!(short.matches("\n      --").count() + short.matches("\n  -").count(), SHORT.len() + 1, "{short}");
        for name in ["--method", "--sigmas", "letterbox=WxH", "--max-pixels"] {
            assert!(!short.contains(name) && long.contains(name), "{name}");
        }
        let research = long.find("For research").unwrap();
        assert!(long.find("--method <").unwrap() > research && long.find("--reg-weight").unwrap() > research);
    }

    #[test]
    fn texts_are_filled_and_lists_stay() {
        assert_eq!(fill("a bb ccc\ndd", 5), "a bb\nccc\ndd");
        let entry = format!("  a  {}", "word ".repeat(25).trim_end());
        assert_eq!(
            hanging(&entry, WIDTH),
            format!("  a  {}\n     {}", "word ".repeat(19).trim_end(), "word ".repeat(6).trim_end())
        );
        assert_eq!(paragraphs("one\ntwo\n\nList:\n  a  b\n  c", WIDTH), "one two\n\nList:\n  a  b\n  c");
    }
}

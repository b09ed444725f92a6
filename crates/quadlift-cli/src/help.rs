//! Layout of `-h` and `--help`: commands and options grouped under headings, lines of at most 100 columns. `-h` has short
//! texts, and for `localize` only the usual options; `--help` has long ones.

mod texts;

use clap::{Arg, ArgAction, Command};
use quadlift_io::formats;

use anstyle::Style;
use texts::{HEADINGS, HIDDEN, TEXTS, Text, USUAL};

use crate::options::is_declared;

/// Columns of a line.
const WIDTH: usize = 100;
/// Style of headings, as clap's.
const HEADING: Style = Style::new().bold().underline();
/// Style of the names of commands, as clap's.
const LITERAL: Style = Style::new().bold();
/// Minimum width of a help text beside an option; otherwise it is printed below the option.
const LEAST: usize = 46;

/// The commands under their headings.
const COMMANDS: [(&str, &[&str]); 5] = [
    ("Estimate", &["localize", "associate", "segment", "stream"]),
    ("Cameras and maps", &["relocalize", "align", "calibrate-rig"]),
    ("Convert", &["import", "export"]),
    ("Inspect", &["info", "evaluate", "view", "render"]),
    ("Start", &["demo", "synth", "completions", "help"]),
];

/// The end of the short help of `localize`.
const AFTER_SHORT: &str = "\
Examples:
  quadlift localize scene.json -o objects.json --report objects.html
  quadlift localize --cameras sparse/0 --detections runs/detect/predict -o objects.json

quadlift localize --help explains these and further options, and exit codes.";

/// The command line with its help arranged.
pub(crate) fn arrange(command: Command) -> Command {
    wrapped(grouped(command))
}

/// The command line with options and commands under headings, and short and long texts.
pub(crate) fn grouped(command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let command = names.iter().fold(with_texts(command, ""), |command, name| {
        command.mut_subcommand(name, |sub| {
            let formats: Vec<String> = sub.get_subcommands().map(|format| format.get_name().to_owned()).collect();
            let sub = formats.iter().fold(with_texts(sub, name), |sub, format| {
                sub.mut_subcommand(format, |format| with_texts(format, name))
            });
            if formats.is_empty() { sub } else { with_listed_commands(sub, &groups_of_formats(name)) }
        })
    });
    let command = command.mut_subcommand("localize", |localize| {
        let ids: Vec<String> = localize.get_arguments().map(|arg| arg.get_id().to_string()).collect();
        let localize = ids.iter().fold(localize, |localize, id| {
            localize.mut_arg(id, |arg| {
                let is_usual = ["help"].iter().chain(&USUAL).any(|usual| usual == id);
                arg.hide_short_help(!is_usual).hide(HIDDEN.contains(&&**id))
            })
        });
        let after = localize.get_after_help().map(ToString::to_string).unwrap_or_default();
        localize.after_long_help(after).after_help(AFTER_SHORT)
    });
    let groups = COMMANDS.map(|(heading, names)| (heading, names.iter().map(|name| (*name).to_owned()).collect()));
    with_listed_commands(command, &groups)
}

/// The formats of `import` or `export` under their headings.
fn groups_of_formats(command: &str) -> Vec<(&'static str, Vec<String>)> {
    let detections: Vec<String> = formats::detections().map(|format| format.name.to_owned()).collect();
    let poses: Vec<String> = formats::poses().map(|format| format.name.to_owned()).collect();
    match command {
        "import" => vec![("Cameras and poses", poses), ("Detections", detections)],
        _ => Vec::new(),
    }
}

/// The command whose help lists its commands under headings; what is in no group comes last, as "Formats".
fn with_listed_commands(command: Command, groups: &[(&'static str, Vec<String>)]) -> Command {
    let mut about: Vec<(String, String)> = command
        .get_subcommands()
        .filter(|sub| !sub.is_hide_set())
        .map(|sub| (sub.get_name().to_owned(), sub.get_about().map(ToString::to_string).unwrap_or_default()))
        .collect();
    if groups.iter().any(|(_, names)| names.iter().any(|name| name == "help")) {
        about.push(("help".to_owned(), "Print the help of a command".to_owned()));
    }
    let column = about.iter().map(|(name, _)| name.len()).max().unwrap_or(0) + 2;
    let mut text = String::new();
    let mut list = |heading: &str, rows: &[&(String, String)]| {
        if rows.is_empty() {
            return;
        }
        text.push_str(&format!("{HEADING}{heading}:{HEADING:#}\n"));
        for (name, about) in rows {
            let about = fill(about, WIDTH - column - 2).replace('\n', &format!("\n{}", " ".repeat(column + 2)));
            text.push_str(&format!("  {LITERAL}{name}{LITERAL:#}{}{about}\n", " ".repeat(column - name.len())));
        }
        text.push('\n');
    };
    for (heading, names) in groups {
        let rows: Vec<_> = names.iter().filter_map(|name| about.iter().find(|(known, _)| known == name)).collect();
        list(heading, &rows);
    }
    let is_listed = |name: &String| groups.iter().any(|(_, names)| names.contains(name));
    let others: Vec<_> = about.iter().filter(|(name, _)| !is_listed(name)).collect();
    list("Formats", &others);
    command.help_template(format!("{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{text}{HEADING}Options:{HEADING:#}\n{{options}}{{after-help}}"))
}

/// A command, below the one with this name, with the texts of its options under headings.
fn with_texts(command: Command, name: &str) -> Command {
    // The text of the command, or that of all.
    let text_of = |arg: &Arg| {
        let of = |command: &str| TEXTS.iter().find(|text| text.command == command && arg.get_id() == text.id);
        of(name).or(of(""))
    };
    let rank = |arg: &Arg| HEADINGS.iter().position(|heading| Some(*heading) == heading_of(arg, text_of(arg)));
    let mut ids: Vec<(Option<usize>, String)> =
        command.get_arguments().map(|arg| (rank(arg), arg.get_id().to_string())).collect();
    // The headings come in the order in which clap finds them, and an argument that is changed comes last.
    ids.sort_by_key(|(rank, _)| *rank);
    let command = ids.iter().fold(command, |command, (_, id)| {
        command.mut_arg(id, |arg| {
            if is_declared(name, id) {
                return arg;
            }
            let Some(text) = text_of(&arg) else { return arg };
            let place = TEXTS.iter().position(|other| std::ptr::eq(other, text));
            let arg = arg.display_order(place.unwrap_or(TEXTS.len()));
            let heading = heading_of(&arg, Some(text)).map(str::to_owned);
            let long = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
            let arg = if arg.get_action().takes_values() && !text.placeholder.is_empty() {
                arg.value_name(text.placeholder)
            } else {
                arg
            };
            let arg = arg.help(text.short).long_help(long);
            heading.into_iter().fold(arg, Arg::help_heading)
        })
    });
    let help = Arg::new("help").short('h').long("help").action(ArgAction::Help).help("Print help");
    let help = help.long_help("Print help; -h prints a summary").help_heading("Run").display_order(TEXTS.len());
    let command = command.disable_help_flag(true).arg(help);
    if name.is_empty() && command.get_version().is_some() {
        let version = Arg::new("version").short('V').long("version").action(ArgAction::Version).help("Print version");
        return command.disable_version_flag(true).arg(version);
    }
    command
}

/// The heading of an argument.
fn heading_of<'a>(arg: &'a Arg, text: Option<&Text>) -> Option<&'a str> {
    text.map(|text| text.heading).filter(|heading| !heading.is_empty()).or(arg.get_help_heading())
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
        // Below a long help the suffix has a line of its own.
        long.into_iter().fold(arg, |arg, text| arg.long_help(paragraphs(&text, WIDTH - 10)))
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
pub(crate) fn fill_indented(text: &str, blanks: usize) -> String {
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

    /// Number of options that a help shows.
    fn shown(text: &str) -> usize {
        text.lines().filter(|line| line.trim_start().starts_with('-') && line.contains("--")).count()
    }

    #[test]
    fn the_short_help_of_localize_has_thirty_options_at_most_and_the_long_one_forty_five() {
        let mut localize = commands().into_iter().find(|(name, _)| name == "quadlift localize").unwrap().1;
        let (short, long) = (localize.render_help().to_string(), localize.render_long_help().to_string());
        assert!((20..=30).contains(&shown(&short)), "{}: {short}", shown(&short));
        assert!((31..=45).contains(&shown(&long)), "{}: {long}", shown(&long));
        for name in ["--min-views", "--noise-model", "letterbox=WxH", "--max-pixels"] {
            assert!(!short.contains(name) && long.contains(name), "{name}");
        }
        for name in ["--method", "--world-object", "--topics"] {
            assert!(!short.contains(name) && !long.contains(name), "{name}");
        }
        let ids: Vec<_> = localize.get_arguments().map(|arg| arg.get_id().to_string()).collect();
        assert!(USUAL.iter().chain(&HIDDEN).all(|id| ids.iter().any(|known| known == id)), "{ids:?}");
    }

    /// Whether a text has three to eight words, at most 60 characters and no parentheses.
    fn is_short(text: &str) -> bool {
        (3..=8).contains(&text.split_whitespace().count()) && text.chars().count() <= 60 && !text.contains('(')
    }

    #[test]
    fn commands_and_options_have_short_texts_and_options_long_ones_too() {
        for (name, command) in commands() {
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            let is_format = name.matches(' ').count() > 1;
            assert!(name == "quadlift" || is_format || name.contains(" help") || is_short(&about), "{name}: {about}");
            for arg in command.get_arguments().filter(|arg| !["help", "version"].contains(&arg.get_id().as_str())) {
                let text = arg.get_help().map(ToString::to_string).unwrap_or_default();
                assert!(name.contains(" help") || is_short(text.trim_end()), "{name} {}: {text}", arg.get_id());
                assert!(name.contains(" help") || arg.get_long_help().is_some(), "{name} {}", arg.get_id());
            }
        }
    }

    #[test]
    fn every_text_is_of_an_argument_and_every_heading_has_its_place() {
        let all = commands();
        let has = |text: &Text| {
            let mut of_command =
                all.iter().filter(|(name, _)| name.split(' ').nth(1).unwrap_or_default().contains(text.command));
            of_command.any(|(_, command)| command.get_arguments().any(|arg| arg.get_id() == text.id))
        };
        for text in TEXTS {
            assert!(has(text), "{} {}", text.command, text.id);
        }
        for (name, command) in &all {
            for heading in command.get_arguments().filter_map(Arg::get_help_heading) {
                assert!(HEADINGS.contains(&heading), "{name}: {heading}");
            }
        }
    }

    #[test]
    fn placeholders_say_what_goes_there() {
        for (name, command) in commands() {
            for arg in command.get_arguments().filter(|arg| arg.get_action().takes_values()) {
                for placeholder in arg.get_value_names().into_iter().flatten() {
                    let says_nothing =
                        ["NAME", "WHAT", "WHEN", "WHERE", "HOW", "X", "S", "SD"].contains(&&**placeholder);
                    assert!(!says_nothing, "{name} {}: {placeholder}", arg.get_id());
                }
            }
        }
    }

    #[test]
    fn every_command_is_listed_under_a_heading() {
        let text = arrange(crate::Cli::command()).render_help().to_string();
        let (list, _) = text.split_once("Options:").unwrap();
        for command in crate::Cli::command().get_subcommands().filter(|command| !command.is_hide_set()) {
            assert!(list.contains(&format!("\n  {} ", command.get_name())), "{}: {list}", command.get_name());
        }
        assert!(!list.contains("Formats:") && list.contains("\nEstimate:\n  localize "), "{list}");
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

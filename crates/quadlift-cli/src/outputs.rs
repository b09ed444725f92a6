//! Outputs of a run, from the command line alone: outputs that are inputs, and standard output.

use std::ffi::OsStr;
use std::path::Path;

use clap::ArgMatches;
use quadlift_io::guard::is_same_file;
use quadlift_io::is_standard_output;

use crate::error::usage;

/// The output options of all commands.
const OUTPUTS: [&str; 3] = ["output", "report", "views"];

/// Outputs of `quadlift synth` alone; elsewhere a truth is read.
const OUTPUTS_OF_SYNTH: [&str; 1] = ["ground_truth"];

/// Outputs of `quadlift stream` alone. The state may be read as well, before it is written.
const OUTPUTS_OF_STREAM: [&str; 3] = ["map", "state", "rerun"];

/// The name of the standard input among the inputs, where there is a path to it.
const STANDARD_INPUT: &str = "standard input";

/// The outputs and inputs of a command, by the names of their options.
pub(crate) struct Paths<'a> {
    outputs: Vec<(&'a str, &'a Path)>,
    inputs: Vec<(&'a str, &'a Path)>,
    command: &'a str,
}

impl<'a> Paths<'a> {
    /// Those of the whole command line.
    pub(crate) fn new(matches: &'a ArgMatches) -> Self {
        let mut paths = Self { outputs: Vec::new(), inputs: Vec::new(), command: "" };
        let mut matches = matches;
        let mut command = "";
        while let Some((name, below)) = matches.subcommand() {
            command = if command.is_empty() { name } else { command };
            matches = below;
        }
        paths.command = command;
        for id in matches.ids() {
            // Groups of options have ids too, the names of their structs, and names of options as values.
            if id.as_str().starts_with(char::is_uppercase) {
                continue;
            }
            let Ok(Some(values)) = matches.try_get_raw(id.as_str()) else { continue };
            let is_output = OUTPUTS.contains(&id.as_str())
                || command == "synth" && OUTPUTS_OF_SYNTH.contains(&id.as_str())
                || command == "stream" && OUTPUTS_OF_STREAM.contains(&id.as_str());
            let list = if is_output { &mut paths.outputs } else { &mut paths.inputs };
            list.extend(values.map(|value: &OsStr| (id.as_str(), Path::new(value))));
        }
        if command == "stream" && !paths.inputs.iter().any(|(name, _)| *name == "input") {
            paths.inputs.push((STANDARD_INPUT, Path::new("/dev/stdin")));
        }
        paths
    }

    /// Whether an output is standard output, as the events of `quadlift stream` are: messages must not be mixed with it.
    pub(crate) fn to_standard_output(&self) -> bool {
        self.command == "stream" || self.outputs.iter().any(|(_, path)| is_standard_output(path))
    }

    /// Refuses outputs that are a file which is read, or one file twice, before anything is computed.
    pub(crate) fn check(&self, json: bool) -> anyhow::Result<()> {
        for (index, &(option, output)) in self.outputs.iter().enumerate() {
            let what = if option == "report" { "report" } else { "result" };
            if self.command == "stream" && is_standard_output(output) {
                return usage(format!("events go to the standard output, where the {what} would go too"));
            }
            if json && is_standard_output(output) {
                return usage(format!("--json writes to standard output, and so would the {what}"));
            }
            for &(name, input) in &self.inputs {
                // The scene of `quadlift import` may be changed in place.
                if name == "into" || !is_same_file(input, output) {
                    continue;
                }
                return usage(match name {
                    STANDARD_INPUT => format!("the {what} would overwrite {}, the standard input", output.display()),
                    "scene" | "scenes" | "input" => format!("the {what} would overwrite the scene {}", input.display()),
                    _ => format!(
                        "the {what} would overwrite {}, which is an input; choose another name",
                        input.display()
                    ),
                });
            }
            let twice = |(_, other): &&(_, &Path)| {
                is_same_file(other, output)
                    || is_standard_output(other) && is_standard_output(output)
                    || self.command == "stream" && *other == output
            };
            if let Some((_, other)) = self.outputs[..index].iter().find(twice) {
                return usage(format!("the {what} would overwrite {}; choose another name", other.display()));
            }
        }
        Ok(())
    }
}

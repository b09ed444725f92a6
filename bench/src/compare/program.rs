//! One program with its options, run on one scene.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, bail};
use quadlift_io::{SceneFile, read_scene_file};

use crate::processor_time::{Of, processor_time};

/// A program and options of `localize`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Program {
    path: PathBuf,
    options: Vec<String>,
}

/// The end of a run.
pub(super) struct Finished {
    /// The result; none if no object was localized or the scene was found inconsistent.
    pub result: Option<SceneFile>,
    /// Processor time; unknown on systems other than Unix.
    pub time: Option<Duration>,
}

impl Program {
    /// A path, and options after it: `target/release/quadlift --body ellipsoid`. A path may contain spaces if no options follow.
    pub(super) fn parse(text: &str) -> anyhow::Result<Self> {
        let mut words = text.split_whitespace();
        let (path, options) = match words.next() {
            Some(path) if !Path::new(text).is_file() => (path, words.map(str::to_owned).collect()),
            _ => (text, Vec::new()),
        };
        if !Path::new(path).is_file() {
            bail!(
                "{path}: there is no such program; expected the path of a quadlift program, such as target/release/quadlift"
            );
        }
        Ok(Self { path: path.into(), options })
    }

    /// Localizes a scene with one thread. `options` are those of the set; its own options replace them.
    ///
    /// # Errors
    /// The program cannot be started, rejects its options, or ends in another way than with the exit codes 0, 1 and 3.
    pub(super) fn localize(&self, input: &Path, output: &Path, options: &[&str]) -> anyhow::Result<Finished> {
        let mut command = Command::new(&self.path);
        command.arg("localize").arg(input).arg("-o").arg(output).arg("--quiet");
        command.args(without_replaced(options, &self.options)).args(&self.options);
        command.env("RAYON_NUM_THREADS", "1").stdin(Stdio::null()).stdout(Stdio::null());
        if output.exists() {
            std::fs::remove_file(output)?;
        }
        let before = processor_time(Of::Children);
        let run = command.output().with_context(|| format!("cannot run {}", self.path.display()))?;
        let time = processor_time(Of::Children).zip(before).map(|(after, before)| after.saturating_sub(before));
        if !matches!(run.status.code(), Some(0 | 1 | 3)) {
            bail!("{command:?} failed ({}): {}", run.status, String::from_utf8_lossy(&run.stderr).trim());
        }
        // Of exit code 1 a result may be missing: there is no object in it.
        let result = if output.exists() { Some(read_scene_file(output)?) } else { None };
        Ok(Finished { result, time })
    }
}

/// The options of a set without those that `own` has, each with its value.
fn without_replaced<'a>(options: &[&'a str], own: &[String]) -> Vec<&'a str> {
    let name = |word: &str| word.split('=').next().unwrap_or_default().to_owned();
    let replaced: Vec<String> = own.iter().map(|word| name(word)).collect();
    let mut kept = Vec::new();
    let mut keeps = true;
    for option in options {
        if option.starts_with("--") {
            keeps = !replaced.contains(&name(option));
        }
        if keeps {
            kept.push(*option);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_options_replace_those_of_the_set() {
        let set = ["--body", "cuboid", "--priors", "builtin", "--upright"];
        let kept =
            |own: &[&str]| without_replaced(&set, &own.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>());
        assert_eq!(kept(&[]), set);
        assert_eq!(kept(&["--body", "ellipsoid"]), ["--priors", "builtin", "--upright"]);
        assert_eq!(kept(&["--priors=scene", "--upright"]), ["--body", "cuboid"]);
    }

    #[test]
    fn a_program_is_a_path_and_options() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a program");
        let plain = folder.path().join("program");
        std::fs::write(&path, "").unwrap();
        std::fs::write(&plain, "").unwrap();
        assert_eq!(Program::parse(path.to_str().unwrap()).unwrap(), Program { path, options: Vec::new() });
        let text = format!("{} --body ellipsoid", plain.display());
        let options = vec!["--body".to_owned(), "ellipsoid".to_owned()];
        assert_eq!(Program::parse(&text).unwrap(), Program { path: plain, options });
        assert!(Program::parse("nowhere --body ellipsoid").unwrap_err().to_string().starts_with("nowhere: "));
    }
}

//! Options that correct common mistakes in a scene, shared by `localize`, `associate`, `segment` and `info`.

use std::path::Path;

use quadlift::diagnosis::Correction;
use quadlift_io::correct::assume::{self, KEYS, Key};
use quadlift_io::correct::{Assumption, RecordCorrection};
use quadlift_io::read_scene_file;
use quadlift_io::run::FileInput;

use crate::error::usage;
use crate::files::with_hint;
use crate::output::one_line;

/// Corrections of conventions in the scene, in the form in which the check proposes them.
#[derive(clap::Args)]
#[command(next_help_heading = "Corrections of the scene")]
pub(crate) struct Corrections {
    #[arg(long, value_name = "KEY=VALUE", value_delimiter = ',', value_parser = str::parse::<Assumption>, help = keys())]
    assume: Vec<Assumption>,

    /// World direction against gravity: x, y, z, -x, -y, -z or X,Y,Z
    #[arg(long, value_name = "AXIS", value_parser = up, allow_hyphen_values = true)]
    up: Option<Up>,
}

/// The keys of `--assume`, a line of the help each.
fn keys() -> String {
    let column = KEYS.iter().map(|key| key.name.len() + key.value.len() + 1).max().unwrap_or(0);
    let line = |key: &Key| format!("  {:column$}  {}", format!("{}={}", key.name, key.value), key.meaning);
    let lines: Vec<String> = KEYS.iter().map(line).collect();
    format!("What the inputs really are; several are joined by commas, or given one by one:\n{}", lines.join("\n"))
}

/// A direction, as one value of an option.
#[derive(Debug, Clone, Copy)]
struct Up([f64; 3]);

fn up(text: &str) -> Result<Up, String> {
    assume::up(text).map(Up)
}

impl Corrections {
    /// The requested corrections.
    pub(crate) fn list(&self) -> anyhow::Result<Vec<RecordCorrection>> {
        let mut list = corrections_of(&self.assume)?;
        list.extend(self.up.map(|up| RecordCorrection::Known(Correction::Up(up.0))));
        Ok(list)
    }
}

/// The corrections of `--assume`.
pub(crate) fn corrections_of(assumptions: &[Assumption]) -> anyhow::Result<Vec<RecordCorrection>> {
    Assumption::corrections(assumptions).or_else(|error| usage(format!("--assume: {error}")))
}

/// Descriptions of the corrections, one per line.
pub(crate) fn corrected_in_words(notes: &[String]) -> String {
    notes.iter().map(|note| format!("corrected: {}\n", one_line(note))).collect()
}

/// Reads a scene file, corrects it and checks it.
pub(crate) fn read_input(path: &Path, corrections: &[RecordCorrection]) -> anyhow::Result<FileInput> {
    let file = read_scene_file(path).map_err(|error| with_hint(path, error))?;
    Ok(FileInput::from_file(file, path, corrections)?)
}

//! Priors on categories: a TOML file with one table per category.
//!
//! ```toml
//! [car]
//! size = [4.2, 1.75, 1.55]       # length, width, height: full extents in world units
//! size_sd = [0.4, 0.12, 0.15]    # their standard deviations
//! upright_sd = 0.05              # radians, of the angle between the vertical axis and the scene's "up"
//! on_ground = true
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::solve::{CategoryPrior, CategoryPriors, SizePrior};
use serde::Deserialize;

use crate::error::ReadError;
use crate::input::{as_utf8, line_and_column, read_bytes};
use crate::numbers;
use crate::wording::plain_words;

/// Sizes of things on the road and in the house, in meters.
const BUILTIN: &str = include_str!("../priors/builtin.toml");

/// A table of the file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorRecord {
    #[serde(default, deserialize_with = "numbers::optional_list")]
    size: Option<[f64; 3]>,
    #[serde(default, deserialize_with = "numbers::optional_list")]
    size_sd: Option<[f64; 3]>,
    upright_sd: Option<f64>,
    #[serde(default)]
    on_ground: bool,
}

/// A checked table; a failed check gets the place of the table from the TOML reader.
#[derive(Deserialize)]
#[serde(try_from = "PriorRecord")]
struct Checked(CategoryPrior);

impl TryFrom<PriorRecord> for Checked {
    type Error = String;

    fn try_from(record: PriorRecord) -> Result<Self, String> {
        let positive = |name: &str, values: [f64; 3]| {
            let good = values.iter().all(|x| *x > 0.0 && x.is_finite());
            if good { Ok(values) } else { Err(format!("{name} = {values:?} must be three positive numbers")) }
        };
        let size = match (record.size, record.size_sd) {
            (Some(size), Some(sd)) => Some(SizePrior { mean: positive("size", size)?, sd: positive("size_sd", sd)? }),
            (None, None) => None,
            (Some(_), None) => return Err("size without size_sd; give both or none".to_owned()),
            (None, Some(_)) => return Err("size_sd without size; give both or none".to_owned()),
        };
        if let Some(sd) = record.upright_sd
            && !(sd > 0.0 && sd.is_finite())
        {
            return Err(format!("upright_sd = {sd} must be a positive number (radians)"));
        }
        Ok(Self(CategoryPrior { size, upright_sd: record.upright_sd, on_ground: record.on_ground }))
    }
}

/// Reads a file of priors.
///
/// # Errors
/// [`ReadError`] if the file cannot be read or is not TOML, and for unknown keys, sizes that are not positive, and a
/// `size` without `size_sd` (or the other way round).
pub fn read_priors(path: &Path) -> Result<CategoryPriors, ReadError> {
    let bytes = read_bytes(path)?;
    parse_priors(path, as_utf8(path, &bytes)?)
}

/// The priors in the text of a file; the path only serves for messages.
///
/// # Errors
/// As [`read_priors`].
pub(crate) fn parse_priors(path: &Path, text: &str) -> Result<CategoryPriors, ReadError> {
    let deserializer = toml::Deserializer::parse(text).map_err(|error| describe(path, text, &error, None))?;
    let tables: BTreeMap<String, Checked> = serde_path_to_error::deserialize(deserializer).map_err(|error| {
        let outside = text.parse::<toml::Table>().ok().and_then(|t| t.into_iter().find(|(_, value)| !value.is_table()));
        if let Some((key, _)) = outside {
            let problem = format!("\"{key}\" is outside a table; expected one table per category, such as [car]");
            return ReadError { problem, ..describe(path, text, error.inner(), None) };
        }
        let entry = Some(error.path().to_string()).filter(|entry| entry != ".");
        describe(path, text, error.inner(), entry)
    })?;
    Ok(CategoryPriors { by_category: tables.into_iter().map(|(name, Checked(prior))| (name, prior)).collect() })
}

fn describe(path: &Path, text: &str, error: &toml::de::Error, entry: Option<String>) -> ReadError {
    let (line, column) = error.span().map_or((0, 0), |span| line_and_column(text.as_bytes(), span.start));
    let read_error = ReadError::new(path, plain_words(error.message())).at(line, column);
    match entry {
        Some(entry) => read_error.in_entry(entry),
        None => read_error,
    }
}

/// The priors that come with quadlift, for scenes in meters: road users and household objects, by the lower-case names
/// of KITTI and COCO. The file `priors/builtin.toml` documents their sources.
pub fn builtin_priors() -> CategoryPriors {
    // The text is part of the program and a test reads it; without it there would be no priors, never a panic.
    parse_priors(Path::new("builtin.toml"), BUILTIN).unwrap_or_default()
}

/// Size ranges for a length unit: the built-in priors for meters, otherwise nothing.
pub(crate) fn plausible_sizes(length_unit: Option<&str>) -> CategoryPriors {
    if length_unit == Some("m") { builtin_priors() } else { CategoryPriors::default() }
}

/// Refuses a length unit that is not the built-in priors'.
///
/// # Errors
/// What the unit is and what to do, in words.
pub fn check_meters(length_unit: Option<&str>) -> Result<(), String> {
    let unit = match length_unit {
        Some("m") => return Ok(()),
        Some(unit) => format!("\"{unit}\""),
        None => "not given".to_owned(),
    };
    Err(format!(
        "the built-in priors are sizes in meters, but the length unit of the scene is {unit}; set \"length_unit\": \
         \"m\" if it is in meters, or give a file of priors in its unit"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insta::assert_snapshot;

    fn error(text: &str) -> String {
        parse_priors(Path::new("priors.toml"), text).unwrap_err().to_string()
    }

    #[test]
    fn a_file_of_priors_is_read() {
        let text = "[car]\nsize = [4, 1.75, 1.55]\nsize_sd = [0.4, 0.12, 0.15]\nupright_sd = 0.05\non_ground = true\n\
                    [\"potted plant\"]\nupright_sd = 0.1\n";
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("priors.toml");
        std::fs::write(&path, text).unwrap();
        let priors = read_priors(&path).unwrap();
        let car = CategoryPrior {
            size: Some(SizePrior { mean: [4.0, 1.75, 1.55], sd: [0.4, 0.12, 0.15] }),
            upright_sd: Some(0.05),
            on_ground: true,
        };
        assert_eq!(priors.by_category["car"], car);
        assert_eq!(priors.by_category["potted plant"], CategoryPrior { upright_sd: Some(0.1), ..Default::default() });
        assert!(read_priors(&folder.path().join("no.toml")).unwrap_err().problem.contains("no such file"));
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        assert_snapshot!(error("[car]\nupright_sd = 0.1\ncolor = 3\n"), @"priors.toml:3:1: car.color: unknown field `color`, expected one of `size`, `size_sd`, `upright_sd`, `on_ground`");
        assert_snapshot!(error("[car]\non_ground = true\nsize = [4, 2, 1]\n"), @"priors.toml:1:1: car: size without size_sd; give both or none");
        assert_snapshot!(error("[car]\nsize_sd = [4, 2, 1]\n"), @"priors.toml:1:1: car: size_sd without size; give both or none");
        assert_snapshot!(error("[car]\nsize = [4, 2, 0]\nsize_sd = [1, 1, 1]\n"), @"priors.toml:1:1: car: size = [4.0, 2.0, 0.0] must be three positive numbers");
        assert_snapshot!(error("[car]\nsize = [4, 2, 1]\nsize_sd = [1, nan, 1]\n"), @"priors.toml:1:1: car: size_sd = [1.0, NaN, 1.0] must be three positive numbers");
        assert_snapshot!(error("[car]\nsize = [4, 2]\nsize_sd = [1, 1, 1]\n"), @"priors.toml:2:8: car.size: found 2 entries, expected a list of 3 numbers");
        assert_snapshot!(error("[car]\nsize = [4, 2, 1, 5]\nsize_sd = [1, 1, 1]\n"), @"priors.toml:2:8: car.size: found 4 entries, expected a list of 3 numbers");
        assert_snapshot!(error("[car]\nsize = 4\nsize_sd = [1, 1, 1]\n"), @"priors.toml:2:8: car.size: found the number `4`, expected a list of 3 numbers");
        assert_snapshot!(error("[car]\nupright_sd = -0.1\n"), @"priors.toml:1:1: car: upright_sd = -0.1 must be a positive number (radians)");
        assert_snapshot!(error("[car]\nupright_sd = \"a\"\n"), @r#"priors.toml:2:14: car.upright_sd: found the text "a", expected a number"#);
        assert_snapshot!(error("size = [4, 2, 1]\n"), @r#"priors.toml:1:9: "size" is outside a table; expected one table per category, such as [car]"#);
        assert_snapshot!(error("[car]\n[car]\n"), @"priors.toml:2:2: duplicate key");
        assert_snapshot!(error("[car\n"), @"priors.toml:1:5: unclosed table, expected `]`");
    }

    #[test]
    fn the_builtin_priors_are_readable_and_plausible() {
        let priors = parse_priors(Path::new("builtin.toml"), BUILTIN).unwrap();
        assert_eq!(builtin_priors(), priors);
        for name in ["car", "van", "truck", "pedestrian", "person", "cyclist", "chair", "cup", "tv", "potted plant"] {
            assert!(priors.by_category.contains_key(name), "{name}");
        }
        for (name, prior) in &priors.by_category {
            let size = prior.size.unwrap();
            for (mean, sd) in size.mean.iter().zip(size.sd) {
                // Nothing is known to better than a few per cent, and a wider one than half says nothing.
                assert!((0.04..=0.6).contains(&(sd / mean)), "{name}: {sd} of {mean}");
                assert!((0.005..30.0).contains(mean), "{name}: {mean}");
            }
            assert!(size.mean[0] >= size.mean[1], "{name}: the length is the longer horizontal side");
            assert_eq!(name, &name.to_lowercase());
        }
    }
}

//! Names of classes by their numbers: a plain list (`classes.txt`, `obj.names`) or the `names` of a YAML file
//! (Ultralytics' `data.yaml`; feature `yaml`).

#[cfg(feature = "yaml")]
mod yaml;

use std::collections::BTreeMap;
use std::path::Path;

use crate::error::ReadError;
use crate::input::{as_utf8, read_bytes};
use crate::read::options::ReadOptions;
use crate::wording::count;

/// Names of classes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct ClassNames(BTreeMap<u64, String>);

impl ClassNames {
    /// The name of a class.
    pub(crate) fn of(&self, class: u64) -> Option<&str> {
        self.0.get(&class).map(String::as_str)
    }
}

/// The names of classes that the options tell.
///
/// # Errors
/// As [`read_names`].
pub(super) fn names(options: &ReadOptions) -> Result<Option<ClassNames>, ReadError> {
    options.names.as_deref().map(read_names).transpose()
}

/// How many detections have a class that the file of names lacks, by class.
pub(super) fn unnamed_classes(unnamed: &BTreeMap<u64, usize>) -> Vec<String> {
    let note = |(class, number): (&u64, &usize)| {
        format!(
            "{} of the class {class}, which the class names lack: its number is the name",
            count(*number, "detection")
        )
    };
    unnamed.iter().map(note).collect()
}

/// Reads a file of names: YAML by its extension `.yaml` or `.yml`, otherwise one name in each line, from class 0.
///
/// # Errors
/// [`ReadError`] with the line, what was found and what was expected.
pub(super) fn read_names(path: &Path) -> Result<ClassNames, ReadError> {
    parse_names(path, &read_bytes(path)?)
}

/// The names in the bytes of a file; the path serves for messages and distinguishes YAML from a list.
///
/// # Errors
/// As [`read_names`].
pub(super) fn parse_names(path: &Path, bytes: &[u8]) -> Result<ClassNames, ReadError> {
    let text = as_utf8(path, bytes)?;
    let is_yaml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("yaml") || e.eq_ignore_ascii_case("yml"));
    if is_yaml {
        #[cfg(feature = "yaml")]
        return yaml::names(path, text);
        #[cfg(not(feature = "yaml"))]
        return Err(ReadError::left_out(path, "YAML files", "yaml"));
    }
    let names = (0..).zip(text.trim_end().lines().map(str::trim)).filter(|(_, name)| !name.is_empty());
    Ok(ClassNames(names.map(|(class, name)| (class, name.to_owned())).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(file: &str, text: &str) -> Result<Vec<(u64, String)>, String> {
        let names = parse_names(Path::new(file), text.as_bytes()).map_err(|error| error.to_string())?;
        Ok(names.0.into_iter().collect())
    }

    #[test]
    fn lists_and_both_forms_of_yaml() {
        let expected = vec![(0, "cup".to_owned()), (1, "traffic light".to_owned())];
        assert_eq!(names("classes.txt", "cup\r\ntraffic light\n\n").unwrap(), expected);
        for yaml in [
            "names: [cup, 'traffic light']",
            "# data\npath: ../x\ntrain:\n  - a\n  - {b: [c]}\nnames:\n  - cup\n  - traffic light # two\nnc: 2\n",
            "---\nnc: 2\nnames:\n  0: cup\n  1: \"traffic light\"\n",
            "download: |\n  names: no\nnames: {1: traffic light, 0: cup}",
        ] {
            assert_eq!(names("data.yaml", yaml).unwrap(), expected, "{yaml}");
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let message = |yaml: &str| names("data.yaml", yaml).unwrap_err();
        assert_eq!(message("nc: 2\n"), "data.yaml: there is no \"names:\"");
        assert_eq!(message("- a\n"), "data.yaml:1:1: expected keys and values, and among them \"names:\"");
        assert_eq!(
            message("nc: 1\nnames: cup\n"),
            "data.yaml:2:8: expected a list of names, or numbers with names, after \"names:\""
        );
        assert_eq!(message("names:\n  a: cup\n"), "data.yaml:2:3: expected the number of a class");
        assert_eq!(message("names:\n  - [cup]\n"), "data.yaml:2:5: expected the name of a class");
        assert!(message("names: [a, \"b\n").starts_with("data.yaml:"), "{}", message("names: [a, \"b\n"));
    }
}

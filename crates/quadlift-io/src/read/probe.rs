//! A first look at a file or folder: what rows of formats recognize it by. Each file is read once.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::de::IgnoredAny;

use super::json::parse_json;
use crate::error::ReadError;
use crate::input::{as_utf8, paths_below, read_bytes};

/// Where the reader of a format begins, if a path is of the format.
pub type Found = Result<Option<PathBuf>, ReadError>;

/// Extensions of files of which a folder may have one for each image.
const EXTENSIONS: [&str; 3] = ["txt", "json", "xml"];

/// A path that may hold some format.
#[derive(Debug)]
pub struct Probe {
    path: PathBuf,
    is_folder: bool,
    text: OnceCell<String>,
    start: OnceCell<Start>,
    /// The first files with content of a folder, by [`EXTENSIONS`].
    first: [OnceCell<Option<Box<Probe>>>; 3],
}

impl Probe {
    /// A look at a path; nothing is read yet.
    pub(crate) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            is_folder: path.is_dir(),
            text: OnceCell::new(),
            start: OnceCell::new(),
            first: Default::default(),
        }
    }

    /// The path, if a format is there.
    pub(crate) fn when(&self, is: bool) -> Found {
        Ok(is.then(|| self.path.clone()))
    }

    /// The path.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The path, if it is a folder.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.is_folder.then_some(&*self.path)
    }

    /// Whether this is a folder that has something with this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.is_folder && self.path.join(name).exists()
    }

    /// Whether the name of the file is one of these.
    pub(crate) fn is_named(&self, names: &[&str]) -> bool {
        !self.is_folder && self.path.file_name().is_some_and(|name| names.iter().any(|known| name == *known))
    }

    /// Whether the file begins with these bytes.
    #[cfg(feature = "mcap")]
    pub(crate) fn begins_with(&self, bytes: &[u8]) -> bool {
        use std::io::Read as _;
        let mut start = Vec::new();
        let read = |file: std::fs::File| file.take(bytes.len() as u64).read_to_end(&mut start);
        self.path.is_file() && std::fs::File::open(&self.path).and_then(read).is_ok() && start == bytes
    }

    /// The text of the file; empty for a folder.
    ///
    /// # Errors
    /// [`ReadError`] if it cannot be read, or is not UTF-8.
    pub(crate) fn text(&self) -> Result<&str, ReadError> {
        if self.text.get().is_none() {
            let text = match self.is_folder {
                true => String::new(),
                false => as_utf8(&self.path, &read_bytes(&self.path)?)?.to_owned(),
            };
            let _ = self.text.set(text);
        }
        Ok(self.text.get().map_or("", String::as_str))
    }

    fn start(&self) -> Result<&Start, ReadError> {
        let text = self.text()?;
        Ok(self.start.get_or_init(|| Start::of(text)))
    }

    /// The keys of the JSON object in the file, or of the first entry of the list in it; none if it holds anything else.
    ///
    /// # Errors
    /// As [`Self::text`].
    pub(crate) fn keys(&self) -> Result<Keys<'_>, ReadError> {
        Ok(match self.start()? {
            Start::Object(keys) => Keys { of_object: Some(keys), of_list: None },
            Start::List(keys) => Keys { of_object: None, of_list: Some(keys) },
            _ => Keys { of_object: None, of_list: None },
        })
    }

    /// Whether the file is XML whose outermost element has this name.
    ///
    /// # Errors
    /// As [`Self::text`].
    pub(crate) fn is_xml(&self, name: &str) -> Result<bool, ReadError> {
        Ok(matches!(self.start()?, Start::Xml(found) if found == name))
    }

    /// The first line of a text that is neither empty nor a comment.
    ///
    /// # Errors
    /// As [`Self::text`].
    pub(crate) fn line(&self) -> Result<Option<&Words>, ReadError> {
        Ok(match self.start()? {
            Start::Line(words) => Some(words),
            _ => None,
        })
    }

    /// The words of the first line and of the comment before it, in small letters: names of columns stand in one of them.
    ///
    /// # Errors
    /// As [`Self::text`].
    pub(crate) fn header(&self) -> Result<Vec<String>, ReadError> {
        let [comment, first] = first_lines(self.text()?).map(|line| Words::of(&line.to_lowercase()).words);
        Ok([comment, first].concat())
    }

    /// The file itself, or of a folder the first file with this extension that has content and is not beside the labels:
    /// it decides for all.
    ///
    /// # Errors
    /// [`ReadError`] if a folder cannot be read.
    pub(crate) fn labels(&self, extension: &str) -> Result<Option<&Self>, ReadError> {
        let Some(index) = EXTENSIONS.iter().position(|known| *known == extension && self.is_folder) else {
            return Ok(Some(self).filter(|probe| !probe.is_folder));
        };
        if self.first[index].get().is_none() {
            let has_content = |(name, path): &(String, PathBuf)| {
                !is_beside_labels(name) && !std::fs::metadata(path).is_ok_and(|data| data.len() < 2)
            };
            let found = paths_below(&self.path, extension)?.into_iter().find(has_content);
            let _ = self.first[index].set(found.map(|(_, path)| Box::new(Self::new(&path))));
        }
        Ok(self.first[index].get().and_then(|found| found.as_deref()))
    }

    /// Names the place where a file that begins as JSON does is none: that hides its format.
    ///
    /// # Errors
    /// [`ReadError`] with the place.
    pub(crate) fn check_json(&self) -> Result<(), ReadError> {
        match self.text()?.trim_ascii_start().as_bytes().first() {
            Some(b'{' | b'[') => parse_json(&self.path, self.text()?.as_bytes()).map(|_| ()),
            _ => Ok(()),
        }
    }
}

/// The last comment before the first line that is neither empty nor a comment, without its sign, and that line.
pub(super) fn first_lines(text: &str) -> [&str; 2] {
    let mut comment = "";
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
        match line.strip_prefix('#') {
            Some(line) => comment = line.trim(),
            None => return [comment, line],
        }
    }
    [comment, ""]
}

/// Texts about the data set that Roboflow puts beside the labels.
const DESCRIPTIONS: [&str; 2] = ["README.dataset.txt", "README.roboflow.txt"];

/// Whether a text file describes the data set of Roboflow.
pub(super) fn is_description(path: &Path) -> bool {
    DESCRIPTIONS.iter().any(|name| path.ends_with(name))
}

/// Whether a text file is no label file: names of classes, Roboflow's description of a data set.
fn is_beside_labels(name: &str) -> bool {
    name.ends_with("classes.txt") || is_description(Path::new(name))
}

/// How a text begins.
#[derive(Debug)]
enum Start {
    /// A JSON object, with its keys.
    Object(BTreeMap<String, IgnoredAny>),
    /// A JSON list, with the keys of its first entry.
    List(BTreeMap<String, IgnoredAny>),
    /// XML, with the name of its outermost element.
    Xml(String),
    /// The first line that is neither empty nor a comment.
    Line(Words),
}

/// Keys at the beginning of a JSON file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Keys<'a> {
    of_object: Option<&'a BTreeMap<String, IgnoredAny>>,
    of_list: Option<&'a BTreeMap<String, IgnoredAny>>,
}

impl Keys<'_> {
    /// Whether the file holds JSON.
    pub(crate) fn are_json(self) -> bool {
        self.of_object.or(self.of_list).is_some()
    }

    /// Whether the file holds a JSON object.
    pub(crate) fn are_of_object(self) -> bool {
        self.of_object.is_some()
    }

    /// Whether an object has the key, or the first entry of a list.
    pub(crate) fn has(self, key: &str) -> bool {
        self.of_object.or(self.of_list).is_some_and(|keys| keys.contains_key(key))
    }

    /// Whether an object has the key.
    pub(crate) fn object_has(self, key: &str) -> bool {
        self.of_object.is_some_and(|keys| keys.contains_key(key))
    }

    /// Whether the first entry of a list has the key.
    pub(crate) fn list_has(self, key: &str) -> bool {
        self.of_list.is_some_and(|keys| keys.contains_key(key))
    }
}

/// The fields of a line.
#[derive(Debug)]
pub(crate) struct Words {
    /// Whether they stand between commas.
    pub(crate) commas: bool,
    /// The fields.
    pub(crate) words: Vec<String>,
}

impl Words {
    /// The fields of a line: between commas or semicolons, if it has any.
    fn of(line: &str) -> Self {
        let separator = [',', ';'].into_iter().find(|separator| line.contains(*separator));
        let words = match separator {
            Some(separator) => {
                line.trim().trim_end_matches(separator).split(separator).map(|word| word.trim().to_owned()).collect()
            }
            None => line.split_whitespace().map(str::to_owned).collect(),
        };
        Self { commas: separator == Some(','), words }
    }

    /// The numbers among them.
    pub(crate) fn numbers(&self) -> Vec<Option<f64>> {
        self.words.iter().map(|word| word.parse().ok()).collect()
    }

    /// Whether all are numbers.
    pub(crate) fn are_numbers(&self) -> bool {
        self.numbers().iter().all(Option::is_some)
    }

    /// Whether they are the names of columns between commas: only the first may be a number.
    pub(crate) fn are_names(&self) -> bool {
        self.commas && self.words.iter().skip(1).all(|word| word.parse::<f64>().is_err())
    }
}

impl Start {
    fn of(text: &str) -> Self {
        let text = text.trim_start();
        if text.starts_with('{') {
            return Self::Object(serde_json::from_str(text).unwrap_or_default());
        }
        if let Some(rest) = text.strip_prefix('[') {
            let first = serde_json::Deserializer::from_str(rest).into_iter().next();
            return Self::List(first.and_then(Result::ok).unwrap_or_default());
        }
        if text.starts_with('<') {
            // Before it there may be a declaration, comments and a document type.
            let is_name = |part: &&str| part.starts_with(|c: char| c.is_alphabetic());
            let root = text.split('<').find(is_name).unwrap_or_default();
            let name = root.split(|c: char| c.is_whitespace() || "/>".contains(c)).next();
            return Self::Xml(name.unwrap_or_default().to_owned());
        }
        Self::Line(Words::of(first_lines(text)[1]))
    }
}

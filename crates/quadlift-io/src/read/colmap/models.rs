//! The models in a folder: COLMAP's mapper writes one for each part of the images that it cannot join.

use std::path::{Path, PathBuf};

/// A model: its folder, and whether it is binary (`bin`) or text (`txt`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Place {
    pub folder: PathBuf,
    pub extension: &'static str,
}

impl Place {
    /// The model in a folder, if there is one; the binary form is preferred when both exist.
    fn of(folder: PathBuf) -> Option<Self> {
        let is_there = |extension: &&str| folder.join(format!("cameras.{extension}")).is_file();
        let extension = ["bin", "txt"].into_iter().find(is_there)?;
        Some(Self { folder, extension })
    }

    /// The folder of the model, within another one.
    pub(super) fn name_in(&self, folder: &Path) -> String {
        self.folder.strip_prefix(folder).unwrap_or(&self.folder).display().to_string()
    }

    /// The model in a folder, or those in its `sparse` and in its folders with numbers, `sparse/0` first.
    pub(super) fn all_in(folder: &Path) -> Vec<Self> {
        let sparse = folder.join("sparse");
        let own = Self::of(folder.to_owned()).or_else(|| Self::of(sparse.clone()));
        let numbered = || [sparse.as_path(), folder].into_iter().flat_map(numbered_in).filter_map(Self::of);
        own.map_or_else(|| numbered().collect(), |own| vec![own])
    }
}

/// The folders in a folder whose names are numbers, by their numbers.
fn numbered_in(folder: &Path) -> Vec<PathBuf> {
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u32>().ok();
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<(u32, PathBuf)> = entries.filter_map(|path| Some((number(&path)?, path))).collect();
    found.sort();
    found.into_iter().map(|(_, path)| path).collect()
}

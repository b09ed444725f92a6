//! Paths of images, depth images, point clouds and masks, which are relative to the scene file, when that moves.

use std::path::{Component, Path, PathBuf};

use super::records::{FrameRecord, SceneFile};
use crate::error::WriteError;

impl SceneFile {
    /// Changes the paths of images, depth images, point clouds and masks when the scene file moves from the first folder to the second one.
    ///
    /// # Errors
    /// [`WriteError`] when one of the folders does not exist.
    pub fn move_paths(&mut self, folders: [&Path; 2]) -> Result<(), WriteError> {
        let move_path = relocation(folders)?;
        self.paths_mut().for_each(|path| *path = move_path(path));
        Ok(())
    }

    /// The paths of images, depth images, point clouds and masks.
    pub fn paths_mut<'a>(&'a mut self) -> impl Iterator<Item = &'a mut String> {
        let of_frame = |frame: &'a mut FrameRecord| {
            let depth = frame.depth.as_mut().map(|depth| &mut depth.path);
            let cloud = frame.point_cloud.as_mut().map(|cloud| &mut cloud.path);
            frame.image.as_mut().into_iter().chain(depth).chain(cloud)
        };
        let images = self.frames.iter_mut().flat_map(of_frame);
        let cloud = self.point_cloud.as_mut().map(|cloud| &mut cloud.path);
        images
            .chain(cloud)
            .chain(self.detections.iter_mut().filter_map(|detection| detection.mask.as_mut()?.path.as_mut()))
    }
}

/// The new relative path of an image if the scene file moves from the first folder to the second one.
fn relocation([from, to]: [&Path; 2]) -> Result<impl Fn(&str) -> String, WriteError> {
    let [from, to] = [absolute(from)?, absolute(to)?];
    Ok(move |path: &str| {
        if from == to || Path::new(path).is_absolute() {
            return path.to_owned();
        }
        // The folder is free of links: ".." is the folder above. Behind the first name of the path it may not be.
        let mut whole = from.clone();
        let mut rest = Path::new(path).components();
        while matches!(rest.clone().next(), Some(Component::ParentDir | Component::CurDir)) {
            if rest.next() == Some(Component::ParentDir) {
                whole.pop();
            }
        }
        whole.extend(rest);
        between(&to, &whole)
    })
}

/// The path of a file in an existing folder, seen from another folder; with slashes.
///
/// # Errors
/// [`WriteError`] when one of the folders does not exist.
pub fn way_to_file(from: &Path, file: &Path) -> Result<String, WriteError> {
    let folder = absolute(file.parent().unwrap_or(Path::new("")))?;
    Ok(between(&absolute(from)?, &folder.join(file.file_name().unwrap_or_default())))
}

/// The way from a folder to a file, with slashes; both are absolute.
fn between(from: &Path, to: &Path) -> String {
    let (from, to): (Vec<Component>, Vec<Component>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        // Another drive.
        return to.iter().collect::<PathBuf>().display().to_string();
    }
    let up = std::iter::repeat_n("..".to_owned(), from.len() - common);
    let down = to[common..].iter().map(|part| part.as_os_str().to_string_lossy().into_owned());
    up.chain(down).collect::<Vec<_>>().join("/")
}

/// A folder without links and without "..".
fn absolute(folder: &Path) -> Result<PathBuf, WriteError> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.canonicalize().map_err(|error| WriteError::new(folder, format!("cannot find the folder: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_follow_the_scene_file() {
        let folder = tempfile::tempdir().unwrap();
        let [scenes, results] = ["data/scenes", "results"].map(|name| folder.path().join(name));
        std::fs::create_dir_all(&scenes).unwrap();
        std::fs::create_dir_all(&results).unwrap();
        let there = relocation([&scenes, &results]).unwrap();
        assert_eq!(there("rgb/a.png"), "../data/scenes/rgb/a.png");
        assert_eq!(there("./../lmo/a.png"), "../data/lmo/a.png");
        assert_eq!(there("../lmo/../b/a.png"), "../data/lmo/../b/a.png", "lmo may be a link");
        assert_eq!(relocation([&results, &results]).unwrap()("./a/../b.png"), "./a/../b.png");
        assert_eq!(way_to_file(&results, &scenes.join("a.png")).unwrap(), "../data/scenes/a.png");
        assert_eq!(way_to_file(&results, &results.join("a.png")).unwrap(), "a.png");
    }

    #[cfg(unix)]
    #[test]
    fn absolute_paths_stay() {
        let folder = tempfile::tempdir().unwrap();
        let there = relocation([folder.path(), Path::new("/")]).unwrap();
        assert_eq!(there("/images/a.png"), "/images/a.png");
    }
}

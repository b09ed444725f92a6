//! Paths of images and masks, which a scene file has relative to itself.

use std::io;
use std::path::{Component, Path, PathBuf};

use quadlift_io::SceneFile;

/// The relative path from the folder of an output file to another folder. Absolute if they have no common root.
pub(crate) fn relative_to_file(folder: &Path, file: &Path) -> io::Result<PathBuf> {
    let from = match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    Ok(way(&from.canonicalize()?, &folder.canonicalize()?))
}

/// The way from one absolute folder to another.
fn way(from: &Path, to: &Path) -> PathBuf {
    let (from, to): (Vec<Component>, Vec<Component>) = (from.components().collect(), to.components().collect());
    let common = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return to.iter().collect();
    }
    let up = from[common..].iter().map(|_| Component::ParentDir);
    up.chain(to[common..].iter().copied()).collect()
}

/// Puts a folder before the paths of all images and masks, and another one before those of depth images.
pub(crate) fn prefix_images(scene: &mut SceneFile, prefix: &Path, of_depths: &Path) {
    let put_before = |prefix: &Path, path: &mut String| {
        // With slashes on every system, as JSON files have them.
        let joined = prefix.join(&*path);
        let parts: Vec<_> = joined.components().map(|part| part.as_os_str().to_string_lossy()).collect();
        *path = if joined.is_absolute() { joined.to_string_lossy().into_owned() } else { parts.join("/") };
    };
    for frame in &mut scene.frames {
        frame.image.iter_mut().for_each(|path| put_before(prefix, path));
        frame.depth.iter_mut().for_each(|depth| put_before(of_depths, &mut depth.path));
    }
    let masks = scene.detections.iter_mut().filter_map(|detection| detection.mask.as_mut()?.path.as_mut());
    masks.for_each(|path| put_before(prefix, path));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_between_folders() {
        let text = |from: &str, to: &str| way(Path::new(from), Path::new(to)).to_string_lossy().into_owned();
        assert_eq!(text("/a/b", "/a/b"), "");
        assert_eq!(text("/a/b", "/a/b/c"), "c");
        assert_eq!(text("/a/b", "/a/c/d"), "../c/d");
    }
}

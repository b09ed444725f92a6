//! Names of images: with the extension that a name lacks, or another one than it has.

use std::path::Path;

use crate::scene_file::SceneFile;
use crate::video::file_of_image;

/// Extensions of images, in the order in which they are looked for.
const EXTENSIONS: [&str; 6] = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG"];

/// A name without its extension. The digits after the point of "12.5" are not an extension.
pub(super) fn stem(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension))
            if !stem.is_empty() && extension.len() <= 5 && extension.contains(|c: char| c.is_ascii_alphabetic()) =>
        {
            stem
        }
        _ => name,
    }
}

/// The image that differs from a name in its extension only, if there is one.
pub(super) fn image_of_stem(name: &str, exists: &dyn Fn(&str) -> bool) -> Option<String> {
    EXTENSIONS.iter().map(|extension| format!("{}.{extension}", stem(name))).find(|name| exists(name))
}

/// Names the images of frames as they are in a folder: where the named one is not there, or a frame names none, the one that
/// differs from its name, or from the id of the frame, in the extension only.
pub fn find_images(scene: &mut SceneFile, folder: &Path) {
    let exists = |name: &str| folder.join(file_of_image(Path::new(name))).is_file();
    for frame in &mut scene.frames {
        let name = frame.image.as_ref().unwrap_or(&frame.id);
        if frame.image.is_none() || !exists(name) {
            frame.image = image_of_stem(name, &exists).or(frame.image.take());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene_file::FrameRecord;

    #[test]
    fn stems_find_images() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("left")).unwrap();
        for name in ["img_001.jpg", "left/a.JPG", "b.png", "b.jpg", "12.5.png", "c.txt", "d.mp4"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let cases = [
            ("img_001", None, Some("img_001.jpg")),
            ("left/a.png", None, Some("left/a.JPG")),
            ("0", Some("left/a.png"), Some("left/a.JPG")),
            ("1", Some("b.jpg"), Some("b.jpg")),
            ("b", None, Some("b.png")),
            // These digits are no extension.
            ("12.5", None, Some("12.5.png")),
            ("12.7", None, None),
            ("c", None, None),
            ("d", Some("d.mp4#frame=3"), Some("d.mp4#frame=3")),
            // A name stays where nothing is found.
            ("e", Some("e.png"), Some("e.png")),
        ];
        let frame = |(id, image, _): &(&str, Option<&str>, Option<&str>)| FrameRecord {
            id: (*id).to_owned(),
            image: image.map(str::to_owned),
            ..FrameRecord::default()
        };
        let mut scene = SceneFile { frames: cases.iter().map(frame).collect(), ..SceneFile::default() };
        find_images(&mut scene, folder.path());
        for (frame, (id, _, expected)) in scene.frames.iter().zip(cases) {
            assert_eq!(frame.image.as_deref(), expected, "{id}");
        }
    }
}

//! The names of images and videos in the tasks of Label Studio: links to files.

use crate::error::ReadError;
use crate::read::json::Node;

/// Endings of names of images.
const IMAGES: [&str; 8] = ["jpg", "jpeg", "png", "bmp", "webp", "tif", "tiff", "gif"];

/// Endings of names of videos.
const VIDEOS: [&str; 6] = ["mp4", "webm", "mov", "avi", "mkv", "m4v"];

/// Keys of names of images, which are preferred to others.
const IMAGE_KEYS: [&str; 4] = ["image", "img", "video", "image_url"];

/// The name of the image or video among the texts of a task.
pub(super) fn image_name(data: &Node) -> Result<String, ReadError> {
    let texts = data.object()?.iter().filter_map(|(key, value)| Some((key.as_str(), value.as_str()?)));
    let named: Vec<(&str, String)> = texts.map(|(key, text)| (key, name_of_link(text))).collect();
    let is_media = |name: &str| has_ending(name, &IMAGES) || is_video(name);
    let preferred = IMAGE_KEYS.iter().find_map(|wanted| named.iter().find(|(key, _)| key == wanted));
    let found = preferred.or_else(|| named.iter().find(|(_, name)| is_media(name)));
    match found {
        Some((_, name)) if !name.is_empty() => Ok(name.clone()),
        _ => Err(data.error("there is no name of an image or video; expected one in \"image\" or \"video\"")),
    }
}

/// Whether a name is that of a video.
pub(super) fn is_video(name: &str) -> bool {
    has_ending(name, &VIDEOS)
}

/// Whether a name has one of these extensions.
fn has_ending(name: &str, endings: &[&str]) -> bool {
    name.rsplit_once('.').is_some_and(|(_, found)| endings.iter().any(|ending| found.eq_ignore_ascii_case(ending)))
}

/// The path of a file in a link: `https://host/a/b.jpg?token=1`, `/data/local-files/?d=a/b.jpg`, `s3://bucket/a/b.jpg`.
fn name_of_link(link: &str) -> String {
    let path = match link.split_once("?d=") {
        Some((_, path)) => path,
        None => match link.split_once("://") {
            Some((_, rest)) => rest.split(['?', '#']).next().unwrap_or_default(),
            None => link,
        },
    };
    let is_link = link.contains("://") || link.contains("?d=");
    if is_link { percent_decoded(path) } else { path.to_owned() }
}

/// Text with `%20` and the like as the characters that they stand for.
fn percent_decoded(text: &str) -> String {
    let digit = |byte: Option<&u8>| byte.and_then(|byte| char::from(*byte).to_digit(16));
    let (bytes, mut decoded, mut at) = (text.as_bytes(), Vec::new(), 0);
    while let Some(&byte) = bytes.get(at) {
        match (byte, digit(bytes.get(at + 1)), digit(bytes.get(at + 2))) {
            (b'%', Some(high), Some(low)) => {
                decoded.push((16 * high + low) as u8);
                at += 3;
            }
            _ => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_become_names() {
        for (link, name) in [
            ("/data/upload/1/0a1b2c3d-a.jpg", "/data/upload/1/0a1b2c3d-a.jpg"),
            ("/data/local-files/?d=left/a%20b.jpg", "left/a b.jpg"),
            ("s3://bucket/left/a.jpg", "bucket/left/a.jpg"),
            ("https://host/a%2Fb.jpg?token=1#x", "host/a/b.jpg"),
            ("left/100%.jpg", "left/100%.jpg"),
        ] {
            assert_eq!(name_of_link(link), name);
        }
    }
}

//! The names that images had before annotation tools renamed them.
//!
//! Roboflow exports `left/frame 1.jpg` as `frame-1_jpg.rf.<hash>.jpg`; Label Studio keeps an upload `frame.jpg` as
//! `<8 hexadecimal digits>-frame.jpg`.

/// Extensions that Roboflow puts into names.
const EXTENSIONS: [&str; 8] = ["jpg", "jpeg", "png", "bmp", "webp", "tif", "tiff", "avif"];

/// Fewest characters of Roboflow's hash.
const HASH: usize = 8;

/// Hexadecimal digits before the name of an upload.
const UPLOAD: usize = 8;

/// The name, with its folders, before a tool renamed it; `None` if no tool did.
pub(super) fn original_name(path: &str) -> Option<String> {
    let (folder, name) =
        path.rsplit_once(['/', '\\']).map_or(("", path), |(_, name)| (&path[..path.len() - name.len()], name));
    let name = of_roboflow(name).or_else(|| of_upload(name).map(str::to_owned))?;
    Some(format!("{folder}{name}"))
}

/// `frame_jpg.rf.<hash>`, with or without an extension, is `frame.jpg`.
fn of_roboflow(name: &str) -> Option<String> {
    let (before, after) = name.split_once(".rf.")?;
    let hash = after.split('.').next().unwrap_or_default();
    if hash.len() < HASH || !hash.chars().all(|c| c.is_ascii_alphanumeric()) {
        return None;
    }
    let (stem, extension) = before.rsplit_once('_')?;
    let is_extension = EXTENSIONS.iter().any(|known| extension.eq_ignore_ascii_case(known));
    (is_extension && !stem.is_empty()).then(|| format!("{stem}.{extension}"))
}

/// `0a1b2c3d-frame.jpg` is `frame.jpg`.
fn of_upload(name: &str) -> Option<&str> {
    let (digits, rest) = name.split_once('-')?;
    let is_upload = digits.len() == UPLOAD && digits.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    (is_upload && !rest.is_empty()).then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_roboflow_and_label_studio() {
        for (renamed, original) in [
            ("frame_0001_jpg.rf.0123456789abcdef0123456789abcdef.jpg", Some("frame_0001.jpg")),
            ("train/images/a_PNG.rf.0123456789abcdef0123456789abcdef.txt", Some("train/images/a.PNG")),
            ("a_png.rf.Wq3xK9LmZ2", Some("a.png")),
            ("a_png.rf.short", None),
            ("a.rf.0123456789abcdef0123456789abcdef.jpg", None),
            ("_png.rf.0123456789abcdef.jpg", None),
            ("/data/upload/1/0a1b2c3d-frame-1.jpg", Some("/data/upload/1/frame-1.jpg")),
            ("20260101-frame.jpg", Some("frame.jpg")),
            ("0a1b2c3d-", None),
            ("frame.jpg", None),
        ] {
            assert_eq!(original_name(renamed).as_deref(), original, "{renamed}");
        }
    }
}

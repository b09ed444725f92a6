//! Values of options that several commands share.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use quadlift::UnknownName;
use quadlift::solve::{BodyKind, PoseNoise, Sigmas};
use quadlift_io::scene_file::Detail;
use quadlift_io::write::geodesy::Place;

/// Reads a kind of body.
pub fn body(text: &str) -> Result<BodyKind, UnknownName> {
    text.parse()
}

/// The kind of body to fit; `None` if it is selected automatically.
#[derive(Debug, Clone, Copy)]
pub struct BodyChoice(pub Option<BodyKind>);

/// Reads `auto` or what [`body`] reads.
pub fn body_choice(text: &str) -> Result<BodyChoice, String> {
    match text {
        "auto" => Ok(BodyChoice(None)),
        text => text
            .parse()
            .map(|body| BodyChoice(Some(body)))
            .map_err(|error: UnknownName| format!("expected one of auto, {}", error.expected.join(", "))),
    }
}

/// How much a result says of each object.
#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
pub enum DetailName {
    /// Everything.
    Full,
    /// No covariance, no figures of single views.
    Brief,
}

impl From<DetailName> for Detail {
    fn from(name: DetailName) -> Self {
        match name {
            DetailName::Full => Self::Full,
            DetailName::Brief => Self::Brief,
        }
    }
}

/// Reads two positive numbers: standard deviations of turns (radians) and shifts (world units).
pub fn pose_noise(text: &str) -> Result<PoseNoise, String> {
    let expected = || "expected two numbers above 0: RAD,LENGTH".to_owned();
    let (rotation, translation) = text.split_once(',').ok_or_else(expected)?;
    match (positive(rotation), positive(translation)) {
        (Ok(rotation_sd), Ok(translation_sd)) => Ok(PoseNoise { rotation_sd, translation_sd }),
        _ => Err(expected()),
    }
}

/// Where noise levels come from.
#[derive(Debug, Clone)]
pub enum SigmaSource {
    /// They are given.
    Given(Sigmas),
    /// A result file that reports them.
    Result(PathBuf),
}

/// Reads `NAME=X,...`, or takes a path.
pub fn sigmas(text: &str) -> Result<SigmaSource, String> {
    if !text.contains('=') {
        let path = PathBuf::from(text);
        return match path.exists() {
            true => Ok(SigmaSource::Result(path)),
            false => Err("neither a file nor NAME=X,...".to_owned()),
        };
    }
    let level = |part: &str| {
        let (name, value) = part.split_once('=').ok_or_else(|| format!("\"{part}\": expected NAME=X"))?;
        Ok::<_, String>((name.trim().to_owned(), finite(value).map_err(|error| format!("\"{part}\": {error}"))?))
    };
    let levels = text.split(',').map(level).collect::<Result<Vec<_>, _>>()?;
    let levels = levels.iter().map(|(name, value)| (name.as_str(), *value));
    Sigmas::new(levels).map(SigmaSource::Given).map_err(|error| error.to_string())
}

/// Reads a number that is neither NaN nor infinite.
pub fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(x) if x.is_finite() => Ok(x),
        _ => Err("expected a finite number".to_owned()),
    }
}

/// Reads a finite number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x > 0.0).ok_or_else(|| "expected a number above 0".to_owned())
}

/// Reads a finite number that is zero or above.
pub fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).ok().filter(|x| *x >= 0.0).ok_or_else(|| "expected a non-negative number".to_owned())
}

/// Reads three numbers separated by commas.
pub fn three_numbers(text: &str) -> Result<[f64; 3], String> {
    let numbers: Result<Vec<f64>, String> = text.split(',').map(finite).collect();
    match numbers?.as_slice() {
        &[x, y, z] => Ok([x, y, z]),
        _ => Err("expected three numbers X,Y,Z".to_owned()),
    }
}

/// Reads a place on Earth, such as 48.2,16.37,170: latitude, longitude and altitude.
pub fn place(text: &str) -> Result<Place, String> {
    let numbers = three_numbers(text).ok();
    let place = numbers.map(|[latitude, longitude, altitude]| Place { latitude, longitude, altitude });
    let is_valid = |place: &Place| place.latitude.abs() <= 90.0 && place.longitude.abs() <= 180.0;
    place
        .filter(is_valid)
        .ok_or_else(|| "expected LAT,LON,ALT in degrees and metres, such as 48.2,16.37,170".to_owned())
}

/// Reads width and height, such as 640x480.
pub fn image_size(text: &str) -> Result<[f64; 2], String> {
    let size = text.split_once('x').and_then(|(w, h)| Some([positive(w).ok()?, positive(h).ok()?]));
    size.ok_or_else(|| "expected WIDTHxHEIGHT, such as 640x480".to_owned())
}

/// Reads the first and the last frame, such as 90-106.
pub fn frame_range(text: &str) -> Result<RangeInclusive<usize>, String> {
    let range = text.split_once('-').and_then(|(a, b)| Some(a.trim().parse().ok()?..=b.trim().parse().ok()?));
    range.filter(|range| !range.is_empty()).ok_or_else(|| "expected FIRST-LAST, such as 90-106".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_are_read_as_they_are_written() {
        for text in ["ellipsoid", "cuboid", "cylinder", "superellipsoid:1.5"] {
            assert_eq!(body_choice(text).unwrap().0.unwrap().to_string(), text);
        }
        for text in ["", "ball", "superellipsoid", "superellipsoid:0.9", "superellipsoid:nan", "cuboid:1"] {
            assert!(body_choice(text).is_err(), "{text}");
        }
    }

    #[test]
    fn pose_noise_is_two_positive_numbers() {
        let noise = PoseNoise { rotation_sd: 0.003, translation_sd: 0.1 };
        assert_eq!(pose_noise("0.003, 0.1"), Ok(noise));
        for text in ["0.003", "0,1", "1,-1", "1,2,3", "a,b"] {
            assert!(pose_noise(text).is_err(), "{text}");
        }
    }

    #[test]
    fn numbers_are_finite() {
        assert_eq!(three_numbers("1, -2,3e1"), Ok([1.0, -2.0, 30.0]));
        assert_eq!((image_size("640x480"), frame_range("90-106")), (Ok([640.0, 480.0]), Ok(90..=106)));
        assert!(not_negative("0") == Ok(0.0) && not_negative("-1").is_err() && not_negative("nan").is_err());
        assert!(image_size("640").is_err() && image_size("0x1").is_err() && frame_range("7-6").is_err());
        assert!(three_numbers("1,2").is_err() && three_numbers("1,2,inf").is_err() && finite("nan").is_err());
    }
}

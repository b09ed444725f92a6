//! Lengths in meters, for formats that have no other unit.

use super::CheckedScene;

/// Units with their names in scene files.
const METERS: [(&[&str], f64); 7] = [
    (&["m", "metre", "metres", "meter", "meters"], 1.0),
    (&["dm"], 0.1),
    (&["cm", "centimetres", "centimeters"], 0.01),
    (&["mm", "millimetres", "millimeters"], 0.001),
    (&["km", "kilometres", "kilometers"], 1000.0),
    (&["in", "inch", "inches"], 0.0254),
    (&["ft", "foot", "feet"], 0.3048),
];

/// Metres in a unit, if it is known.
pub(crate) fn meters_of(unit: &str) -> Option<f64> {
    METERS.iter().find(|(names, _)| names.contains(&unit)).map(|(_, meters)| *meters)
}

impl CheckedScene<'_> {
    /// Metres in the world unit, if it is known.
    pub(super) fn known_meters(&self) -> Option<f64> {
        meters_of(self.length_unit.as_deref()?)
    }

    /// Metres in the world unit, and what was converted or assumed.
    pub(super) fn meters(&self) -> (f64, Option<String>) {
        let Some(unit) = &self.length_unit else {
            return (1.0, Some("the scene has no length_unit: meters were assumed".to_owned()));
        };
        match meters_of(unit) {
            Some(1.0) => (1.0, None),
            Some(meters) => (meters, Some(format!("lengths were converted from {unit} to meters"))),
            None => (1.0, Some(format!("unknown length_unit \"{unit}\": meters were assumed"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene_file::SceneFile;
    use crate::write::{BodyChoice, CheckedScene};

    #[test]
    fn units_are_converted_or_told() {
        let meters = |unit: Option<&str>| {
            let file = SceneFile { length_unit: unit.map(str::to_owned), ..SceneFile::default() };
            CheckedScene::new(&file, BodyChoice::Body).unwrap().meters()
        };
        assert_eq!(meters(Some("m")), (1.0, None));
        assert_eq!(meters(Some("mm")), (0.001, Some("lengths were converted from mm to meters".to_owned())));
        assert!(meters(None).1.unwrap().contains("has no length_unit"));
        let (factor, note) = meters(Some("parsec"));
        assert!(factor == 1.0 && note.unwrap().contains("\"parsec\": meters were assumed"));
    }
}

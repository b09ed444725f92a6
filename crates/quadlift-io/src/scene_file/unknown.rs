//! A limit on the content of unknown fields: they are kept, and a number in them takes much more memory than its text.

use std::fmt;

use quadlift::geometry::BodyKind;
use serde::de::{DeserializeSeed, Error, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::cue_records::CUE_FIELDS;

/// Maximum number of values in unknown fields and in `localization`: about a gigabyte while reading.
pub(super) const MAX_VALUES: usize = 10_000_000;

/// Fields that hold records or lists of them, whose fields may be unknown in their turn; also the names of the kinds of bodies.
const RECORDS: [&str; 16] = [
    "alternatives",
    "cameras",
    "covariance",
    "cross_validation",
    "detections",
    "ellipse",
    "frames",
    "goodness_of_fit",
    "mask",
    "objects",
    "oriented_box",
    "point_cloud",
    "rle",
    "sd",
    "segmentation",
    "view_residuals_px",
];

/// Fields that hold no more than their types can.
#[rustfmt::skip]
const PLAIN: [&str; 72] = [
    "angle", "box", "cam_from_world", "camera", "category", "center", "center_sd", "confidence", "coordinates",
    "counts", "edge_error", "format", "frame", "half_extents", "half_extents_sd", "half_height", "height",
    "id", "image", "inlier", "iou", "kind", "length_unit", "log_odds", "matrix", "method", "model", "name",
    "normalized_residual", "notes", "object", "observed_pixels", "observed_points", "occluded", "outline", "params",
    "path", "points", "polygons", "predicted_iou", "projection", "radii", "reason", "rejection_reason",
    "relative_residual", "residual_px", "rotation", "rotation_sd_deg", "rounded", "roundness", "scale", "score", "semi_axes", "size", "source", "status",
    "support_exponent", "suspect_view", "time", "touches_other_masks", "transform", "truncated",
    "truncated_by_border", "up", "value", "version", "views", "views_rejected", "views_used", "visible_fraction",
    "warnings", "width",
];

/// Checks the number of values in unknown fields of a scene file's text.
///
/// # Errors
/// The problem, as text. A text that is not JSON is not an error here.
pub(super) fn check_unknown(text: &str, most: usize) -> Result<(), String> {
    // A value and its comma have two bytes at least.
    if text.len() / 2 <= most {
        return Ok(());
    }
    match left_of(text, most) {
        Some(_) => Ok(()),
        None => Err(format!("unknown fields hold more than {most} values in total; remove them")),
    }
}

/// How many values more than a text has the unknown fields may hold; `None` where they hold too many.
fn left_of(text: &str, most: usize) -> Option<usize> {
    let mut left = Some(most);
    let mut deserializer = serde_json::Deserializer::from_str(text);
    // The reader reports invalid texts.
    let _ = Count { left: &mut left, is_record: true }.deserialize(&mut deserializer);
    left
}

/// Counts values down; `None` where there were too many.
struct Count<'a> {
    left: &'a mut Option<usize>,
    /// Whether the value is a record or a list of such, which only counts for its unknown fields.
    is_record: bool,
}

impl Count<'_> {
    fn one<E: Error>(&mut self) -> Result<(), E> {
        if !self.is_record {
            *self.left = self.left.and_then(|left| left.checked_sub(1));
        }
        if self.left.is_some() { Ok(()) } else { Err(E::custom("too many values")) }
    }
}

impl<'de> DeserializeSeed<'de> for Count<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Count<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E: Error>(mut self, _: bool) -> Result<(), E> {
        self.one()
    }

    fn visit_i64<E: Error>(mut self, _: i64) -> Result<(), E> {
        self.one()
    }

    fn visit_u64<E: Error>(mut self, _: u64) -> Result<(), E> {
        self.one()
    }

    fn visit_f64<E: Error>(mut self, _: f64) -> Result<(), E> {
        self.one()
    }

    fn visit_str<E: Error>(mut self, _: &str) -> Result<(), E> {
        self.one()
    }

    fn visit_unit<E: Error>(mut self) -> Result<(), E> {
        self.one()
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut seq: A) -> Result<(), A::Error> {
        self.one()?;
        while seq.next_element_seed(Count { left: &mut *self.left, is_record: self.is_record })?.is_some() {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
        self.one()?;
        while let Some(field) = map.next_key::<Field>()? {
            match (self.is_record, field) {
                (true, Field::Plain) => drop(map.next_value::<IgnoredAny>()?),
                (true, Field::Records) => map.next_value_seed(Count { left: &mut *self.left, is_record: true })?,
                _ => map.next_value_seed(Count { left: &mut *self.left, is_record: false })?,
            }
        }
        Ok(())
    }
}

/// A name of a field.
enum Field {
    Records,
    Plain,
    /// Unknown, or of any content (`localization`).
    Other,
}

impl<'de> Deserialize<'de> for Field {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_str(FieldVisitor)
    }
}

struct FieldVisitor;

impl Visitor<'_> for FieldVisitor {
    type Value = Field;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a name")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Field, E> {
        Ok(match name {
            name if RECORDS.contains(&name) || is_body(name) || CUE_FIELDS.iter().any(|(cue, ..)| *cue == name) => {
                Field::Records
            }
            name if PLAIN.contains(&name) || CUE_FIELDS.iter().any(|(_, fields, _)| fields.contains(&name)) => {
                Field::Plain
            }
            _ => Field::Other,
        })
    }
}

/// Whether a field of an object holds a body or bounds.
fn is_body(name: &str) -> bool {
    ["body", "bounds", "enclosing"].contains(&name) || BodyKind::ALL.iter().any(|known| known.name() == name)
}

#[cfg(test)]
mod tests {
    use quadlift::synthetic::{Observations, SyntheticOptions, generate};
    use serde_json::json;

    use super::*;
    use crate::scene_file::{SceneFile, write_scene};

    #[test]
    fn values_of_unknown_fields_are_counted_wherever_they_are() {
        let text = json!({
            "format": "quadlift.scene",
            "mine": [1, 2.5, "three", null, true, [-4], {"five": 5}],
            "frames": [{"id": "a", "cam_from_world": [[1, 0, 0, 0]], "mine": 6}, {"id": "b"}],
            "detections": [{"box": [1, 2, 3, 4], "mask": {"rle": {"size": [1, 1], "counts": [1, 2], "x": 7}}}],
            "localization": {"noise": {"edge_noise_px": 1.0}},
        });
        // Lists and objects count too: 10 of the first, 1, 1, and 3 of the last.
        assert_eq!(left_of(&text.to_string(), 100), Some(85));
        assert_eq!(left_of(&text.to_string(), 15), Some(0));
        assert_eq!(left_of(&text.to_string(), 14), None);
        assert_eq!(left_of("{\"mine\": [1, 2,", 10), Some(7));
    }

    #[test]
    fn what_is_known_does_not_count() {
        let made = SyntheticOptions { objects: 3, views: 6, observations: Observations::Boxes, ..Default::default() };
        let scene = generate(&made).unwrap().scene;
        for kind in BodyKind::FITTED {
            let mut options = quadlift::LocalizeOptions::default();
            options.method.posterior_options_mut().unwrap().body = Some(kind);
            options.cross_validation.extent = quadlift::cross_validation::Extent::All;
            let found = quadlift::localize(&scene, &options).unwrap();
            let objects = super::super::estimates_to_objects(&scene, &found).collect();
            let result = SceneFile { objects, ..SceneFile::default() };
            let mut bytes = Vec::new();
            write_scene(&result, &mut bytes).unwrap();
            let text = String::from_utf8(bytes).unwrap();
            assert_eq!(left_of(&text, 0), Some(0), "{kind:?}");
        }
        // Cameras, frames and detections with every field.
        let detection = json!({
            "frame": "a", "object": "b", "category": "c", "source": "d", "score": 0.5, "box": [1, 2, 3, 4],
            "ellipse": {"center": [1, 2], "semi_axes": [1, 1], "angle": 0.1},
            "mask": {"path": "m.png", "value": 3, "rle": {"size": [2, 2], "counts": [4]}, "polygons": [[1, 2, 3, 4, 5, 6]]},
            "segmentation": {
                "method": "sca", "status": "ok", "reason": "e", "confidence": 1, "truncated_by_border": 0.1, "touches_other_masks": 0.1
            },
            "occluded": 1, "truncated": 1, "visible_fraction": 0.5,
            "depth": {"median": 1.5, "sd": 0.1, "source": "a"},
            "box3d": {
                "center": [0, 0, 1], "half_extents": [1, 1, 1], "rotation": [1, 0, 0, 0], "frame": "camera", "source": "b",
                "sd": {"distance": 0.1, "direction": 0.1, "size": 0.1, "rotation": 0.1},
            },
        });
        let frame = json!({
            "id": "a", "camera": "c", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]],
            "projection": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "width": 1, "height": 1, "image": "a.png", "time": 1.5,
            "depth": {"path": "depth/a.png", "scale": 0.001, "source": "lidar"},
            "point_cloud": {"path": "a.bin", "frame": "world", "source": "lidar", "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]},
            "observed_points": [0, 2, 5], "observed_pixels": [[1, 2], [3.5, 4], [5, 6]],
        });
        let document = json!({
            "format": "quadlift.scene", "version": 1, "name": "a", "length_unit": "m", "up": [0, 0, 1], "notes": "b",
            "cameras": [{"id": "c", "model": "PINHOLE", "width": 1, "height": 1, "params": [1, 1, 0, 0]}],
            "frames": [frame], "detections": [detection],
        });
        assert_eq!(left_of(&document.to_string(), 0), Some(0));
        let read: SceneFile = serde_json::from_value(document).unwrap();
        assert!(read.extra.is_empty() && read.frames[0].extra.is_empty() && read.detections[0].extra.is_empty());
    }

    #[test]
    fn too_many_are_refused_and_small_texts_are_not_counted() {
        let text = format!("{{\"mine\": [{}0]}}", "0,".repeat(1000));
        let error = check_unknown(&text, 100).unwrap_err();
        assert_eq!(error, "unknown fields hold more than 100 values in total; remove them");
        assert_eq!(check_unknown(&text, 1002), Ok(()));
    }
}

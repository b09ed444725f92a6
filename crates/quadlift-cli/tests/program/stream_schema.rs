//! `docs/formats/stream.schema.json` against lines that the program reads and writes.

use crate::common::Folder;
use crate::stream::{folder_with_stream, stream};
use serde_json::{Value, json};

/// What of a value a schema forbids; the keywords are those that our schema uses.
fn violation(root: &Value, schema: &Value, value: &Value, place: &str) -> Option<String> {
    for (keyword, rule) in schema.as_object().unwrap() {
        let list = || rule.as_array().unwrap().iter();
        let failing = || list().filter_map(|rule| violation(root, rule, value, place)).collect::<Vec<_>>();
        let array = value.as_array();
        let found = match keyword.as_str() {
            "$ref" => {
                let target = root.pointer(rule.as_str().unwrap().strip_prefix('#').unwrap()).unwrap();
                violation(root, target, value, place)
            }
            "anyOf" => (failing().len() == list().count()).then(|| format!("{place}: none of {:?}", failing())),
            "oneOf" => (failing().len() + 1 != list().count()).then(|| format!("{place}: not one of {:?}", failing())),
            "const" => (value != rule).then(|| format!("{place}: {value} is not {rule}")),
            "enum" => (!list().any(|one| one == value)).then(|| format!("{place}: {value} is none of {rule}")),
            "type" => {
                let is = |name: &Value| match name.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "number" => value.is_number(),
                    "integer" => value.is_u64() || value.is_i64(),
                    "null" => value.is_null(),
                    other => panic!("{other}"),
                };
                let fits = rule.as_array().map_or_else(|| is(rule), |names| names.iter().any(is));
                (!fits).then(|| format!("{place}: {value} is no {rule}"))
            }
            "required" => value.as_object().and_then(|object| {
                list()
                    .find(|name| !object.contains_key(name.as_str().unwrap()))
                    .map(|name| format!("{place}: no {name}"))
            }),
            "properties" => value.as_object().and_then(|object| {
                let known = object.iter().filter_map(|(key, value)| Some((key, value, rule.get(key)?)));
                known.filter_map(|(key, value, rule)| violation(root, rule, value, &format!("{place}.{key}"))).next()
            }),
            "additionalProperties" => value.as_object().and_then(|object| {
                assert_eq!(rule, false);
                let known = schema["properties"].as_object().unwrap();
                object.keys().find(|key| !known.contains_key(*key)).map(|key| format!("{place}: unknown {key}"))
            }),
            "items" => array.and_then(|items| {
                let items = items.iter().enumerate();
                items.filter_map(|(k, item)| violation(root, rule, item, &format!("{place}[{k}]"))).next()
            }),
            "minItems" => {
                array.filter(|a| (a.len() as u64) < rule.as_u64().unwrap()).map(|_| format!("{place}: short"))
            }
            "maxItems" => array.filter(|a| a.len() as u64 > rule.as_u64().unwrap()).map(|_| format!("{place}: long")),
            "minimum" => value.as_f64().filter(|x| *x < rule.as_f64().unwrap()).map(|x| format!("{place}: {x}")),
            "exclusiveMinimum" => {
                value.as_f64().filter(|x| *x <= rule.as_f64().unwrap()).map(|x| format!("{place}: {x}"))
            }
            "$schema" | "$defs" | "title" | "description" => None,
            other => panic!("the keyword {other}"),
        };
        if found.is_some() {
            return found;
        }
    }
    None
}

/// The first thing that the schema forbids in a line.
pub(crate) fn forbidden(kind: &str, line: &Value) -> Option<String> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/formats/stream.schema.json");
    let schema: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    violation(&schema, &schema["$defs"][kind], line, kind)
}

#[test]
fn the_schema_holds_for_lines_that_are_read_and_written() {
    let folder = folder_with_stream();
    let seeds = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/seeds/stream/orbit.jsonl");
    for text in [folder.read("scene.jsonl"), std::fs::read_to_string(seeds).unwrap()] {
        for line in text.lines() {
            assert_eq!(forbidden("input", &serde_json::from_str(line).unwrap()), None, "{line}");
        }
        let (events, code, told) = stream(&folder, "stream", &(text.clone() + "{}\n{\"frame\": \"x\"}\n[\n"));
        assert_eq!(code, 0, "{told}");
        assert_eq!(events.iter().filter(|line| !line["line"].is_null()).count(), 3, "{events:?}");
        for line in &events {
            assert_eq!(forbidden("output", line), None, "{line}");
        }
    }
}

#[test]
fn every_kind_of_event_is_in_the_schema() {
    let folder = Folder::new();
    // A street with misses and false boxes, where most things happen.
    folder.succeed(
        "synth -q -o scene.json --no-ids --trajectory street --views 60 --objects 40 --noise box:0.05 --misses 0.2 \
         --false-positives 0.2",
    );
    let mut kinds = std::collections::BTreeSet::new();
    for line in folder.succeed("stream scene.json -q").lines() {
        let line: Value = serde_json::from_str(line).unwrap();
        assert_eq!(forbidden("output", &line), None, "{line}");
        let events = line["events"].as_array().unwrap().clone();
        kinds.extend(events.iter().map(|event| event["type"].as_str().unwrap().to_owned()));
    }
    for kind in ["new", "confirmed", "reassigned", "removed"] {
        assert!(kinds.contains(kind), "no {kind} in {kinds:?}");
    }
}

#[test]
fn the_schema_refuses_what_the_program_refuses() {
    let folder = Folder::new();
    let good =
        json!({"frame": "a", "time": 0, "projection": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "detections": []});
    let changed = |key: &str, value: Value| {
        let mut line = good.clone();
        line[key] = value;
        line
    };
    assert_eq!(forbidden("input", &good), None);
    for line in [
        changed("frame", json!(7)),
        changed("time", json!("0")),
        changed("projection", json!([[1, 0, 0, 0]])),
        changed("detections", json!([{"box": [1, 2, 3]}])),
        changed("detections", json!([{"category": "cup"}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "depth": {"sd": 1}}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "depth": {"median": -1}}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "box3d": {"center": [1, 2]}}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "box3d": {"half_extents": [1, 2, 0]}}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "box3d": {"rotation": [1, 0, 0, 0], "frame": "lidar"}}])),
        changed("detections", json!([{"box": [1, 2, 3, 4], "box3d": {"center": [0, 0, 1], "sd": {"all": 1}}}])),
        changed("pose_noise", json!({"rotation_sd": 0, "translation_sd": 1})),
        changed("camera", json!({"model": "PINHOLE"})),
        json!({"frame": "a"}),
        json!({"poses": [{"frame": "a"}]}),
        json!({}),
    ] {
        assert!(forbidden("input", &line).is_some(), "{line}");
        let frame = format!("{good}\n");
        let (events, _, _) =
            stream(&folder, "stream", &format!("{}{line}\n", if line["poses"].is_null() { "" } else { &frame }));
        assert_eq!(events.last().unwrap()["events"][0]["type"], "error", "{line}");
    }
}

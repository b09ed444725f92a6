//! The events of a stream as text, for a terminal.

use quadlift::online::ObjectMap;
use quadlift_io::stream::{EventRecord, OutputLine};
use quadlift_report::label;

use crate::output::one_line;
use crate::words::count;

/// A line of the output as text, with the labels that the objects have in the map.
pub(super) fn in_words(line: &OutputLine, map: &ObjectMap) -> String {
    let name = |id: &str| {
        let object = map.objects().chain(map.tentative_objects()).find(|object| object.id.to_string() == id);
        let category = object.and_then(|object| object.categories.into_iter().next()?.0);
        label(id, category.as_deref())
    };
    text(line, &name)
}

/// The text of a line with these names of objects.
fn text(line: &OutputLine, name: &dyn Fn(&str) -> String) -> String {
    let mut parts: Vec<String> = Vec::new();
    parts.extend(line.line.map(|number| format!("line {number}")));
    parts.extend(line.frame.as_ref().map(|id| format!("frame {id}")));
    parts.extend(line.poses.map(|poses| count(poses, "new pose")));
    parts.extend(line.end.map(|frames| format!("end, {}", count(frames as usize, "frame"))));
    let mut rest: Vec<String> = Vec::new();
    if let Some(objects) = &line.objects {
        let found = objects.iter().flatten().count();
        rest.push(format!("{found} of {} in objects", count(objects.len(), "detection")));
    }
    rest.extend(line.events.iter().map(|event| event_in_words(event, name)));
    one_line(&format!("{}: {}", parts.join(", "), rest.join("; "))) + "\n"
}

fn event_in_words(event: &EventRecord, name: &dyn Fn(&str) -> String) -> String {
    match event {
        EventRecord::New { object, .. } => format!("new {}", name(object)),
        EventRecord::Confirmed { object } => format!("confirmed {}", name(object)),
        EventRecord::Reassigned { object, detections } => {
            let to = object.as_ref().map_or_else(|| "no object".to_owned(), |id| name(id));
            format!("{} reassigned to {to}", count(detections.len(), "detection"))
        }
        EventRecord::Merged { object, alias } => format!("{} is {}", name(alias), name(object)),
        EventRecord::Removed { object, reason } => format!("removed {} ({reason})", name(object)),
        EventRecord::Returned { object } => format!("{} is back", name(object)),
        EventRecord::Disagrees { expected } => {
            format!("the frame disagrees with the map: none of {} is detected", count(*expected, "expected object"))
        }
        EventRecord::Inconsistent { message, .. } => format!("the scene is inconsistent: {message}"),
        EventRecord::Other => "another event".to_owned(),
        EventRecord::Error { message, .. } => format!("error: {message}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_told_in_one_line_each() {
        let name = |id: &str| label(id, Some("cup"));
        let line = OutputLine {
            frame: Some("000017".to_owned()),
            objects: Some(vec![Some("object_0003".to_owned()), None]),
            events: vec![
                EventRecord::Confirmed { object: "object_0003".to_owned() },
                EventRecord::Removed { object: "object_0001".to_owned(), reason: "gone" },
            ],
            ..OutputLine::default()
        };
        let expected = "frame 000017: 1 of 2 detections in objects; confirmed cup 3; removed cup 1 (gone)\n";
        assert_eq!(text(&line, &name), expected);
        let events = vec![EventRecord::Error { message: "no\u{1b}[31m JSON".to_owned(), column: None }];
        let line = OutputLine { line: Some(4), events, ..OutputLine::default() };
        assert_eq!(text(&line, &name), "line 4: error: no\\u{1b}[31m JSON\n");
    }
}

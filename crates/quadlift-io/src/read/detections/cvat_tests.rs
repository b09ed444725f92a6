use super::*;
use crate::read::detections::tests::added;
use crate::scene_file::RleCounts;
use quadlift_segment::Rle;

fn read(text: &str) -> Result<DetectionFiles, ReadError> {
    parse_cvat(Path::new("annotations.xml"), text.as_bytes())
}

/// An image of a task with these shapes, in a file with what CVAT writes around it.
fn image(shapes: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<annotations>\n  <version>1.1</version>\n  <meta><task><id>7</id>\
         <size>1</size><mode>annotation</mode><labels><label><name>cup</name></label></labels></task></meta>\n\
         <image id=\"0\" name=\"images/a.png\" width=\"64\" height=\"48\">\n{shapes}\n</image></annotations>"
    )
}

/// A video with these tracks.
fn video(tracks: &str) -> String {
    format!(
        "<annotations><version>1.1</version><meta><task><mode>interpolation</mode><original_size><width>64</width>\
         <height>48</height></original_size></task></meta>{tracks}</annotations>"
    )
}

#[test]
fn shapes_of_images() {
    let files = read(&image(
        "<box label=\"cup\" source=\"manual\" occluded=\"1\" xtl=\"11.00\" ytl=\"5.50\" xbr=\"30.00\" ybr=\"25.00\" z_order=\"0\">\
         <attribute name=\"color\">red</attribute></box>\
         <box label=\"kite\" occluded=\"0\" xtl=\"10\" ytl=\"20\" xbr=\"30\" ybr=\"30\" rotation=\"90.0\"/>\
         <polygon label=\"cat\" occluded=\"0\" points=\"1.00,2.00;5.00,2.00;3.00,9.00\" group_id=\"1\"/>\
         <polygon label=\"cat\" occluded=\"0\" points=\"11.00,2.00;15.00,2.00;13.00,4.00\" group_id=\"1\"/>\
         <polygon label=\"dog\" occluded=\"0\" points=\"1,2;5,2;3,9\" group_id=\"1\"/>\
         <ellipse label=\"ball\" occluded=\"0\" cx=\"20\" cy=\"20\" rx=\"5\" ry=\"3\"/>\
         <mask label=\"cup\" occluded=\"0\" rle=\"1, 2, 1, 1, 3\" left=\"2\" top=\"1\" width=\"4\" height=\"2\"/>\
         <polyline label=\"road\" points=\"1,2;3,4\"/><tag label=\"night\"/><tag label=\"rain\"/>",
    ))
    .unwrap();
    assert_eq!(files.notes, ["1 shapes of the kind polyline were skipped", "2 shapes of the kind tag were skipped"]);
    let records = added(files, &["a.png"]);
    assert_eq!(records.len(), 6);
    let first = &records[0];
    assert_eq!(first.bounding_box, Some([11.0, 5.5, 30.0, 25.0]));
    assert_eq!((first.category.as_deref(), first.occluded, &first.object), (Some("cup"), Some(1.0), &None));
    // A box of 20 x 10 about (20, 25), turned by a right angle.
    let turned = records[1].bounding_box.unwrap();
    for (found, expected) in turned.iter().zip([15.0, 15.0, 25.0, 35.0]) {
        assert!((found - expected).abs() < 1e-9, "{turned:?}");
    }
    assert!(records[1].oriented_box.is_some() && records[1].ellipse.is_none());
    assert_eq!(records[2].bounding_box, Some([1.0, 2.0, 15.0, 9.0]));
    assert_eq!(records[2].mask.as_ref().unwrap().polygons.as_ref().unwrap().len(), 2);
    assert_eq!(records[3].category.as_deref(), Some("dog"));
    let ball = records[4].bounding_box.unwrap();
    for (found, expected) in ball.iter().zip([15.0, 17.0, 25.0, 23.0]) {
        assert!((found - expected).abs() < 1e-9, "{ball:?}");
    }
    assert_eq!(records[5].bounding_box, Some([2.0, 1.0, 5.0, 3.0]));
    let rle = records[5].mask.as_ref().unwrap().rle.as_ref().unwrap();
    let RleCounts::Compressed(text) = &rle.counts else { panic!("{rle:?}") };
    assert_eq!(Rle::from_compressed(48, 64, text).unwrap().to_mask().count(), 3);
}

#[test]
fn rotation_is_clockwise_in_the_image() {
    let files = read(&image(
        "<box label=\"a\" xtl=\"20\" ytl=\"20\" xbr=\"40\" ybr=\"24\" rotation=\"30\"/>\
         <box label=\"a\" xtl=\"20\" ytl=\"20\" xbr=\"40\" ybr=\"24\" rotation=\"330\"/>",
    ));
    let records = added(files.unwrap(), &["a.png"]);
    // The y axis points down: a clockwise turn has a positive angle from x to y.
    let angles: Vec<f64> = records.iter().map(|record| record.oriented_box.as_ref().unwrap().angle).collect();
    let degrees = |angle: f64| angle.to_degrees().rem_euclid(180.0);
    assert!((degrees(angles[0]) - 30.0).abs() < 1e-9 && (degrees(angles[1]) - 150.0).abs() < 1e-9, "{angles:?}");
}

#[test]
fn tracks_of_videos() {
    let shape = |frame: u32, outside: u32, x: u32| {
        format!(
            "<box frame=\"{frame}\" outside=\"{outside}\" occluded=\"0\" keyframe=\"1\" xtl=\"{x}\" ytl=\"5\" xbr=\"30\" ybr=\"25\" \
             z_order=\"0\"/>"
        )
    };
    let text = video(&format!(
        "<track id=\"0\" label=\"cup\" source=\"manual\">{}{}{}</track><track id=\"1\" label=\"cat\">{}{}</track>",
        shape(0, 0, 11),
        shape(1, 0, 12),
        shape(2, 1, 13),
        shape(1, 0, 1),
        shape(2, 1, 1)
    ));
    let files = read(&text).unwrap();
    assert_eq!(files.notes, ["frames of the video count from 0", "1 tracks have one shape: they have no object ids"]);
    assert_eq!(files.images.len(), 2);
    assert_eq!(files.images[1].key.size, Some([64.0, 48.0]));
    // Frame 0 is the first image, also where names count from 1.
    for names in [["frame_000001.png", "frame_000002.png"], ["a.png", "b.png"], ["0.png", "1.png"]] {
        let records = added(files.clone(), &names);
        let frames: Vec<&str> = records.iter().map(|record| &*record.frame).collect();
        assert_eq!(frames, [names[0], names[1], names[1]]);
        assert_eq!(records[0].object.as_deref(), Some("t0"));
        assert_eq!(records[1].object.as_deref(), Some("t0"));
        assert_eq!((records[2].object.as_deref(), records[2].category.as_deref()), (None, Some("cat")));
    }
}

#[test]
fn every_third_frame_of_a_video() {
    let about = "<start_frame>4</start_frame><stop_frame>11</stop_frame><frame_filter>step=3</frame_filter><mode>interpolation</mode>";
    let shape =
        |frame: u32| format!("<box frame=\"{frame}\" outside=\"0\" xtl=\"{frame}\" ytl=\"5\" xbr=\"30\" ybr=\"25\"/>");
    let track = format!("<track id=\"0\" label=\"cup\">{}{}{}</track>", shape(4), shape(7), shape(10));
    let tracks = video(&track).replace("<mode>interpolation</mode>", about);
    let image = |number: u32| {
        let shape = format!("<box label=\"cup\" xtl=\"{number}\" ytl=\"5\" xbr=\"30\" ybr=\"25\"/>");
        format!("<image id=\"{number}\" name=\"frame_{number:06}\" width=\"64\" height=\"48\">{shape}</image>")
    };
    let images = video(&[4, 7, 10].map(image).concat()).replace("<mode>interpolation</mode>", about);
    let all: Vec<String> = (0..12).map(|number| format!("v_{number:03}.png")).collect();
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    for text in [tracks, images] {
        let files = read(&text).unwrap();
        assert_eq!(files.numbering, Numbering::Sampled { first: 4, step: 3, last: 10 });
        assert!(files.notes.iter().any(|note| note.contains("every 3th frame")), "{:?}", files.notes);
        // The frames that were annotated, counted anew; the same by their numbers in the video; all frames of the video.
        for (names, expected) in [
            (&["a_001.png", "a_002.png", "a_003.png"][..], ["a_001.png", "a_002.png", "a_003.png"]),
            (&["b_04.png", "b_07.png", "b_10.png"], ["b_04.png", "b_07.png", "b_10.png"]),
            (&["x.png", "y.png", "z.png"], ["x.png", "y.png", "z.png"]),
            (&all, ["v_004.png", "v_007.png", "v_010.png"]),
        ] {
            let records = added(files.clone(), names);
            let frames: Vec<&str> = records.iter().map(|record| &*record.frame).collect();
            assert_eq!(frames, expected);
        }
    }
}

#[test]
fn what_is_wrong_with_files_of_cvat_is_named() {
    let message = |text: &str| read(text).unwrap_err().to_string();
    let shape = |text: &str| message(&image(text));
    let mask = |rle: &str, height: u32| {
        shape(&format!("<mask label=\"a\" rle=\"{rle}\" left=\"62\" top=\"1\" width=\"2\" height=\"{height}\"/>"))
    };
    insta::assert_snapshot!(message("<annotation/>"), @"annotations.xml:1:1: the file holds <annotation>; expected <annotations>");
    insta::assert_snapshot!(message("<annotations><image name=\"a\"/></annotations>"), @r#"annotations.xml:1:14: there is no attribute "width" in <image>"#);
    insta::assert_snapshot!(shape("<box label=\"a\" xtl=\"1\"/>"), @r#"annotations.xml:6:1: there is no attribute "ytl" in <box>"#);
    insta::assert_snapshot!(shape("<box label=\"a\" xtl=\"wide\"/>"), @r#"annotations.xml:6:1: the attribute xtl is "wide"; expected a number"#);
    insta::assert_snapshot!(shape("<box xtl=\"1\" ytl=\"1\" xbr=\"2\" ybr=\"2\"/>"), @r#"annotations.xml:6:1: there is no attribute "label" in <box>"#);
    insta::assert_snapshot!(shape("<box label=\"a\" xtl=\"5\" ytl=\"1\" xbr=\"2\" ybr=\"2\"/>"), @"annotations.xml:6:1: the box [5.0, 1.0, 2.0, 2.0] is reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1");
    insta::assert_snapshot!(shape("<polygon label=\"a\" points=\"1,2;3\"/>"), @r#"annotations.xml:6:1: point 2 is "3"; expected x,y"#);
    insta::assert_snapshot!(shape("<polygon label=\"a\" points=\"1,2;3,4\"/>"), @"annotations.xml:6:1: the polygon has 2 points; expected 3 or more");
    insta::assert_snapshot!(mask("1, 2, x", 2), @r#"annotations.xml:6:1: run 3 of the mask is "x"; expected a whole number"#);
    insta::assert_snapshot!(mask("1, 2", 2), @"annotations.xml:6:1: the runs cover 3 pixels; the mask has 2 x 2");
    insta::assert_snapshot!(mask("50, 50", 50), @"annotations.xml:6:1: the mask has 2 x 50 pixels from column 62 and row 1 on; the image has 64 x 48");
    insta::assert_snapshot!(message("<annotations><track id=\"0\" label=\"a\"><box xtl=\"1\" ytl=\"1\" xbr=\"2\" ybr=\"2\"/></track></annotations>"), @r#"annotations.xml:1:38: there is no attribute "frame" in <box>"#);
    insta::assert_snapshot!(message("<annotations><track id=\"0\" label=\"a\" task_id=\"3\"/>\n<track id=\"0\" label=\"a\" task_id=\"4\"/></annotations>"), @"annotations.xml:2:1: the tracks are of several tasks, whose frames have the same numbers; export one task");
    insta::assert_snapshot!(message("<annotations><image name=\"a\" width=\"4\" height=\"4\"/>\n<track id=\"0\"/></annotations>"), @"annotations.xml:2:1: the file holds both <image> and <track>; expected one of them");
}

#[test]
fn entity_bombs_and_deep_nesting_are_refused() {
    let message = |text: &str| read(text).unwrap_err().to_string();
    let entity = |index: u32| format!("<!ENTITY e{index} \"{}\">\n", format!("&e{};", index - 1).repeat(10));
    let bomb = format!(
        "<?xml version=\"1.0\"?>\n<!DOCTYPE annotations [\n<!ENTITY e0 \"lol\">\n{}]>\n<annotations>&e9;</annotations>",
        (1..10).map(entity).collect::<String>()
    );
    insta::assert_snapshot!(message(&bomb), @"annotations.xml: the file has a document type (<!DOCTYPE>), which may define entities; expected annotations of CVAT");
    // A reader that allows document types stops, too.
    let voc = Xml::parse(Path::new("a.xml"), bomb.as_bytes(), "an annotation", DocumentType::Allowed).err().unwrap();
    insta::assert_snapshot!(voc.to_string(), @"a.xml:4:30: this is not valid XML: a possible entity reference loop is detected at 4:30");
    let external = "<!DOCTYPE annotations SYSTEM \"file:///etc/passwd\"><annotations/>";
    insta::assert_snapshot!(message(external), @"annotations.xml: the file has a document type (<!DOCTYPE>), which may define entities; expected annotations of CVAT");
    insta::assert_snapshot!(message("<annotations>&e;</annotations>"), @"annotations.xml:1:14: this is not valid XML: unknown entity reference 'e' at 1:14");
    let deep = format!("<annotations>{}{}</annotations>", "<a>".repeat(100_000), "</a>".repeat(100_000));
    insta::assert_snapshot!(message(&deep), @"annotations.xml:1:311: elements are nested more than 100 levels deep");
    let attributes: String = (0..2000).map(|index| format!(" a{index}=\"1\"")).collect();
    insta::assert_snapshot!(message(&format!("<annotations{attributes}/>")), @"annotations.xml:1: an element has more than 1000 attributes; expected annotations of CVAT");
    // Runs of a few bytes that stand for more pixels than are decoded.
    let mask = "<mask label=\"a\" rle=\"0,268435456\" left=\"0\" top=\"0\" width=\"16384\" height=\"16384\"/>";
    let masks = format!(
        "<annotations><image name=\"a\" width=\"99999\" height=\"99999\">{}</image></annotations>",
        mask.repeat(9)
    );
    assert!(message(&masks).contains("too large"), "{}", message(&masks));
}

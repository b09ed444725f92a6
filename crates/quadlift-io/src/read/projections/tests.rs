use super::*;
use nalgebra::Point3;

fn parse(text: &str) -> Result<Import, ReadError> {
    parse_projections(Path::new("p.csv"), text.as_bytes(), None, PixelCenters::Half)
}

const ROW: &str = "500,0,320,0, 0,500,240,0, 0,0,1,5";
const MATRIX: [[f64; 4]; 3] = [[500.0, 0.0, 320.0, 0.0], [0.0, 500.0, 240.0, 0.0], [0.0, 0.0, 1.0, 5.0]];

#[test]
fn csv_has_twelve_to_sixteen_columns() {
    let scene = parse(&format!("# mine\n{ROW}\n{ROW}\n")).unwrap().scene;
    assert_eq!((scene.frames.len(), scene.frames[1].id.as_str()), (2, "1"));
    assert_eq!(scene.frames[0].projection, Some(MATRIX));
    let header = "id,p11,p12,p13,p14,p21,p22,p23,p24,p31,p32,p33,p34,width,height,image\n";
    let scene = parse(&format!("{header}a,{ROW},640,480,\"a, b.png\"\n\"b\",{ROW},640,480,\n")).unwrap().scene;
    assert_eq!((scene.frames[0].id.as_str(), scene.frames[0].width), ("a", Some(640.0)));
    assert_eq!((scene.frames[0].image.as_deref(), scene.frames[1].image.as_deref()), (Some("a, b.png"), None));
    // An id that is a number is no header.
    assert_eq!(parse(&format!("12,{ROW}\n")).unwrap().scene.frames[0].id, "12");
}

#[test]
fn json_has_three_forms() {
    let matrix = serde_json::to_string(&MATRIX).unwrap();
    for text in [
        format!(r#"[{{"id": "a", "projection": {matrix}, "width": 64, "height": 48, "image": "x.png"}}]"#),
        format!(r#"{{"frames": [{{"id": "a", "projection": {matrix}}}]}}"#),
        format!(r#"{{"a": {matrix}}}"#),
        r#"{"a": [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 5]}"#.to_owned(),
    ] {
        let scene = parse(&text).unwrap().scene;
        assert_eq!((scene.frames[0].id.as_str(), scene.frames[0].projection), ("a", Some(MATRIX)), "{text}");
    }
}

#[test]
fn half_a_pixel_moves_every_projected_point() {
    let project = |pixel_centers| {
        let import = parse_projections(Path::new("p"), ROW.as_bytes(), Some([64.0, 48.0]), pixel_centers).unwrap();
        assert_eq!(import.scene.frames[0].height, Some(48.0));
        let scene = import.scene.to_scene().unwrap();
        scene.frames[0].projection.project_point(&Point3::new(0.3, -0.2, 2.0)).unwrap()
    };
    let moved = project(PixelCenters::Integer) - project(PixelCenters::Half);
    assert!((moved - nalgebra::Vector2::repeat(0.5)).norm() < 1e-9, "{moved}");
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let message = |text: &str| parse(text).unwrap_err().to_string();
    insta::assert_snapshot!(message("1,2,3\n"), @"p.csv:1: found 3 columns; expected 12 (a 3x4 matrix by rows), 13 with an id before, 15 with width and height after, or 16 with the name of the image");
    insta::assert_snapshot!(message(&format!("a,{ROW}\nb,{}\n", ROW.replace("240", "x"))), @r#"p.csv:2: column 8 is "x"; expected a number"#);
    insta::assert_snapshot!(message(&format!("a,{ROW}\na,{ROW}\n")), @r#"p.csv: the scene made of this file is not valid: frames[1]: the frame id "a" is used twice"#);
    insta::assert_snapshot!(message("0,0,0,0,0,0,0,0,0,0,0,0\n"), @"p.csv: the scene made of this file is not valid: frames[0].projection: the left 3x3 block of the projection is singular (its determinant is 0.000e0)");
    insta::assert_snapshot!(message(r#"[{"id": "a"}]"#), @r#"p.csv: [0]: there is no "projection""#);
    insta::assert_snapshot!(message(r#"{"a": [[1, 2, 3], [1]]}"#), @"p.csv: a: found a list of 2, expected three or four rows of four numbers");
    insta::assert_snapshot!(message("[1,"), @"p.csv:1:3: this is not valid JSON: EOF while parsing a value");
}

#[test]
fn ids_that_stand_twice_are_refused() {
    let p = "[[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 5]]";
    let read = |text: String| {
        let result = parse_projections(Path::new("p.json"), text.as_bytes(), None, PixelCenters::Half);
        result.map(|import| import.scene.frames.len()).map_err(|error| error.to_string())
    };
    assert_eq!(read(format!("{{\"a\": {p}, \"b\": {p}}}")), Ok(2));
    assert_eq!(read(format!("{{\"a\": {p}, \"a\": {p}}}")), Err("p.json: a: two frames have this id".to_owned()));
    assert!(read(format!("[{{\"id\": \"a\", \"projection\": {p}}}, {{\"id\": \"a\", \"projection\": {p}}}]")).is_err());
}

/// Poses have a projection's shape: with them every box would be off, and nothing would say why.
#[test]
fn poses_are_no_projections() {
    let turned = "0,-1,0,2, 0,0,-1,3, 1,0,0,4";
    let longer = "0,-3,0,6, 0,0,-3,9, 3,0,0,12";
    for text in [format!("{turned}\n{longer}\n"), "{\"a\": [[0,-1,0,2],[0,0,-1,3],[1,0,0,4],[0,0,0,1]]}".to_owned()] {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains("the matrices are poses [R | t] without intrinsics"), "{error}");
    }
    assert!(parse(&format!("{turned}\n{ROW}\n")).is_ok());
}

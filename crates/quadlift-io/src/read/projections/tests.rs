use super::*;
use nalgebra::Point3;

fn parse(text: &str) -> Result<Import, ReadError> {
    parse_projections(Path::new("p.csv"), text.as_bytes(), None, PixelCenters::Half)
}

const ROW: &str = "500,0,320,0, 0,500,240,0, 0,0,1,5";
const MATRIX: [[f64; 4]; 3] = [[500.0, 0.0, 320.0, 0.0], [0.0, 500.0, 240.0, 0.0], [0.0, 0.0, 1.0, 5.0]];

const HEADER: &str = "id,p11,p12,p13,p14,p21,p22,p23,p24,p31,p32,p33,p34";

#[test]
fn names_decide_what_columns_are() {
    let scene = parse(&format!("{HEADER},width,height,image\na,{ROW},640,480,\"a, b.png\"\n\"b\",{ROW},640,480,\n"))
        .unwrap()
        .scene;
    assert_eq!((scene.frames[0].id.as_str(), scene.frames[0].width), ("a", Some(640.0)));
    assert_eq!((scene.frames[0].image.as_deref(), scene.frames[1].image.as_deref()), (Some("a, b.png"), None));
    assert_eq!(scene.frames[0].projection, Some(MATRIX));
    // A table of a given format needs none; an id that is a number is no header.
    let scene = parse(&format!("# mine\n{ROW}\n{ROW}\n")).unwrap().scene;
    assert_eq!((scene.frames.len(), scene.frames[1].id.as_str()), (2, "1"));
    assert_eq!(parse(&format!("12,{ROW},640,480\n")).unwrap().scene.frames[0].height, Some(480.0));
    // In any order, also in a comment; without an id frames are numbered.
    let names = HEADER.replace("id,", "image,") + ",note,height,Width";
    for start in ["", "# mine\n#"] {
        let scene = parse(&format!("{start}{names}\nb.png,{ROW},7,480,640\n")).unwrap().scene;
        let frame = &scene.frames[0];
        assert_eq!((frame.id.as_str(), frame.image.as_deref()), ("0", Some("b.png")));
        assert_eq!((frame.projection, frame.width, frame.height), (Some(MATRIX), Some(640.0), Some(480.0)));
    }
}

#[test]
fn json_has_two_forms() {
    let matrix = serde_json::to_string(&MATRIX).unwrap();
    for text in [
        format!(r#"[{{"id": "a", "projection": {matrix}, "width": 64, "height": 48, "image": "x.png"}}]"#),
        format!(r#"{{"frames": [{{"id": "a", "projection": {matrix}}}]}}"#),
        r#"[{"id": "a", "projection": [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 5]}]"#.to_owned(),
    ] {
        let scene = parse(&text).unwrap().scene;
        assert_eq!((scene.frames[0].id.as_str(), scene.frames[0].projection), ("a", Some(MATRIX)), "{text}");
    }
}

#[test]
fn half_a_pixel_moves_every_projected_point() {
    let text = format!("{HEADER}\na,{ROW}\n");
    let project = |pixel_centers| {
        let import = parse_projections(Path::new("p"), text.as_bytes(), Some([64.0, 48.0]), pixel_centers).unwrap();
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
    let table = |rows: &str| message(&format!("{HEADER}\n{rows}"));
    insta::assert_snapshot!(message("1,2,3\n"), @"p.csv:1: found 3 columns without names; expected names in the first line, such as id, p11, p12, p13, p14, p21, p22, p23, p24, p31, p32, p33, p34, width, height, image");
    insta::assert_snapshot!(table(&format!("a,{ROW}\nb,{}\n", ROW.replace("240", "x"))), @r#"p.csv:3: column 8 is "x"; expected a number"#);
    insta::assert_snapshot!(table(&format!("a,{ROW}\na,{ROW}\n")), @r#"p.csv: the scene made of this file is not valid: frames[1]: the frame id "a" is used twice"#);
    insta::assert_snapshot!(table("a,0,0,0,0,0,0,0,0,0,0,0,0\n"), @"p.csv: the scene made of this file is not valid: frames[0].projection: the left 3x3 block of the projection is singular (its determinant is 0.000e0)");
    let of_another = format!("#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\na.jpg,{ROW},0,0,0\n");
    insta::assert_snapshot!(message(&of_another), @r#"p.csv:1: there is no column "p11"; expected p11 to p34, the 3x4 matrix by rows, and id, width, height, image as far as known; the columns are name, x, y, alt, heading, pitch, roll, f, px, py, k1, k2, k3, k4, t1, t2"#);
    insta::assert_snapshot!(message(r#"[{"id": "a"}]"#), @r#"p.csv: [0]: there is no "projection""#);
    insta::assert_snapshot!(message(r#"{"a": [[1, 2, 3], [1]]}"#), @r#"p.csv: there is no "frames""#);
    insta::assert_snapshot!(message(r#"[{"projection": [[1, 2, 3], [1]]}]"#), @"p.csv: [0].projection: found a list of 2, expected three or four rows of four numbers");
    insta::assert_snapshot!(message("[1,"), @"p.csv:1:3: this is not valid JSON: EOF while parsing a value");
}

/// Poses have a projection's shape: with them every box would be off, and nothing would say why.
#[test]
fn poses_are_no_projections() {
    let turned = "0,-1,0,2, 0,0,-1,3, 1,0,0,4";
    let longer = "0,-3,0,6, 0,0,-3,9, 3,0,0,12";
    let json = "[{\"projection\": [[0,-1,0,2],[0,0,-1,3],[1,0,0,4],[0,0,0,1]]}]";
    for text in [format!("{HEADER}\na,{turned}\nb,{longer}\n"), json.to_owned()] {
        let error = parse(&text).unwrap_err().to_string();
        assert!(error.contains("the matrices are poses [R | t], the intrinsics are missing"), "{error}");
    }
    assert!(parse(&format!("{HEADER}\na,{turned}\nb,{ROW}\n")).is_ok());
}

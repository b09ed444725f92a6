//! Round trips, and tables that are wrong.

use std::fs;
use std::path::Path;

use parquet::data_type::{ByteArray, ByteArrayType};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::Field;
use parquet::schema::parser::parse_message_type;
use proptest::prelude::*;
use serde_json::json;

use super::columns::{Column, DETECTIONS, Kind, OBJECTS, SCENE, Table};
use super::values::Cell;
use super::write::write_table;
use super::*;
use crate::scene_file::{SceneFile, parse_scene_file, read_scene_file};

/// The scene after a way through tables.
fn round_trip(scene: &SceneFile) -> SceneFile {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tables");
    write_tables(&path, scene).unwrap();
    let import = read_tables(&path).unwrap();
    assert_eq!((import.notes, import.image_folder), (Vec::<String>::new(), None));
    import.scene
}

/// A scene with every entry that the format knows, and unknown ones at every level.
fn full() -> SceneFile {
    let text = include_str!("full_scene.json");
    let scene = parse_scene_file(Path::new("full_scene.json"), text.as_bytes()).unwrap();
    scene.to_scene().unwrap();
    scene.to_objects().unwrap();
    scene
}

#[test]
fn every_entry_comes_back() {
    let scene = full();
    assert_eq!(round_trip(&scene), scene);
    assert_eq!(round_trip(&SceneFile::default()), SceneFile::default());
}

#[test]
fn the_scenes_at_hand_come_back() {
    let Some(scenes) = crate::test_data::real_data("scenes") else { return };
    let entries = fs::read_dir(scenes).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path()).filter(|path| path.extension().is_some_and(|e| e == "json"));
    let mut count = 0;
    for path in paths {
        let scene = read_scene_file(&path).unwrap();
        assert!(round_trip(&scene) == scene, "{}", path.display());
        count += 1;
    }
    assert!(count > 20, "{count}");
}

/// The numbers in these columns of a row of a table, by the names of the columns.
fn numbers(path: &Path, row: usize, columns: &[&str]) -> Vec<Option<f64>> {
    let reader = SerializedFileReader::new(fs::File::open(path).unwrap()).unwrap();
    let row = reader.get_row_iter(None).unwrap().nth(row).unwrap().unwrap();
    let number = |name: &&str| match row.get_column_iter().find(|(column, _)| column == name) {
        Some((_, Field::Double(x))) => Some(*x),
        Some((_, Field::Null)) => None,
        other => panic!("{name}: {other:?}"),
    };
    columns.iter().map(number).collect()
}

#[test]
fn numbers_that_other_programs_look_for_stand_in_columns_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tables");
    write_tables(&path, &full()).unwrap();
    let of = |table: &str, row: usize, columns: &[&str]| numbers(&path.join(table), row, columns);
    assert_eq!(of("detections.parquet", 0, &["x0", "y0", "x1", "y1"]), [1.0, 2.0, 3.0, 4.0].map(Some));
    let ellipse = ["ellipse_x", "ellipse_y", "ellipse_a", "ellipse_b", "ellipse_angle"];
    assert_eq!(of("detections.parquet", 0, &ellipse), [2.0, 3.0, 1.0, 0.5, -0.25].map(Some));
    assert_eq!(of("detections.parquet", 1, &["x0", "y0", "x1", "y1"]), [0.1, 0.2, 0.3, 0.4].map(Some));
    assert_eq!(of("detections.parquet", 1, &ellipse), [None; 5]);
    assert_eq!(of("detections.parquet", 3, &["depth_median", "depth_sd"]), [Some(4.5), Some(0.25)]);
    let sd = ["box3d_sd_distance", "box3d_sd_direction", "box3d_sd_size", "box3d_sd_rotation"];
    assert_eq!(of("detections.parquet", 3, &sd), [0.1, 0.02, 0.15, 0.25].map(Some));
    assert_eq!(of("detections.parquet", 4, &["depth_median", "depth_sd"]), [Some(3.5), None]);
    assert_eq!(of("detections.parquet", 5, &sd), [None, None, Some(0.5), None]);
    let turned = ["x", "y", "width", "height", "angle"].map(|name| format!("oriented_box_{name}"));
    let turned: Vec<&str> = turned.iter().map(String::as_str).collect();
    assert_eq!(of("detections.parquet", 7, &turned), [50.0, 60.0, 20.0, 10.0, 0.25].map(Some));
    assert_eq!(of("objects.parquet", 0, &["center_x", "center_y", "center_z"]), [1.0, 2.0, 3.0].map(Some));
    assert_eq!(of("objects.parquet", 1, &["center_x", "center_y", "center_z"]), [None; 3]);
    assert_eq!(of("scene.parquet", 0, &["up_x", "up_y", "up_z"]), [0.0, 0.0, 1.5].map(Some));
    // A list is whole or not there.
    let half = Cell::Null;
    for column in [&DETECTIONS, &OBJECTS, &SCENE].into_iter().flat_map(|table| table.columns) {
        if let Kind::Split(names) = column.kind {
            let mut cells = vec![Cell::Number(1.0); names.len()];
            let mut record = serde_json::Map::new();
            column.put(&cells, &mut record).unwrap();
            assert_eq!(column.take(&mut record), Some(cells.clone()));
            cells[1] = half.clone();
            column.put(&cells, &mut record).unwrap_err();
        }
    }
}

/// Before they had columns, outlines and oriented boxes were among the unknown fields.
#[test]
fn outlines_of_older_tables_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tables");
    let scene = full();
    write_tables(&path, &scene).unwrap();
    let is_older = |column: &&Column| !matches!(column.path[0], "outline" | "oriented_box");
    let columns: Vec<Column> = DETECTIONS.columns.iter().filter(is_older).copied().collect();
    assert_eq!(columns.len() + 4, DETECTIONS.columns.len());
    let older = Table { columns: columns.leak(), ..DETECTIONS };
    write_table(&path, &older, scene.detections.iter()).unwrap();
    assert_eq!(read_tables(&path).unwrap().scene, scene);
}

/// More rows than are turned into columns at a time.
#[test]
fn large_tables_come_back_in_their_order() {
    let mut scene = full();
    let detection = scene.detections[0].clone();
    scene.detections = (0..120_000)
        .map(|k| crate::scene_file::DetectionRecord {
            frame: if k % 2 == 0 { "a".into() } else { "b".into() },
            object: Some(format!("object {k}").into()),
            score: (k % 3 > 0).then_some(f64::from(k) / 120_000.0),
            ..detection.clone()
        })
        .collect();
    assert!(round_trip(&scene) == scene);
}

/// Texts as they may come, also those that mean something to a program.
fn text() -> impl Strategy<Value = String> {
    prop_oneof![Just(String::new()), Just("null".to_owned()), Just("NaN".to_owned()), "[a-zé\"\\\\\n, ]{0,8}"]
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(-0.0),
        Just(f64::MIN_POSITIVE / 8.0),
        any::<f64>().prop_filter("finite", |x| x.is_finite())
    ]
}

/// Unknown fields of any shape.
fn extra() -> impl Strategy<Value = serde_json::Map<String, serde_json::Value>> {
    let leaf = prop_oneof![
        Just(json!(null)),
        Just(json!({})),
        Just(json!([])),
        text().prop_map(|t| json!(t)),
        number().prop_map(|x| json!(x)),
        any::<u64>().prop_map(|n| json!(n)),
        any::<bool>().prop_map(|b| json!(b)),
    ];
    let value = leaf.prop_recursive(2, 6, 3, |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..3).prop_map(|v| json!(v)),
            proptest::collection::btree_map("[a-c]", inner, 0..3).prop_map(|m| json!(m)),
        ]
    });
    proptest::collection::btree_map("my_[a-z]{0,3}", value, 0..3).prop_map(|map| map.into_iter().collect())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn scenes_come_back(
        name in proptest::option::of(text()),
        notes in proptest::option::of(text()),
        extras in proptest::collection::vec(extra(), 8),
        numbers in proptest::collection::vec(proptest::option::of(number()), 6),
        texts in proptest::collection::vec(proptest::option::of(text()), 6),
        lists in proptest::collection::vec(proptest::collection::vec(text(), 0..3), 2),
        drop_parts in proptest::collection::vec(any::<bool>(), 6),
    ) {
        let mut scene = full();
        (scene.name, scene.notes, scene.extra) = (name, notes, extras[0].clone());
        scene.cameras[0].extra = extras[1].clone();
        scene.frames[0].extra = extras[2].clone();
        (scene.frames[0].image, scene.frames[0].time) = (texts[0].clone(), numbers[0]);
        let detection = &mut scene.detections[0];
        detection.extra = extras[3].clone();
        (detection.score, detection.visible_fraction, detection.occluded) = (numbers[1], numbers[2], numbers[3]);
        detection.category = texts[1].clone().map(Into::into);
        detection.source = texts[2].clone().map(Into::into);
        if let Some(ellipse) = &mut detection.ellipse {
            ellipse.extra = extras[4].clone();
        }
        if drop_parts[0] {
            detection.ellipse = None;
        }
        if drop_parts[1] {
            detection.mask = None;
        }
        if drop_parts[2] {
            detection.segmentation = None;
        }
        let object = &mut scene.objects[0];
        object.extra = extras[5].clone();
        (object.center_sd, object.residual_px, object.category) = (numbers[4], numbers[5], texts[3].clone());
        (object.views_rejected, object.warnings) = (lists[0].clone(), lists[1].clone());
        object.view_residuals_px[0].extra = extras[6].clone();
        if let Some(covariance) = &mut object.covariance {
            covariance.extra = extras[7].clone();
        }
        if drop_parts[3] {
            object.covariance = None;
        }
        if drop_parts[4] {
            object.ellipsoid = None;
        }
        if drop_parts[5] {
            object.view_residuals_px.clear();
        }
        prop_assert_eq!(round_trip(&scene), scene);
    }
}

#[test]
fn what_cannot_be_written_is_refused_and_nothing_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tables");
    let problem = |scene: &SceneFile| write_tables(&path, scene).unwrap_err().problem;
    let mut scene = full();
    scene.detections[1].score = Some(f64::NAN);
    assert_eq!(problem(&scene), "row 1: \"score\" holds a number that is not finite");
    let mut scene = full();
    scene.up = Some([0.0, f64::INFINITY, 0.0]);
    assert_eq!(problem(&scene), "row 0: \"up\" holds a number that is not finite");
    let mut scene = full();
    scene.points[1][2] = f64::NAN;
    assert_eq!(problem(&scene), "points[1] holds a number that is not finite");
    let mut scene = full();
    scene.objects.push(scene.objects[0].clone());
    assert!(problem(&scene).contains("is used twice"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn wrong_folders_and_tables_are_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let problem = |path: &Path| read_tables(path).unwrap_err();
    assert!(problem(folder.path()).problem.starts_with("there are no tables; expected a folder with scene.parquet"));
    let path = folder.path().join("tables");
    write_tables(&path, &full()).unwrap();
    // Tables under wrong names: the columns do not make records.
    fs::copy(path.join("frames.parquet"), path.join("cameras.parquet")).unwrap();
    let error = problem(&path);
    assert_eq!(
        error.to_string().replace(&path.display().to_string(), ""),
        "/cameras.parquet: row 0: missing field `model`"
    );
    fs::remove_file(path.join("cameras.parquet")).unwrap();
    // Without cameras the frames point nowhere.
    let error = problem(&path);
    assert!(error.problem.contains("frames[0].camera: unknown camera \"cam\""), "{error}");
    fs::write(path.join("cameras.parquet"), "PAR1 no table PAR1").unwrap();
    assert!(problem(&path).problem.starts_with("cannot read the table: "));
}

/// Every table, cut off and with changed bytes: errors or a scene, no crash.
#[test]
fn damaged_tables_do_not_crash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("tables");
    write_tables(&path, &full()).unwrap();
    for name in ["scene", "frames", "objects"].map(|name| format!("{name}.parquet")) {
        let bytes = fs::read(path.join(&name)).unwrap();
        for cut in (0..bytes.len()).step_by(bytes.len() / 20 + 1) {
            fs::write(path.join(&name), &bytes[..cut]).unwrap();
            read_tables(&path).unwrap_err();
        }
        for at in (0..bytes.len()).step_by(bytes.len() / 100 + 1) {
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            fs::write(path.join(&name), &changed).unwrap();
            let _ = read_tables(&path);
        }
        fs::write(path.join(&name), &bytes).unwrap();
    }
}

/// A file of 2.6 kB, found by fuzzing, that claims to have 67 million texts, for which the crate took 2 GB.
#[test]
fn dictionaries_that_cannot_be_are_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    write_tables(folder.path(), &full()).unwrap();
    let bytes = include_bytes!("../../tests/fixtures/parquet/dictionary_of_many.parquet");
    std::fs::write(folder.path().join("scene.parquet"), bytes).unwrap();
    let problem = read_tables(folder.path()).unwrap_err().problem;
    assert!(problem.starts_with("cannot read the table: it claims to have a dictionary of "), "{problem}");
}

/// Runs of equal values take no space, so that a table of a few bytes can have any number of rows.
#[test]
fn rows_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_tables(folder.path(), &full()).unwrap();
    let schema = parse_message_type("message m { OPTIONAL BYTE_ARRAY frame (STRING); }").unwrap();
    let file = fs::File::create(folder.path().join("detections.parquet")).unwrap();
    let mut writer = SerializedFileWriter::new(file, schema.into(), Default::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let mut column = group.next_column().unwrap().unwrap();
    let rows = 100_000;
    let (frames, levels) = (vec![ByteArray::from("a"); rows], vec![1; rows]);
    column.typed::<ByteArrayType>().write_batch(&frames, Some(&levels), None).unwrap();
    column.close().unwrap();
    group.close().unwrap();
    writer.close().unwrap();
    let problem = read_tables(folder.path()).unwrap_err().problem;
    assert!(problem.starts_with("cannot read the table: it claims to have 100000 rows in "), "{problem}");
}

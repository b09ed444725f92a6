//! CSV tables: the objects, one row each, and the residuals of their views. World units; fields without a value are
//! empty. A text that a spreadsheet would take for a formula has an apostrophe before it.

use csv::Writer as CsvWriter;
use quadlift::geometry::quaternion_from_rotation;

use super::Document;
use super::format::{ExportFormat, Writer};
use crate::error::EntryError;
use crate::scene_file::{ObjectBodies, ObjectRecord, SceneFile};

/// The columns of [`objects_csv`].
pub(super) const OBJECT_COLUMNS: [&str; 39] = [
    "object",
    "category",
    "status",
    "length_unit",
    "center_x",
    "center_y",
    "center_z",
    "center_sd",
    "body",
    "half_extent_1",
    "half_extent_2",
    "half_extent_3",
    "rotation_w",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "body_parameter",
    "half_extent_1_sd",
    "half_extent_2_sd",
    "half_extent_3_sd",
    "yaw_sd_deg",
    "tilt_sd_deg",
    "bounds_center_x",
    "bounds_center_y",
    "bounds_center_z",
    "bounds_half_extent_1",
    "bounds_half_extent_2",
    "bounds_half_extent_3",
    "bounds_rotation_w",
    "bounds_rotation_x",
    "bounds_rotation_y",
    "bounds_rotation_z",
    "bounds_half_extent_1_sd",
    "bounds_half_extent_2_sd",
    "bounds_half_extent_3_sd",
    "views_used",
    "views_rejected",
    "residual_px",
    "warnings",
];

/// The columns of [`views_csv`].
pub(super) const VIEW_COLUMNS: [&str; 4] = ["object", "frame", "residual_px", "inlier"];

/// The row of this format.
pub(super) const FORMAT: ExportFormat = ExportFormat {
    name: "csv",
    about: "CSV: one row per object",
    options: &["views"],
    write: Writer::Tables(|file| Ok([objects_csv(file)?, views_csv(file)])),
};

/// The objects, with or without a body. Half extents are the semi-axes of an ellipsoid, and half the extents of a cuboid,
/// along the columns of the rotation, which is a unit quaternion. Bounds stand beside the body.
///
/// # Errors
/// [`EntryError`] as [`SceneFile::to_objects`].
pub(super) fn objects_csv(file: &SceneFile) -> Result<Document, EntryError> {
    let bodies = file.to_objects()?;
    let unit = file.length_unit.as_deref().unwrap_or_default();
    let rows = file.objects.iter().zip(&bodies).map(|(record, bodies)| object_row(record, bodies, unit));
    let content = table(OBJECT_COLUMNS, rows);
    Ok(Document { content, counts: vec![("object", bodies.len())], notes: Vec::new() })
}

/// The residual of each view of each object, in pixels, and whether the view was used.
pub(super) fn views_csv(file: &SceneFile) -> Document {
    let views = || file.objects.iter().flat_map(|o| o.view_residuals_px.iter().map(move |view| (&o.id, view)));
    let rows = views().map(|(object, view)| {
        [no_formula(object), no_formula(&view.frame), text(&view.residual_px), view.inlier.to_string()]
    });
    Document { content: table(VIEW_COLUMNS, rows), counts: vec![("view", views().count())], notes: Vec::new() }
}

fn object_row(record: &ObjectRecord, bodies: &ObjectBodies, unit: &str) -> [String; 39] {
    let body = bodies.body();
    let [x, y, z] = three(bodies.center.map(|center| center.coords.into()));
    let [a, b, c] = three(body.map(|body| body.half_extents.into()));
    let [p, q, r] = three(record.half_extents_sd);
    let [yaw, tilt] = record.rotation_sd_deg.map_or_else(Default::default, |sd| sd.map(|sd| sd.to_string()));
    let [qw, qx, qy, qz] = body.map_or_else(Default::default, |body| {
        quaternion_from_rotation(&body.rotation).map(|number| number.to_string())
    });
    let bounds = record.bounds.as_deref();
    let [bx, by, bz] = three(bounds.map(|bounds| bounds.center));
    let [ba, bb, bc] = three(bounds.map(|bounds| bounds.half_extents));
    let [bp, bq, br] = three(bounds.and_then(|bounds| bounds.half_extents_sd));
    let [bqw, bqx, bqy, bqz] =
        bounds.map_or_else(Default::default, |bounds| bounds.rotation.map(|number| number.to_string()));
    let estimated = record.views_used.is_some();
    [
        no_formula(&record.id),
        no_formula(record.category.as_deref().unwrap_or_default()),
        no_formula(record.status.as_deref().unwrap_or_default()),
        no_formula(unit),
        x,
        y,
        z,
        text(&record.center_sd),
        body.map(|body| body.kind.name().to_owned()).unwrap_or_default(),
        a,
        b,
        c,
        qw,
        qx,
        qy,
        qz,
        text(&body.and_then(|body| body.kind.parameter())),
        p,
        q,
        r,
        yaw,
        tilt,
        bx,
        by,
        bz,
        ba,
        bb,
        bc,
        bqw,
        bqx,
        bqy,
        bqz,
        bp,
        bq,
        br,
        text(&record.views_used),
        text(&estimated.then_some(record.views_rejected.len())),
        text(&record.residual_px),
        no_formula(&record.warnings.join("; ")),
    ]
}

/// A text prefixed with an apostrophe if it starts like a formula (=, @, + or -, also after blanks), which spreadsheets
/// would run. Numbers are not changed.
fn no_formula(text: &str) -> String {
    let begins_like_formula =
        text.trim_start().starts_with(['=', '@', '+', '-', '\u{ff1d}', '\u{ff20}', '\u{ff0b}', '\u{ff0d}']);
    if begins_like_formula && text.trim().parse::<f64>().is_err() { format!("'{text}") } else { text.to_owned() }
}

fn three(numbers: Option<[f64; 3]>) -> [String; 3] {
    numbers.map_or_else(Default::default, |numbers| numbers.map(|x| x.to_string()))
}

fn text<T: ToString>(value: &Option<T>) -> String {
    value.as_ref().map(T::to_string).unwrap_or_default()
}

/// A table with a header; fields are put in quotes where they need them.
fn table<const N: usize>(header: [&str; N], rows: impl Iterator<Item = [String; N]>) -> Vec<u8> {
    let mut writer = CsvWriter::from_writer(Vec::new());
    // Writing rows of one length to memory cannot fail.
    let _ = writer.write_record(header);
    for row in rows {
        let _ = writer.write_record(row);
    }
    writer.into_inner().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::test_scene;
    use super::*;
    use crate::scene_file::BoundsRecord;

    #[test]
    fn formulas_are_quoted_and_numbers_are_not() {
        for (text, expected) in [
            ("=cmd|' /C calc'!A0", "'=cmd|' /C calc'!A0"),
            ("\t=1+1", "'\t=1+1"),
            ("@SUM(1)", "'@SUM(1)"),
            ("+a", "'+a"),
            ("-a", "'-a"),
            ("-7", "-7"),
            ("+1.5e3", "+1.5e3"),
            ("car-1", "car-1"),
            ("", ""),
        ] {
            assert_eq!(no_formula(text), expected);
        }
        let object = |id: &str| ObjectRecord { id: id.to_owned(), ..Default::default() };
        let file = SceneFile { objects: vec![object("=1+1"), object("a")], ..Default::default() };
        let table = String::from_utf8(objects_csv(&file).unwrap().content).unwrap();
        let first: Vec<&str> = table.lines().map(|line| line.split(',').next().unwrap()).collect();
        assert_eq!(first, ["object", "'=1+1", "a"]);
    }

    #[test]
    fn one_row_per_object() {
        let mut file = test_scene::three_bodies();
        file.objects[0].views_used = Some(1);
        file.objects[0].views_rejected = vec!["000091".into()];
        file.objects[0].warnings = vec!["a, b".into(), "c".into()];
        file.objects[0].bounds = Some(Box::new(BoundsRecord {
            center: [1.1, 0.5, 0.25],
            rotation: [0.8, 0.0, 0.0, 0.6],
            half_extents: [0.6, 0.3, 1.0],
            half_extents_sd: Some([0.06, 0.03, 0.1]),
            ..BoundsRecord::default()
        }));
        file.objects.push(ObjectRecord {
            id: "lost".into(),
            status: Some("not_an_ellipsoid".into()),
            center: Some([1.0, 2.0, 1e-7]),
            ..ObjectRecord::default()
        });
        let document = objects_csv(&file).unwrap();
        insta::assert_snapshot!(String::from_utf8(document.content).unwrap());
        assert_eq!(document.counts, [("object", 4)]);
    }

    #[test]
    fn one_row_per_view() {
        let document = views_csv(&test_scene::three_bodies());
        insta::assert_snapshot!(String::from_utf8(document.content).unwrap(), @"
        object,frame,residual_px,inlier
        1,000090,0.5,true
        1,000091,,false
        ");
    }
}

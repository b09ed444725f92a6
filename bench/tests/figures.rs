//! The short form of every experiment, and a fixed subset of its figures: loose enough for rounding, tight enough to fail when an
//! estimator breaks. The real data cannot be part of the project; tests that need it are skipped with a message where it is absent.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

#[path = "../../crates/quadlift-io/src/test_data.rs"]
mod test_data;

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use quadlift::scene::Frame;
use quadlift_bench::data::TrueScene;
use quadlift_bench::methods::REG_LAMBDA;
use quadlift_bench::verdicts::{Extent, Part};
use quadlift_bench::{Error, Experiment, Report, Run, run};

/// The folder of the real data, where it is at hand.
fn data() -> Option<PathBuf> {
    Some(test_data::real_data("scenes")?.parent()?.to_owned())
}

/// Runs the short form of an experiment, with the real data where it is at hand.
fn short(experiment: Experiment) -> Report {
    let data = data();
    run(experiment, &Run { data: data.as_deref(), seed: 0, short: true, progress: &|_, _, _| {} }).unwrap()
}

/// Runs the short form of an experiment that needs the real data, where it is at hand.
fn report(experiment: Experiment) -> Option<Report> {
    data().map(|_| short(experiment))
}

/// Fails when a figure does not lie within its bounds, and tells all of them.
fn assert_within(report: &Report, bounds: &[(&str, f64, f64)]) {
    let mut wrong = Vec::new();
    for (id, low, high) in bounds {
        let headline = report.headline(id).unwrap_or_else(|| panic!("no figure {id}"));
        println!("{id}: {:.3} in [{low}, {high}]", headline.ours.value);
        if !(*low..=*high).contains(&headline.ours.value) {
            wrong.push(format!("{id}: {} is not in [{low}, {high}]", headline.ours.value));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The table whose title begins so.
fn table(report: &Report, title: &str) -> serde_json::Value {
    let json = report.to_json();
    let tables = json["tables"].as_array().unwrap();
    tables.iter().find(|t| t["title"].as_str().unwrap().starts_with(title)).unwrap().clone()
}

/// The number in a row and column of a table; the row is named by its first cells.
fn cell(report: &Report, title: &str, row: &[&str], column: &str) -> f64 {
    let table = table(report, title);
    let column = table["columns"].as_array().unwrap().iter().position(|c| c == column).unwrap();
    let rows = table["rows"].as_array().unwrap();
    let row = rows.iter().find(|r| row.iter().enumerate().all(|(k, name)| r[k] == *name)).unwrap();
    row[column].as_f64().or(row[column]["value"].as_f64()).unwrap()
}

#[test]
fn synthetic_scenes() {
    let report = short(Experiment::Synthetic);
    assert_within(
        &report,
        &[
            ("synthetic_rotation", 0.98, 1.0),
            ("synthetic_size", 0.965, 1.0),
            ("synthetic_translation", 0.915, 1.0),
            ("synthetic_boxes", 0.64, 0.8),
            // The mean of 100 objects; that of 300 is .483, with a standard error of .012.
            ("synthetic_outliers", 0.44, 0.9),
        ],
    );
    let no_noise = |method| cell(&report, "Rotation error", &[method], "0");
    assert!(no_noise("pfd") > 0.999 && no_noise("lfd") > 0.999 && no_noise("planes") > 0.999);
    // The paper's REG: .52 without noise, .39, .33 and .16 at the ends of its curves.
    assert!((no_noise("reg") - 0.52).abs() < 0.07);
    assert!((cell(&report, "Rotation error", &["reg"], "45") - 0.39).abs() < 0.07);
    assert!((cell(&report, "Size error", &["reg"], "0.30") - 0.33).abs() < 0.07);
    assert_eq!(report.plots().count(), 5);
    // The weight of REG is what the rule gives.
    let scan = table(&report, "The weight of reg");
    let marked = scan["rows"].as_array().unwrap().iter().find(|row| row[1] == "used, nearest").unwrap();
    assert_eq!(marked[0], format!("{REG_LAMBDA:e}"));
}

#[test]
fn few_views() {
    let report = short(Experiment::FewViews);
    // Aims: .010 and .005; exact boxes in two views .78.
    let bounds = [("few_views_given", 0.0, 0.010), ("few_views_planes", 0.0, 0.005), ("few_views_two", 0.78, 0.9)];
    assert_within(&report, &bounds);
    let map = |views, noise| cell(&report, "Few views", &[views, noise], "posterior");
    assert!(map("3", "0.00") > 0.99 && map("5", "0.01") > 0.91 && map("3", "0.10") > 0.67);
}

#[test]
fn objects_on_a_table() {
    if let Some(report) = report(Experiment::Accv) {
        let bounds = [
            ("accv_yolo_enclosing", 0.865, 0.92),
            ("accv_yolo_theta_err", 0.15, 0.235),
            ("accv_model_enclosing", 0.915, 0.96),
        ];
        assert_within(&report, &bounds);
        let yolo = |method, measure| cell(&report, "ACCV, boxes of a real", &[method, "ellipsoid", measure], "average");
        assert!(yolo("lfd", "O3D") > 0.72 && yolo("planes", "O3D, enclosing") > 0.86);
        assert!((yolo("pfd", "O3D") - 0.505).abs() < 0.02);
    }
    if let Some(report) = report(Experiment::Tuw) {
        // Four of the objects are boxes and become cuboids, with residuals five times smaller than those of ellipsoids (which
        // come to 0.82): the truths are ellipsoids, so that the ellipsoid that stands for a cuboid decides. The bodies themselves overlap
        // by 0.70.
        assert_within(&report, &[("tuw_default", 0.77, 0.90)]);
        // The published port of LfD gives 0.718 on this sequence.
        let o3d = |method| cell(&report, "TUW", &[method, "ellipsoid", "O3D"], "average");
        assert!((o3d("lfd") - 0.718).abs() < 0.01 && o3d("pfd") < 0.5);
    }
}

#[test]
fn cars_from_a_car() {
    if let Some(report) = report(Experiment::Kitti) {
        let bounds = [
            ("kitti_ellipsoid_aligned", 0.875, 1.0),
            ("kitti_rrc_aligned", 0.616, 0.75),
            // 27 cars, one is 3.7 %: 22 or 23 of them, over six seeds with the world as it is and turned. Starts along the world's axes
            // gave 23 for each seed as it is, 22 or 23 turned (84.0 on average, 82.7 since objects have axes of their own).
            ("kitti_rrc_aligned_1m", 81.0, 100.0),
            ("kitti_rrc_aligned_2m", 96.0, 100.0),
            // .489 for each of four seeds, .504 before views were judged by how many agree: a car or two of 27, with a standard error of .05.
            // In turned worlds the paired difference is -.004 +- .004; over all real sets it is +.008 +- .003.
            ("kitti_rrc_oxts", 0.48, 0.65),
        ];
        assert_within(&report, &bounds);
        // Simulated boxes, as in the paper, whose PfD+REG has 0.36.
        let row = ["reg", "ellipsoid", "O3D"];
        let reg = cell(&report, "KITTI: averages", &row, "ellipsoid, aligned");
        assert!((reg - 0.36).abs() < 0.08, "{reg}");
    }
}

#[test]
fn two_views() {
    if let Some(report) = report(Experiment::Minimal) {
        let bounds = [
            ("minimal_accv", 0.62, 0.75),
            ("minimal_accv_upright", 0.64, 0.80),
            ("minimal_tuw", 0.58, 0.75),
            ("minimal_tuw_upright", 0.63, 0.85),
            ("minimal_kitti", 0.65, 0.85),
            ("minimal_kitti_upright", 0.87, 0.95),
        ];
        assert_within(&report, &bounds);
    }
}

#[test]
fn ellipses_from_images() {
    let report = short(Experiment::Segmentation);
    if data().is_some() {
        assert_within(
            &report,
            &[
                ("segmentation_ellipse_iou", 0.82, 0.86),
                ("segmentation_angle", 4.0, 7.6),
                ("segmentation_all_views_ellipse_iou", 0.80, 0.86),
                ("segmentation_both_enclosing", 0.65, 0.8),
                ("segmentation_both_theta_err", 0.2, 0.45),
            ],
        );
    }
    // Ellipses tell the closed forms how objects are turned. With `pfd` too few are ellipsoids to compare their axes.
    let figure = |method, setting, column| cell(&report, "Bodies from", &[method, setting], column);
    for (method, boxes, ellipses) in [
        ("pfd", "boxes (the paper's PfD)", "ellipses (the paper's PfD+ES)"),
        ("reg", "boxes (the paper's PfD+REG)", "ellipses (the paper's PfD+ES+REG)"),
        ("lfd", "boxes", "ellipses"),
    ] {
        let [o3d, theta_err] = ["O3D, rendered", "theta_err, rendered"]
            .map(|column| [boxes, ellipses].map(|setting| figure(method, setting, column)));
        println!("{method}: O3D {o3d:.3?}, theta_err {theta_err:.3?} with boxes and with ellipses");
        assert!(o3d[1] > o3d[0], "{method}: {o3d:?}");
        assert!(method == "pfd" || theta_err[1] < theta_err[0], "{method}: {theta_err:?}");
    }
    let ellipse_iou = |row: &[&str]| cell(&report, "Masks and ellipses, rendered", row, "ellipse IoU");
    assert!(ellipse_iou(&["graphcut", "falls back"]) > 0.86);
}

#[test]
fn objects_without_ids() {
    if let Some(report) = report(Experiment::Association) {
        let bounds = [
            ("association_base", 0.995, 1.0),
            ("association_base_o3d", -0.01, 0.01),
            ("association_cube20", 0.995, 1.0),
            ("association_random", 0.995, 1.0),
            ("association_hard", 0.985, 1.0),
            ("association_pose", 0.99, 1.0),
            ("association_ids", 0.995, 1.0),
            ("association_trust", 1.0, 1.0),
            ("association_tuw", 1.0, 1.0),
            ("association_lmo_model", 0.99, 1.0),
            ("association_lmo_mask", 0.985, 1.0),
            ("association_kitti", 0.98, 1.0),
            ("association_kitti_drift", 0.98, 1.0),
            ("association_video_0000", 0.98, 1.0),
            ("association_video_0001", 0.98, 1.0),
            ("association_video_0007", 0.91, 1.0),
            ("association_video_0009", 0.965, 1.0),
            // 25 of 40, since the slack is found and not given: one half is the aim, with fewer true objects uncertain.
            ("association_uncertain_false", 0.6, 1.0),
            ("association_uncertain_true", 0.0, 0.05),
        ];
        assert_within(&report, &bounds);
        // Every part is worth something: less of it, or more false objects, without.
        let part = |row: &str, column: &str| cell(&report, "Parts of association", &[row], column);
        let all = |column: &str| part("everything", column);
        assert!(part("nested bodies stay", "20 % duplicates") < all("20 % duplicates") - 0.01);
        assert!(part("one pass", "KITTI tracking") < all("KITTI tracking") - 0.001);
        for reason in ["length", "size", "weak evidence"] {
            let row = format!("{reason} is no reason for doubt");
            assert!(part(&row, "uncertain ones") < all("uncertain ones") - 2.0, "{row}");
        }
    }
}

#[test]
fn the_assumed_vertical_is_that_of_the_cameras() {
    let Some(data) = data() else { return };
    for file in ["accv_iron", "accv_duck", "accv_cat", "accv_glue", "tuw_demo"] {
        let scene = TrueScene::read(&data, file, file).unwrap().scene;
        // Cameras look down on the table and are held about level: the right direction of their images (x) lies near the
        // horizontal plane, the up direction (-y) points upwards.
        let axes = |frame: &Frame| {
            let m = frame.projection.m();
            let forward: Vector3<f64> = m.row(2).transpose().normalize();
            let x: Vector3<f64> = m.row(0).transpose();
            let right = (x - forward * x.dot(&forward)).normalize();
            (right, right.cross(&forward), forward)
        };
        let all: Vec<_> = scene.frames.iter().map(axes).collect();
        assert!(all.iter().all(|(_, _, forward)| forward.z < 0.0), "{file}: a camera looks upwards");
        let level = all.iter().map(|(right, ..)| right.z.abs()).sum::<f64>() / all.len() as f64;
        let upwards = all.iter().map(|(_, up, _)| up.z).sum::<f64>() / all.len() as f64;
        println!("{file}: |right.z| {level:.3}, up.z {upwards:.3}");
        assert!(upwards > 0.5 && level < 0.3, "{file}: {level} {upwards}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_with_any_number_of_threads() {
    let Some(data) = data() else { return };
    let bytes = |experiment, seed, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = Run { data: Some(&data), seed, short: true, progress: &|_, _, _| {} };
        let report = pool.install(|| run(experiment, &settings)).unwrap();
        report.to_json().to_string()
    };
    let minimal = bytes(Experiment::Minimal, 3, 1);
    assert_eq!(minimal, bytes(Experiment::Minimal, 3, 4));
    assert_ne!(minimal, bytes(Experiment::Minimal, 4, 4), "the seed has no effect");
    assert_eq!(bytes(Experiment::Tuw, 0, 1), bytes(Experiment::Tuw, 0, 3));
}

#[test]
fn absent_data_is_named() {
    let nowhere = Path::new("nowhere");
    let settings = Run { data: Some(nowhere), seed: 0, short: true, progress: &|_, _, _| {} };
    let error = run(Experiment::Accv, &settings).unwrap_err();
    assert!(matches!(&error, Error::NoData(folder) if folder == nowhere));
    assert!(error.to_string().contains("QUADLIFT_DATA"), "{error}");
}

#[test]
fn left_out_views_tell_a_little_about_the_truth() {
    let Some(report) = report(Experiment::CrossValidation) else { return };
    assert_within(&report, &[("cross_validation_within", 0.2, 0.6)]);
    // Cars that are seen from one side: predicted well, and still wrong.
    let title = "Correlation of the left-out IoU";
    let kitti = |column| cell(&report, title, &["KITTI, aligned poses", "all"], column);
    assert!(kitti("mean left-out IoU") > 0.9 && kitti("mean O3D") < 0.75);
    assert_eq!(cell(&report, title, &["together", "all"], "objects"), 104.0);
}

#[test]
fn regions_of_real_objects_hold_the_truth() {
    let Some(report) = report(Experiment::Trust) else { return };
    assert_within(
        &report,
        &[
            ("trust_real_center_95", 85.0, 100.0),
            ("trust_real_center_median", 1.6, 3.2),
            ("trust_real_body_median", 6.0, 10.0),
            ("trust_real_volume", 0.0, 3.0),
        ],
    );
    // A covariance of the noise alone is far too bold.
    let noise_only = cell(&report, "Real sets", &["all", "noise only"], "95 %");
    assert!(noise_only < 60.0, "{noise_only}");
}

#[test]
fn the_self_check_calls_right_scenes_right_and_names_mistakes() {
    let report = short(Experiment::Diagnosis);
    // Of 2,000 right scenes 5 to 6 are called wrong; of the mistakes 0.92 are, nearly all by their names.
    let bounds =
        [("diagnosis_false_alarms", 0.0, 0.005), ("diagnosis_called_wrong", 0.85, 1.0), ("diagnosis_named", 0.83, 1.0)];
    assert_within(&report, &bounds);
    let json = report.to_json();
    let right =
        json["tables"].as_array().unwrap().iter().find(|t| t["title"].as_str().unwrap().starts_with("Right")).unwrap();
    for row in right["rows"].as_array().unwrap().iter().filter(|row| !row[0].as_str().unwrap().starts_with("synthetic"))
    {
        assert_eq!(row[2], 0.0, "a real scene is called wrong: {row}");
    }
}

#[test]
fn bodies_of_several_kinds() {
    assert_within(&short(Experiment::Kinds), &[("kinds_table", 0.85, 1.0)]);
}

#[test]
fn accidents_change_few_answers() {
    let bounds = [("stability_world", 0.0, 6.0), ("stability_rounding", 0.0, 6.0), ("stability_order", 0.0, 0.0)];
    assert_within(&short(Experiment::Stability), &bounds);
}

#[test]
fn a_map_frame_by_frame_is_nearly_as_good_as_batch() {
    assert_within(&short(Experiment::Online), &[("online_worst_f1", -0.2, 0.05), ("online_worst_o3d", -0.25, 0.05)]);
}

#[test]
fn depths_and_3d_boxes_help() {
    let report = short(Experiment::Cues);
    let bounds = [
        ("cues_worse", 0.0, 0.01),
        ("points_worse", 0.0, 0.01),
        ("cues_sizes_gain", 0.0, 0.1),
        ("cues_outlines_worse", -0.2, 0.0),
    ];
    assert_within(&report, &bounds);
    if data().is_some() {
        let o3d = |id| report.headline(id).unwrap().ours.value;
        assert!(o3d("cues_kitti_both") > o3d("cues_kitti_boxes") + 0.02);
    }
}

#[test]
fn cameras_from_objects() {
    // One room, one drive and one or two halls in each row.
    let bounds = [
        ("cameras_right", 0.8, 1.0),
        ("cameras_wrong", 0.0, 0.15),
        ("align_right", 1.0, 1.0),
        ("align_wrong", 0.0, 0.0),
        ("cameras_refined", 0.0, 0.6),
        ("calibrate_right", 0.9, 1.0),
        ("calibrate_wrong", 0.0, 0.0),
    ];
    assert_within(&short(Experiment::Cameras), &bounds);
}

#[test]
fn commands_notice_mistakes_and_refuse_no_right_scene() {
    // Scenes of each mistake, a command, and the smallest share of mistakes that it notices; many are harmless in a scene.
    let parts = [
        (1, Part::Localize, 0.85),
        (1, Part::Stream, 0.7),
        (1, Part::RelocalizeOne, 0.85),
        (4, Part::Align, 0.85),
        (4, Part::CalibrateRig, 0.95),
    ];
    for (seeds, part, least) in parts {
        let experiment = Experiment::Verdicts(Extent { seeds, right: 10, only: Some(part) });
        let report = run(experiment, &Run { data: None, seed: 0, short: false, progress: &|_, _, _| {} }).unwrap();
        let of_kind = |kind: usize| report.headlines[kind].id;
        let bounds = [(of_kind(0), least, 1.0), (of_kind(1), 0.0, 0.1), (of_kind(2), 0.0, 0.0)];
        assert_within(&report, &bounds);
    }
}

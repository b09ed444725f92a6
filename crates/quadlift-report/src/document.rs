//! From scenes and results to the data of a report.

use std::collections::HashMap;

use quadlift::scene::{Detection, Scene};
use quadlift_io::scene_file::ViewRecord;
use quadlift_io::{EntryError, SceneFile};

use crate::content::{Content, MAX_BYTES, MAX_DETECTIONS, MAX_FRAMES, MAX_OBJECTS};
use crate::data::{Report, ReportDetections, ReportFrame};
use crate::masks::add_masks;
use crate::objects::Objects;
use crate::page::EMPTY_PAGE;
use crate::poses::{refined_overview, refined_poses, with_refined_poses};
use crate::run::{center_limit, run_banner, run_notes, run_overview, run_region, run_settings};
use crate::thumbnails::{evenly_spread, thumbnails};

/// Gathers the data of a report and reads its images. Images that cannot be read are named in the notes.
///
/// # Errors
/// [`EntryError`] names the first object of the estimate or of the truth that is wrong.
pub fn report(content: &Content) -> Result<Report, EntryError> {
    let scene = content.scene;
    let frames: Vec<usize> = evenly_spread(scene.frames.len(), MAX_FRAMES).collect();
    let mut report = report_of_frames(content, &frames)?;
    if frames.len() < scene.frames.len() {
        let note = format!("the report shows {} of {} frames, evenly spread", frames.len(), scene.frames.len());
        report.notes.push(note);
    }
    let Some(images) = content.images else { return Ok(report) };
    report.notes.extend(add_masks(scene, images, &frames, &mut report.frames));
    let thumbnails = thumbnails(scene, images, &frames, bytes_left(&report));
    for (k, (frame, url)) in report.frames.iter_mut().zip(thumbnails.urls).enumerate() {
        if let (None, Some(size)) = (scene.frames[frames[k]].image_size, thumbnails.sizes[k]) {
            frame.size = size.map(f64::from);
        }
        frame.image = url;
    }
    report.notes.extend(thumbnails.notes);
    Ok(report)
}

/// The data of a report with only these frames, without images.
///
/// # Errors
/// As [`report()`].
pub fn report_of_frames(content: &Content, frames: &[usize]) -> Result<Report, EntryError> {
    let poses = content.estimate.map(refined_poses).transpose()?.unwrap_or_default();
    let scene = &*with_refined_poses(content.scene, &poses);
    let run = content.estimate.and_then(SceneFile::run_record).unwrap_or_default();
    let source = content.source.or(run.source());
    let source = source.and_then(|name| scene.sources.iter().position(|known| known == name));
    let is_shown = |d: &&Detection| source.is_none() || d.source_index.map(|s| s as usize) == source;
    let objects = Objects::gather(content, center_limit(&run), is_shown)?;
    let mut notes = run_notes(&run);
    let total = objects.list.len();
    if total > MAX_OBJECTS {
        notes.push(format!("the report shows the first {MAX_OBJECTS} of {total} objects"));
    }
    let mut detections = detections_by_frame(scene, &objects, content.estimate, is_shown);
    let of_unknown_size = scene.frames.iter().zip(&detections).filter(|(frame, _)| frame.image_size.is_none());
    let unknown = extent(of_unknown_size.map(|(_, detections)| detections));
    notes.extend(thin_out(&mut detections, frames));
    let frame = |&index: &usize| {
        let frame = &scene.frames[index];
        let detections = std::mem::take(&mut detections[index]);
        ReportFrame {
            id: frame.id.clone(),
            projection: frame.projection.matrix().transpose().iter().copied().collect(),
            given: poses.get(frame.id.as_str()).and_then(|pose| pose.for_page(&frame.projection)),
            size: frame.image_size.map_or(unknown, Into::into),
            image: None,
            detections,
        }
    };
    let mut overview = run_overview(&run);
    overview.extend(content.estimate.and_then(|file| refined_overview(file, &poses)));
    Ok(Report {
        title: content.title.to_owned(),
        program: format!("quadlift {}", env!("CARGO_PKG_VERSION")),
        length_unit: scene.length_unit.clone(),
        up: scene.up.map(|up| up.into_inner().into()),
        settings: run_settings(&run),
        overview,
        notes,
        banner: run_banner(&run),
        region: objects.list.iter().any(|o| o.center_shell.is_some()).then(|| run_region(&run)),
        frames: frames.iter().map(frame).collect(),
        points: drawn_points(content.points),
        scores: content.scores.map(|scores| objects.scores(scores)),
        categories: objects.categories,
        objects: objects.list.into_iter().take(MAX_OBJECTS).collect(),
    })
}

/// Points in a report; of more an evenly spread choice is shown.
const MAX_POINTS: usize = 10_000;

/// The coordinates of the points, rounded to the decimal place that gives the extent of the points five digits: finer than a
/// pixel of the view. The extent is that of the middle nine tenths in each coordinate, so that stray points do not count.
fn drawn_points(points: &[[f64; 3]]) -> Vec<f64> {
    let shown: Vec<[f64; 3]> = evenly_spread(points.len(), MAX_POINTS).map(|index| points[index]).collect();
    let extent = (0..3).map(|axis| {
        let mut values: Vec<f64> = shown.iter().map(|point| point[axis]).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[(share * (values.len() - 1) as f64) as usize];
        if values.is_empty() { 0.0 } else { at(0.95) - at(0.05) }
    });
    let extent = extent.fold(0.0, f64::max);
    if !(extent > 0.0 && extent.is_finite()) {
        return shown.into_iter().flatten().collect();
    }
    let places = 4 - extent.log10().floor() as i32;
    let power = 10f64.powi(places.abs());
    let round = |x: f64| if places >= 0 { (x * power).round() / power } else { (x / power).round() * power };
    shown.into_iter().flatten().map(round).collect()
}

/// Bytes that are left for images.
fn bytes_left(report: &Report) -> usize {
    let data = serde_json::to_string(report).map_or(MAX_BYTES, |json| json.len());
    // A little room for notes and sizes.
    MAX_BYTES.saturating_sub(data + EMPTY_PAGE + 100_000)
}

/// The size of frames of unknown size: large enough for all of their detections.
fn extent<'a>(frames: impl Iterator<Item = &'a ReportDetections>) -> [f64; 2] {
    let mut size = [4.0f64, 3.0];
    let mut hold = |x: f64, y: f64| size = [size[0].max(x), size[1].max(y)];
    for detections in frames {
        for edges in detections.boxes.chunks_exact(4) {
            hold(edges[2].unwrap_or(0.0), edges[3].unwrap_or(0.0));
        }
        for &(_, x, y, a, b, _) in &detections.ellipses {
            hold(x + a.max(b), y + a.max(b));
        }
    }
    size.map(|side| 1.02 * side)
}

/// The detections of each frame, with what the estimates say about them.
fn detections_by_frame(
    scene: &Scene,
    objects: &Objects,
    estimate: Option<&SceneFile>,
    is_shown: impl Fn(&&Detection) -> bool,
) -> Vec<ReportDetections> {
    let frames: HashMap<&str, usize> = scene.frames.iter().enumerate().map(|(k, frame)| (&*frame.id, k)).collect();
    let mut views = HashMap::new();
    for object in estimate.iter().flat_map(|file| &file.objects) {
        let Some(&index) = objects.by_id.get(&object.id).filter(|&&index| index < MAX_OBJECTS) else { continue };
        for view in &object.view_residuals_px {
            if let Some(&frame) = frames.get(view.frame.as_str()) {
                views.insert((index, frame), view);
            }
        }
    }
    let mut detections = vec![ReportDetections::default(); scene.frames.len()];
    let tenths = |x: f64| (10.0 * x).round() / 10.0;
    for (detection_index, detection) in scene.detections.iter().enumerate().filter(|(_, d)| is_shown(d)) {
        let frame = detection.frame_index as usize;
        let id = detection.object_index.map(|index| &scene.object_ids[index as usize]);
        let object = id.and_then(|id| objects.by_id.get(id).copied()).filter(|&index| index < MAX_OBJECTS);
        let view = object.and_then(|index| views.remove(&(index, frame)));
        let list = &mut detections[frame];
        if let Some(e) = &detection.ellipse {
            let (center, axes) = (e.center().map(tenths), e.semi_axes().map(tenths));
            list.ellipses.push((
                list.object.len(),
                center.x,
                center.y,
                axes.x,
                axes.y,
                (1e4 * e.angle()).round() / 1e4,
            ));
        }
        let body = object.and_then(|index| objects.list[index].body.as_ref());
        list.push_cues(list.object.len(), scene, detection, body);
        list.push(
            Some(detection_index),
            object,
            view,
            detection.bounding_box.map(|b| b.edges().map(|x| Some(tenths(x)))),
        );
    }
    // Views whose detections are not here, or do not say which object they show: the outline is known all the same.
    let mut others: Vec<((usize, usize), &ViewRecord)> = views.into_iter().collect();
    others.sort_by_key(|(place, _)| *place);
    for ((object, frame), view) in others {
        detections[frame].push(None, Some(object), Some(view), None);
    }
    detections
}

impl ReportDetections {
    /// Adds a row.
    fn push(
        &mut self,
        detection_index: Option<usize>,
        object: Option<usize>,
        view: Option<&ViewRecord>,
        edges: Option<[Option<f64>; 4]>,
    ) {
        self.detection_index.push(detection_index);
        self.object.push(object.map_or(-1, |index| index as i64));
        // A view of an object that could not be solved has not been used, and not been rejected either.
        let state = |view: &ViewRecord| match view.inlier {
            true => 1,
            false if view.rejection_reason.is_some() || view.residual_px.is_some() => 2,
            false => 0,
        };
        self.state.push(view.map_or(0, state));
        if let Some(reason) = view.and_then(|view| view.rejection_reason.as_ref()) {
            self.rejections.push((self.object.len() - 1, reason.clone()));
        }
        self.residual.push(view.and_then(|view| view.residual_px).map(|x| (100.0 * x).round() / 100.0));
        self.boxes.extend(edges.unwrap_or([None; 4]));
    }
}

/// Drops the detections of frames evenly until few enough are left; returns a note about them.
fn thin_out(detections: &mut [ReportDetections], frames: &[usize]) -> Option<String> {
    let total: usize = frames.iter().map(|&frame| detections[frame].object.len()).sum();
    let step = total.div_ceil(MAX_DETECTIONS);
    if step <= 1 {
        return None;
    }
    for (k, &frame) in frames.iter().enumerate() {
        if k % step != 0 {
            detections[frame] = ReportDetections::default();
        }
    }
    let kept: usize = frames.iter().map(|&frame| detections[frame].object.len()).sum();
    Some(format!("the report has the detections of one in {step} frames only ({kept} of {total}), to keep it small"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ReportObject, Scores, TrueObjectScores};
    use nalgebra::Matrix3x4;
    use quadlift::geometry::{BoundingBox, Projection};
    use quadlift::scene::{NewDetection, SceneBuilder};
    use serde_json::json;

    /// Frames of unknown size with one box of each source.
    fn scene(frames: usize) -> Scene {
        let mut builder = SceneBuilder::new("test");
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        for frame in 0..frames {
            let frame = frame.to_string();
            builder.add_frame(&frame, projection, None).unwrap();
            for source in ["yolo", "label"] {
                let input = NewDetection {
                    frame: &frame,
                    object: Some("cup"),
                    category: Some("cup"),
                    source: Some(source),
                    bounding_box: BoundingBox::new([10.04, 20.0, 110.0, 60.0]).ok(),
                    ..Default::default()
                };
                builder.add_detection(&input).unwrap();
            }
        }
        builder.build()
    }

    fn estimate(fields: serde_json::Value) -> SceneFile {
        let file = json!({ "format": "quadlift.scene", "version": 1, "objects": [fields],
            "localization": { "settings": { "source": "yolo", "seed": 0, "priors": null }, "noise": { "edge": 0.0123 },
                              "skipped": { "without_object": 3, "beyond_lens": 0 } } });
        serde_json::from_value(file).unwrap()
    }

    fn content<'a>(scene: &'a Scene, estimate: &'a SceneFile) -> Content<'a> {
        Content {
            title: "t",
            scene,
            images: None,
            estimate: Some(estimate),
            truth: None,
            source: None,
            points: &[],
            scores: None,
        }
    }

    #[test]
    fn points_are_rounded_to_the_extent_and_thinned_out() {
        // A square of 2 units, with a stray point that does not make the rounding coarser.
        let mut points: Vec<[f64; 3]> = (0..100).map(|k| [2.0 * f64::from(k) / 99.0, 1.0 / 3.0, -1e-7]).collect();
        points.push([1e9, 0.0, 0.0]);
        let drawn = drawn_points(&points);
        assert_eq!(drawn[3..6], [0.0202, 0.3333, -0.0]);
        assert_eq!(drawn.len(), 303);
        let large: Vec<[f64; 3]> = points.iter().map(|point| point.map(|x| 1e7 * x)).collect();
        assert_eq!(drawn_points(&large)[3..5], [202_000.0, 3_333_000.0]);
        assert_eq!(drawn_points(&[[0.1234567; 3]]), [0.1234567; 3]);
        assert_eq!(drawn_points(&[]), Vec::<f64>::new());
        assert_eq!(drawn_points(&vec![[0.5; 3]; 2 * MAX_POINTS + 1]).len(), 3 * MAX_POINTS);
    }

    #[test]
    fn detections_of_the_source_are_joined_with_what_the_estimate_says_of_them() {
        let rejected = json!({ "frame": "0", "inlier": false, "residual_px": 7.0, "rejection_reason": "residual" });
        let views = json!([rejected, { "frame": "2", "inlier": true }]);
        let file = estimate(json!({ "id": "cup", "status": "degenerate", "view_residuals_px": views }));
        let report = report(&content(&scene(3), &file)).unwrap();
        let states: Vec<&[u8]> = report.frames.iter().map(|frame| &*frame.detections.state).collect();
        assert_eq!(states, [[2], [0], [1]]);
        assert_eq!(report.frames[0].detections.residual, [Some(7.0)]);
        let rejections: Vec<&[(usize, String)]> = report.frames.iter().map(|f| &*f.detections.rejections).collect();
        assert_eq!(rejections, [&[(0, "residual".to_owned())][..], &[], &[]]);
        assert_eq!(report.frames[0].detections.boxes, [Some(10.0), Some(20.0), Some(110.0), Some(60.0)]);
        // An unknown frame size is chosen to contain its boxes.
        assert!(report.frames[0].size[0] > 110.0 && report.frames[0].size[0] < 120.0);
        assert_eq!((report.objects.len(), report.objects[0].category), (1, 0));
        let setting = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        assert_eq!(
            report.settings,
            [setting("seed", "0"), setting("source", "yolo"), setting("noise, edge", "0.0123")]
        );
        assert_eq!(report.notes, ["3 detections were not used: they have no object id"]);
    }

    #[test]
    fn ellipses_name_their_detection_and_keep_their_angle() {
        use quadlift::geometry::Ellipse;
        let mut builder = SceneBuilder::new("test");
        builder.add_frame("0", Projection::from_matrix(Matrix3x4::identity()).unwrap(), None).unwrap();
        let add = |builder: &mut SceneBuilder, object: &str, ellipse: Option<Ellipse>| {
            let bounding_box = BoundingBox::new([10.0, 20.0, 110.0, 60.0]).ok().filter(|_| ellipse.is_none());
            let input = NewDetection { frame: "0", object: Some(object), bounding_box, ellipse, ..Default::default() };
            builder.add_detection(&input).unwrap();
        };
        let ellipse = |angle| Ellipse::new([50.123, 40.0].into(), [30.06, 20.0].into(), angle).ok();
        add(&mut builder, "a", ellipse(0.123_456));
        add(&mut builder, "b", None);
        add(&mut builder, "c", ellipse(-0.5));
        let file = estimate(json!({ "id": "a", "status": "degenerate" }));
        let report = report(&content(&builder.build(), &file)).unwrap();
        let detections = &report.frames[0].detections;
        assert_eq!(
            detections.ellipses,
            [(0, 50.1, 40.0, 30.1, 20.0, 0.1235), (2, 50.1, 40.0, 30.1, 20.0, -0.5)],
            "the rows of the ellipses among all detections"
        );
    }

    #[test]
    fn an_object_tells_how_many_views_it_used_and_how_far_off_they_are() {
        let file = estimate(json!({ "id": "cup", "status": "ok", "views_used": 5, "views_rejected": ["1", "2"],
            "residual_px": 1.25 }));
        let report = report(&content(&scene(1), &file)).unwrap();
        let object = &report.objects[0];
        assert_eq!((object.views_used, object.views_rejected, object.residual), (5, 2, Some(1.25)));
    }

    #[test]
    fn the_truth_is_shown_as_a_body_of_the_kind_that_was_estimated() {
        let ellipsoid = json!({ "center": [0, 0, 5], "semi_axes": [2, 1, 1], "rotation": [1, 0, 0, 0] });
        let cuboid = json!({ "center": [0, 0, 5], "half_extents": [2, 1, 1], "rotation": [1, 0, 0, 0] });
        let truth = json!({ "id": "cup", "ellipsoid": ellipsoid, "cuboid": cuboid });
        let truth: SceneFile =
            serde_json::from_value(json!({ "format": "quadlift.scene", "version": 1, "objects": [truth] })).unwrap();
        let shown = |estimated: serde_json::Value| {
            let file = estimate(estimated);
            let scene = scene(1);
            let report = report(&Content { truth: Some(&truth), ..content(&scene, &file) }).unwrap();
            report.objects[0].truth.as_ref().unwrap().kind
        };
        assert_eq!(shown(json!({ "id": "cup", "status": "ok", "ellipsoid": ellipsoid })), "ellipsoid");
        assert_eq!(shown(json!({ "id": "cup", "status": "ok", "cuboid": cuboid })), "cuboid");
        assert_eq!(shown(json!({ "id": "cup", "status": "degenerate" })), "cuboid");
    }

    #[test]
    fn an_object_has_its_other_bodies_and_its_misfit() {
        let cuboid = |turn: [f64; 4]| json!({ "kind": "cuboid", "center": [0, 0, 5], "half_extents": [2, 1, 1], "rotation": turn });
        let fields = json!({ "id": "cup", "status": "ok", "body": cuboid([1.0, 0.0, 0.0, 0.0]),
            "alternatives": [{ "body": cuboid([0.6, 0.0, 0.0, 0.8]), "log_odds": -0.7 }],
            "goodness_of_fit": { "normalized_residual": 1.5, "relative_residual": 0.03 } });
        let report = report(&content(&scene(1), &estimate(fields.clone()))).unwrap();
        let object = &report.objects[0];
        assert_eq!((object.relative_residual, object.normalized_residual), (Some(0.03), Some(1.5)));
        let other = &object.alternatives[0];
        assert_eq!((other.body.kind, other.body.rotation[3], other.log_odds), ("cuboid", 0.8, -0.7));
        // Invalid bodies are rejected like those of the estimate.
        let mut wrong = fields;
        wrong["alternatives"][0]["body"]["half_extents"][1] = json!(-1);
        let error = super::report(&content(&scene(1), &estimate(wrong))).unwrap_err();
        assert_eq!(error.entry, "objects[0].alternatives[0].body.half_extents");
    }

    #[test]
    fn the_region_of_a_center_says_what_it_promises() {
        let unit: Vec<Vec<f64>> = (0..9).map(|i| (0..9).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let ellipsoid = json!({ "center": [0, 0, 5], "semi_axes": [1, 1, 1], "rotation": [1, 0, 0, 0] });
        let mut file = estimate(json!({ "id": "cup", "status": "ok", "ellipsoid": ellipsoid,
            "covariance": { "coordinates": "center_vech_shape", "matrix": unit } }));
        let shown = |file: &SceneFile| {
            let report = report(&content(&scene(1), file)).unwrap();
            (report.objects[0].center_shell.as_ref().unwrap().half[0].powi(2), report.region.unwrap())
        };
        let (size, words) = shown(&file);
        assert!((size - 7.8147).abs() < 1e-4 && words.contains("not calibrated"), "{size} {words}");
        let mut calibrated = |limit: serde_json::Value| {
            file.localization.as_mut().unwrap()["coverage"] = json!({ "objects": 30, "results": ["old.json"],
                "truths": ["truth.json"], "squared_distance": { "center": { "0.95": limit } } });
            shown(&file)
        };
        let (size, words) = calibrated(json!(20.25));
        assert!((size - 20.25).abs() < 1e-9, "{size}");
        assert!(words.contains("calibrated on 30 objects of old.json"), "{words}");
        let (size, words) = calibrated(serde_json::Value::Null);
        assert!((size - 7.8147).abs() < 1e-4 && words.contains("too few for 95 %"), "{size} {words}");
        let none = report(&content(&scene(1), &estimate(json!({ "id": "cup", "status": "degenerate" })))).unwrap();
        assert_eq!(none.region, None);
    }

    #[test]
    fn views_of_other_detections_have_a_row_without_a_box() {
        let views = json!([{ "frame": "1", "inlier": true, "residual_px": 0.5 }]);
        let file = estimate(json!({ "id": "o1", "status": "ok", "view_residuals_px": views }));
        let report = report(&content(&scene(2), &file)).unwrap();
        let detections = &report.frames[1].detections;
        assert_eq!((&*detections.object, &*detections.state), (&[1, 0][..], &[0, 1][..]));
        assert_eq!(detections.boxes[4..], [None; 4]);
    }

    #[test]
    fn true_objects_are_paired_as_the_scores_have_them_else_by_id() {
        let ball = |id: &str, x: f64| {
            let ellipsoid = json!({ "center": [x, 0, 5], "semi_axes": [1, 1, 1], "rotation": [1, 0, 0, 0] });
            json!({ "id": id, "category": "cup", "ellipsoid": ellipsoid })
        };
        let file = |objects: Vec<serde_json::Value>| -> SceneFile {
            serde_json::from_value(json!({ "format": "quadlift.scene", "version": 1, "objects": objects })).unwrap()
        };
        let mut objects = vec![ball("0", 0.0), ball("1", 10.0)];
        for object in &mut objects {
            object["status"] = json!("ok");
        }
        let estimate = file(objects);
        // The first true object has the id of another estimate, the second of none, and no estimate shows the third.
        let truth = file(vec![ball("1", 0.1), ball("cup", 10.1), ball("0", 50.0)]);
        let row = |id: &str, estimate: Option<&str>| TrueObjectScores {
            id: id.to_owned(),
            estimate: estimate.map(str::to_owned),
            ..Default::default()
        };
        let scores =
            Scores { rows: vec![row("1", Some("0")), row("cup", Some("1")), row("0", None)], ..Default::default() };
        let scene = scene(1);
        let content = Content { truth: Some(&truth), scores: Some(&scores), ..content(&scene, &estimate) };
        let paired = report(&content).unwrap();
        let told = |report: &Report| -> Vec<(String, Option<String>, bool, Option<f64>)> {
            let of = |o: &ReportObject| {
                (o.id.clone(), o.true_id.clone(), o.status.is_some(), o.truth.as_ref().map(|body| body.center[0]))
            };
            report.objects.iter().map(of).collect()
        };
        let line = |id: &str, true_id: Option<&str>, estimated, x| {
            (id.to_owned(), true_id.map(str::to_owned), estimated, Some(x))
        };
        assert_eq!(
            told(&paired),
            [line("0", Some("1"), true, 0.1), line("1", Some("cup"), true, 10.1), line("0", None, false, 50.0)]
        );
        let rows: Vec<usize> = paired.scores.unwrap().rows.iter().map(|row| row.object).collect();
        assert_eq!(rows, [0, 1, 2]);
        // The detections name the second object as the truth does.
        assert_eq!(paired.frames[0].detections.object, [1, 1]);

        let by_id = report(&Content { scores: None, ..content }).unwrap();
        assert_eq!(
            told(&by_id),
            [line("0", None, true, 50.0), line("1", None, true, 0.1), line("cup", None, false, 10.1)]
        );
    }

    #[test]
    fn what_is_too_much_is_left_out_evenly_and_told() {
        let scene = scene(MAX_FRAMES + 5);
        let file = estimate(json!({ "id": "cup", "status": "degenerate" }));
        let report = report(&content(&scene, &file)).unwrap();
        assert_eq!((report.frames.len(), &*report.frames[0].id), (MAX_FRAMES, "0"));
        assert!(report.notes.iter().any(|note| note.contains("10000 of 10005 frames")), "{:?}", report.notes);

        let full = ReportDetections { object: vec![-1; MAX_DETECTIONS / 4], ..Default::default() };
        let mut detections = vec![full; 6];
        let note = thin_out(&mut detections, &[0, 1, 2, 3, 4, 5]).unwrap();
        let kept: Vec<bool> = detections.iter().map(|frame| !frame.object.is_empty()).collect();
        assert_eq!(kept, [true, false, true, false, true, false]);
        assert!(note.contains("one in 2 frames only (375000 of 750000)"), "{note}");
        assert!(thin_out(&mut detections, &[0, 1, 2, 3, 4, 5]).is_none());
    }
}

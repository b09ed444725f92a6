//! Poses that were found, in the records of a scene file.

use std::collections::{HashMap, HashSet};

use quadlift::geometry::CamFromWorld;
use quadlift::relocalize::{LocateStatus, LocatedPose, Relocalization};
use serde_json::{Value, json};

use super::landmarks::ObjectLandmarks;
use super::query::FrameQuery;
use crate::numbers::significant;
use crate::scene_file::SceneFile;

/// The field of frames that says how their pose was sought.
pub const LOCATION: &str = "location";

/// The field of detections with the id that they had before they got that of an object of the map.
pub const GIVEN_OBJECT: &str = "given_object";

/// Significant digits of evidence and standard deviations, and of covariances.
const FIGURE_DIGITS: i32 = 6;
const COVARIANCE_DIGITS: i32 = 9;

/// How a frame was located, as JSON: `status`, and of the most probable pose `evidence`, `position_sd` and `rotation_sd` (root
/// mean squares of the axes), `covariance`, `inliers` (detections by index, and their objects); then the `alternatives`, with
/// their poses. Without a pose that can be trusted the most probable one is the first alternative.
pub fn location_record(frame: &FrameQuery, located: &Relocalization, map: &ObjectLandmarks) -> Value {
    let mut record = json!({ "status": located.status.name() });
    let mut others = &located.poses[..];
    if let (LocateStatus::Ok, [best, rest @ ..]) = (located.status, others) {
        others = rest;
        let of_pose = pose_record(frame, best, map);
        for key in ["evidence", "position_sd", "rotation_sd", "covariance", "inliers"] {
            record[key] = of_pose[key].clone();
        }
    }
    if !others.is_empty() {
        record["alternatives"] = others.iter().map(|pose| pose_record(frame, pose, map)).collect();
    }
    record
}

fn pose_record(frame: &FrameQuery, pose: &LocatedPose, map: &ObjectLandmarks) -> Value {
    let figure = |x: f64| significant(x, FIGURE_DIGITS);
    let [rotation_sd, position_sd] = pose.sds();
    let covariance: [[f64; 6]; 6] =
        std::array::from_fn(|i| std::array::from_fn(|j| significant(pose.covariance[(i, j)], COVARIANCE_DIGITS)));
    let inlier = |&(query_box, landmark): &(usize, usize)| json!({ "detection": frame.detections[query_box], "object": map.ids[landmark] });
    json!({
        "cam_from_world": rows(&pose.cam_from_world),
        "evidence": figure(pose.evidence),
        "rotation_sd": figure(rotation_sd),
        "position_sd": figure(position_sd),
        "covariance": covariance,
        "inliers": pose.matches.iter().map(inlier).collect::<Vec<_>>(),
    })
}

/// A pose by rows.
fn rows(pose: &CamFromWorld) -> [[f64; 4]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| pose.matrix()[(i, j)]))
}

/// Writes what was found into the file whose frames were sought: the poses that can be trusted, how each frame was located, and
/// the objects of the map that detections of located frames show; other ids of these frames mean nothing in the map, and are kept
/// in [`GIVEN_OBJECT`]. Unit and `up` are those of the map, whose objects the file gets if it has none.
///
/// Frames that are not located keep no pose; `drop_unposed` leaves them out, with their detections.
pub fn write_locations(
    file: &mut SceneFile,
    map_file: &SceneFile,
    map: &ObjectLandmarks,
    found: &[(FrameQuery, Relocalization)],
    drop_unposed: bool,
) {
    let mut located_frames = HashMap::new();
    for (frame, located) in found {
        let record = &mut file.frames[frame.frame_index];
        record.extra.insert(LOCATION.to_owned(), location_record(frame, located, map));
        record.cam_from_world = None;
        if let (LocateStatus::Ok, Some(best)) = (located.status, located.poses.first()) {
            record.cam_from_world = Some(rows(&best.cam_from_world));
            let objects: HashMap<usize, usize> =
                best.matches.iter().map(|&(query_box, landmark)| (frame.detections[query_box], landmark)).collect();
            located_frames.insert(record.id.clone(), objects);
        }
    }
    for (index, detection) in file.detections.iter_mut().enumerate() {
        let Some(objects) = located_frames.get(&*detection.frame) else { continue };
        let object = objects.get(&index).map(|&landmark| map.ids[landmark].as_str());
        if let Some(given) = detection.object.take()
            && Some(&*given) != object
        {
            detection.extra.insert(GIVEN_OBJECT.to_owned(), (*given).into());
        }
        detection.object = object.map(Into::into);
    }
    if drop_unposed {
        file.frames.retain(|frame| frame.cam_from_world.is_some() || frame.projection.is_some());
        let kept: HashSet<&str> = file.frames.iter().map(|frame| &*frame.id).collect();
        file.detections.retain(|detection| kept.contains(&*detection.frame));
    }
    file.up = map_file.up.or(file.up);
    file.length_unit = map_file.length_unit.clone().or(file.length_unit.take());
    if file.objects.is_empty() {
        file.objects.clone_from(&map_file.objects);
    }
}

//! Descriptions of the fields of a scene file, for messages.

use super::cue_records::CUE_FIELDS;

/// The expected value of a field by its name, if the message of the JSON reader is not specific enough.
pub(super) fn expected(field: &str) -> Option<&'static str> {
    Some(match field {
        "box" => "\"box\": [x0, y0, x1, y1] in pixels",
        "ellipse" => "\"ellipse\": {\"center\": [x, y], \"semi_axes\": [a, b], \"angle\": radians}",
        "outline" => "\"outline\": [[x, y], [x, y], ...] in pixels, the corners of a polygon",
        "oriented_box" => "\"oriented_box\": {\"center\": [x, y], \"size\": [width, height], \"angle\": radians}",
        "cam_from_world" => "\"cam_from_world\": three rows [r, r, r, t], which map world points to camera points",
        "projection" => "\"projection\": three rows of four numbers, which map world points to pixels",
        "params" => "\"params\": a list of numbers in COLMAP's order, [fx, fy, cx, cy] for a PINHOLE camera",
        "up" => "\"up\": [x, y, z], the world direction against gravity",
        "point_cloud" => {
            "\"point_cloud\": {\"path\": \"...\", \"frame\": \"camera\", \"transform\": three rows of four numbers}"
        }
        "observed_points" => "\"observed_points\": a list of whole numbers, the points of the scene from 0",
        "observed_pixels" => "\"observed_pixels\": [[x, y], [x, y], ...], the pixels of \"observed_points\"",
        "transform" => "\"transform\": three rows [a, b, c, t], which map points of the file to \"frame\"",
        "points" => "\"points\": a list of [x, y, z] in the world",
        "rotation" => "\"rotation\": a unit quaternion [w, x, y, z]",
        "half_extents" => "\"half_extents\": three numbers, half the size along each axis",
        "mask" => {
            "\"mask\": {\"path\": \"...\", \"value\": a whole number}, {\"rle\": {...}} or {\"polygons\": [[x, y, ...]]}"
        }
        "cue_sources" => "\"cue_sources\": {\"name of a source\": {\"scale\": \"frame\"}}",
        "segmentation" => "\"segmentation\": {\"method\": \"...\", \"status\": \"...\"} as written by quadlift segment",
        "rle" => "\"rle\": {\"size\": [height, width], \"counts\": ...} as in COCO",
        "polygons" => "\"polygons\": [[x, y, x, y, ...], ...] in pixels",
        "frame" | "camera" | "id" | "object" | "category" | "source" => "ids and names are text, also \"12\"",
        _ => return CUE_FIELDS.iter().find(|(cue, ..)| *cue == field).map(|(_, _, expected)| *expected),
    })
}

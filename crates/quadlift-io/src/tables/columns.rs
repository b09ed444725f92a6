//! The tables and their columns.

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    /// Any JSON, as text.
    Json,
    Number,
    Whole,
    Bool,
    Texts,
    /// A list of numbers.
    Numbers,
    /// A matrix with rows of this length, as one list.
    Rows(usize),
    /// A list of as many numbers as there are names, each in a separate column.
    Split(&'static [&'static str]),
}

/// An entry of a record and its column.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    /// Name of the column; of [`Kind::Split`] for messages only.
    pub name: &'static str,
    pub kind: Kind,
    /// Where the entry is in the JSON of the record.
    pub path: &'static [&'static str],
}

/// A table: one file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table {
    /// Name of the file.
    pub file: &'static str,
    pub columns: &'static [Column],
}

/// The column of what no other column has.
pub(super) const EXTRA: &str = "extra";

const fn column(name: &'static str, kind: Kind, path: &'static [&'static str]) -> Column {
    Column { name, kind, path }
}

use Kind::{Bool, Json, Number, Numbers, Rows, Split, Text, Texts, Whole};

/// The scene as a whole: one row.
pub(super) const SCENE: Table = Table {
    file: "scene.parquet",
    columns: &[
        column("format", Text, &["format"]),
        column("version", Whole, &["version"]),
        column("name", Text, &["name"]),
        column("length_unit", Text, &["length_unit"]),
        column("up", Split(&["up_x", "up_y", "up_z"]), &["up"]),
        column("notes", Text, &["notes"]),
        column("localization", Json, &["localization"]),
    ],
};

/// The cameras.
pub(super) const CAMERAS: Table = Table {
    file: "cameras.parquet",
    columns: &[
        column("id", Text, &["id"]),
        column("model", Text, &["model"]),
        column("width", Number, &["width"]),
        column("height", Number, &["height"]),
        column("params", Numbers, &["params"]),
    ],
};

/// The frames.
pub(super) const FRAMES: Table = Table {
    file: "frames.parquet",
    columns: &[
        column("id", Text, &["id"]),
        column("camera", Text, &["camera"]),
        column("cam_from_world", Rows(4), &["cam_from_world"]),
        column("projection", Rows(4), &["projection"]),
        column("width", Number, &["width"]),
        column("height", Number, &["height"]),
        column("image", Text, &["image"]),
        column("time", Number, &["time"]),
    ],
};

/// The detections.
pub(super) const DETECTIONS: Table = Table {
    file: "detections.parquet",
    columns: &[
        column("frame", Text, &["frame"]),
        column("object", Text, &["object"]),
        column("category", Text, &["category"]),
        column("source", Text, &["source"]),
        column("score", Number, &["score"]),
        column("box", Split(&["x0", "y0", "x1", "y1"]), &["box"]),
        column("ellipse_center", Split(&["ellipse_x", "ellipse_y"]), &["ellipse", "center"]),
        column("ellipse_semi_axes", Split(&["ellipse_a", "ellipse_b"]), &["ellipse", "semi_axes"]),
        column("ellipse_angle", Number, &["ellipse", "angle"]),
        column("outline", Rows(2), &["outline"]),
        column("oriented_box_center", Split(&["oriented_box_x", "oriented_box_y"]), &["oriented_box", "center"]),
        column("oriented_box_size", Split(&["oriented_box_width", "oriented_box_height"]), &["oriented_box", "size"]),
        column("oriented_box_angle", Number, &["oriented_box", "angle"]),
        column("mask", Json, &["mask"]),
        column("depth_median", Number, &["depth", "median"]),
        column("depth_sd", Number, &["depth", "sd"]),
        column("depth_source", Text, &["depth", "source"]),
        column("box3d_center", Numbers, &["box3d", "center"]),
        column("box3d_half_extents", Numbers, &["box3d", "half_extents"]),
        column("box3d_rotation", Numbers, &["box3d", "rotation"]),
        column("box3d_frame", Text, &["box3d", "frame"]),
        column("box3d_sd_distance", Number, &["box3d", "sd", "distance"]),
        column("box3d_sd_direction", Number, &["box3d", "sd", "direction"]),
        column("box3d_sd_size", Number, &["box3d", "sd", "size"]),
        column("box3d_sd_rotation", Number, &["box3d", "sd", "rotation"]),
        column("box3d_covariance", Rows(9), &["box3d", "covariance"]),
        column("box3d_source", Text, &["box3d", "source"]),
        column("segmentation_method", Text, &["segmentation", "method"]),
        column("segmentation_status", Text, &["segmentation", "status"]),
        column("segmentation_reason", Text, &["segmentation", "reason"]),
        column("segmentation_confidence", Number, &["segmentation", "confidence"]),
        column("segmentation_cut_by_border", Number, &["segmentation", "truncated_by_border"]),
        column("segmentation_touches_others", Number, &["segmentation", "touches_other_masks"]),
        column("occluded", Number, &["occluded"]),
        column("truncated", Number, &["truncated"]),
        column("visible_fraction", Number, &["visible_fraction"]),
    ],
};

/// The objects, without the residuals of their views.
pub(super) const OBJECTS: Table = Table {
    file: "objects.parquet",
    columns: &[
        column("id", Text, &["id"]),
        column("category", Text, &["category"]),
        column("status", Text, &["status"]),
        column("center", Split(&["center_x", "center_y", "center_z"]), &["center"]),
        column("center_sd", Number, &["center_sd"]),
        column("ellipsoid_center", Numbers, &["ellipsoid", "center"]),
        column("ellipsoid_semi_axes", Numbers, &["ellipsoid", "semi_axes"]),
        column("ellipsoid_rotation", Numbers, &["ellipsoid", "rotation"]),
        column("enclosing_ellipsoid_center", Numbers, &["enclosing_ellipsoid", "center"]),
        column("enclosing_ellipsoid_semi_axes", Numbers, &["enclosing_ellipsoid", "semi_axes"]),
        column("enclosing_ellipsoid_rotation", Numbers, &["enclosing_ellipsoid", "rotation"]),
        column("cuboid_center", Numbers, &["cuboid", "center"]),
        column("cuboid_half_extents", Numbers, &["cuboid", "half_extents"]),
        column("cuboid_rotation", Numbers, &["cuboid", "rotation"]),
        column("enclosing_cuboid_center", Numbers, &["enclosing_cuboid", "center"]),
        column("enclosing_cuboid_half_extents", Numbers, &["enclosing_cuboid", "half_extents"]),
        column("enclosing_cuboid_rotation", Numbers, &["enclosing_cuboid", "rotation"]),
        column("cylinder_center", Numbers, &["cylinder", "center"]),
        column("cylinder_radii", Numbers, &["cylinder", "radii"]),
        column("cylinder_half_height", Number, &["cylinder", "half_height"]),
        column("cylinder_rotation", Numbers, &["cylinder", "rotation"]),
        column("enclosing_cylinder_center", Numbers, &["enclosing_cylinder", "center"]),
        column("enclosing_cylinder_radii", Numbers, &["enclosing_cylinder", "radii"]),
        column("enclosing_cylinder_half_height", Number, &["enclosing_cylinder", "half_height"]),
        column("enclosing_cylinder_rotation", Numbers, &["enclosing_cylinder", "rotation"]),
        column("superellipsoid_center", Numbers, &["superellipsoid", "center"]),
        column("superellipsoid_semi_axes", Numbers, &["superellipsoid", "semi_axes"]),
        column("superellipsoid_rotation", Numbers, &["superellipsoid", "rotation"]),
        column("superellipsoid_support_exponent", Number, &["superellipsoid", "support_exponent"]),
        column("enclosing_superellipsoid_center", Numbers, &["enclosing_superellipsoid", "center"]),
        column("enclosing_superellipsoid_semi_axes", Numbers, &["enclosing_superellipsoid", "semi_axes"]),
        column("enclosing_superellipsoid_rotation", Numbers, &["enclosing_superellipsoid", "rotation"]),
        column("enclosing_superellipsoid_support_exponent", Number, &["enclosing_superellipsoid", "support_exponent"]),
        column("views_used", Whole, &["views_used"]),
        column("views_rejected", Texts, &["views_rejected"]),
        column("residual_px", Number, &["residual_px"]),
        column("normalized_residual", Number, &["goodness_of_fit", "normalized_residual"]),
        column("relative_residual", Number, &["goodness_of_fit", "relative_residual"]),
        column("warnings", Texts, &["warnings"]),
        column("covariance_coordinates", Text, &["covariance", "coordinates"]),
        column("covariance", Rows(9), &["covariance", "matrix"]),
    ],
};

/// The contribution of each view to each object, in the order of the objects.
pub(super) const VIEWS: Table = Table {
    file: "views.parquet",
    columns: &[
        column("object", Text, &["object"]),
        column("frame", Text, &["view", "frame"]),
        column("residual_px", Number, &["view", "residual_px"]),
        column("normalized_residual", Number, &["view", "normalized_residual"]),
        column("inlier", Bool, &["view", "inlier"]),
        column("rejection_reason", Text, &["view", "rejection_reason"]),
    ],
};

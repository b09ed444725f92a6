//! The short texts of options in `-h`, with their headings and placeholders. Long texts are where the options are declared.

use quadlift_io::options::Group;

/// An option or argument in the help.
pub(super) struct Text {
    /// The command that it belongs to; empty for all that have it.
    pub command: &'static str,
    /// The name of the argument in clap.
    pub id: &'static str,
    /// The heading; empty to leave it as declared.
    pub heading: &'static str,
    /// Placeholder of the value; empty to leave it as declared.
    pub placeholder: &'static str,
    /// Three to eight words, at most 60 characters, no parentheses.
    pub short: &'static str,
}

const INPUT: &str = Group::Input.title();
const OUTPUT: &str = Group::Output.title();
const MODEL: &str = Group::Model.title();
const ASSOCIATION: &str = Group::Association.title();
const POSES: &str = Group::Poses.title();
const CORRECTIONS: &str = Group::Corrections.title();
const FORMATS: &str = "Other formats";
const LOGS: &str = "Logs in MCAP";
const SCENE: &str = "Scene";
const RUN: &str = Group::Run.title();
const RESEARCH: &str = Group::Research.title();

/// All headings in the order of the help. Options without one come first.
pub(super) const HEADINGS: [&str; 16] = [
    INPUT,
    SCENE,
    "Detector",
    "Identities",
    "Outlines, depths and 3D boxes",
    "Rendering",
    "Hall",
    MODEL,
    ASSOCIATION,
    POSES,
    CORRECTIONS,
    OUTPUT,
    FORMATS,
    LOGS,
    RUN,
    RESEARCH,
];

/// Options of `localize` in its `-h`; the others are in `--help`.
pub(super) const USUAL: [&str; 25] = [
    "scenes",
    "cameras",
    "detections",
    "class_names",
    "source",
    "min_score",
    "measurement",
    "output",
    "report",
    "compact",
    "cross_validate",
    "body",
    "priors",
    "learn_sizes",
    "ground_plane",
    "camera_height",
    "associate",
    "ids",
    "refine_poses",
    "fix",
    "allow_inconsistent",
    "assume",
    "up",
    "image_size",
    "threads",
];

/// Options of `localize` that its help leaves to that of `quadlift import FORMAT`, and those for research: they are usable.
pub(super) const HIDDEN: [&str; 25] = [
    "method",
    "reg_weight",
    "annotations",
    "frame_column",
    "columns",
    "kind",
    "box_origin",
    "points",
    "sequence",
    "frames",
    "intrinsics",
    "image_list",
    "camera",
    "calibration_folder",
    "channels",
    "sweeps",
    "world_object",
    "models",
    "topics",
    "world_frame",
    "camera_frame",
    "max_gap",
    "rectified",
    "skip_errors",
    "write_images",
];

/// The row of a table of [`Text`].
const fn of(
    command: &'static str,
    id: &'static str,
    heading: &'static str,
    placeholder: &'static str,
    short: &'static str,
) -> Text {
    Text { command, id, heading, placeholder, short }
}

/// The texts. Those of a command come before those of all.
pub(super) const TEXTS: &[Text] = &[
    of("segment", "scene", "", "SCENE", "Scene file whose frames name their images"),
    of("segment", "images", INPUT, "FILE", "Take the images from this video"),
    of("stream", "resume", INPUT, "", "Continue from the file of --state"),
    of("stream", "source", INPUT, "SOURCE", "Use only this source of a scene"),
    of("align", "up_sd", MODEL, "DEG", "Set the error of the up directions"),
    of("relocalize", "camera_height", POSES, "HEIGHT,SD", "Set the height of the cameras"),
    of("calibrate-rig", "include_posed", INPUT, "", "Calibrate cameras that have a pose too"),
    of("calibrate-rig", "upright", MODEL, "CATEGORY", "Name categories whose bodies are upright"),
    of("evaluate", "ground_truth", "", "GROUND_TRUTH", "Scene with true objects or true ids"),
    of("import", "source", INPUT, "SOURCE", "Name the source of these detections"),
    of("import", "output", OUTPUT, "FILE", "Write the scene to this file"),
    of("synth", "output", OUTPUT, "FILE", "Write the scene to this file"),
    of("export", "camera", INPUT, "ID", "Choose the camera by its id"),
    of("export", "output", OUTPUT, "PATH", "Write to this file or folder"),
    of("render", "all", INPUT, "", "Draw every frame"),
    of("render", "output", OUTPUT, "PATH", "Write this file, or with --all this folder"),
    of("render", "svg", OUTPUT, "", "Write SVG with --all"),
    of("synth", "body", SCENE, "BODY,...", "Choose the kinds of bodies"),
    of("synth", "measurement", SCENE, "boxes|ellipses|both", "Choose what is measured in the images"),
    of("synth", "pose_noise", SCENE, "DEG", "Set the rotation error of the cameras"),
    of("synth", "points", SCENE, "N", "Add tracked points about the objects"),
    of("synth", "ground_truth", "", "FILE", "Write the scene with the true objects"),
    of("synth", "cameras", "", "N", "Set the number of fixed cameras"),
    // Inputs.
    of("", "scenes", "", "SCENE", "Scene files, folders or patterns in quotes"),
    of("", "scene", "", "SCENE", "Scene file to read"),
    of("", "files", "", "SCENE", "Scene files, results and ground truth"),
    of("", "input", "", "INPUT", "JSON Lines, scene file or log"),
    of("", "estimate", "", "ESTIMATE", "Result of localize or associate"),
    of("", "map_file", "", "MAP", "Object map, such as a result of localize"),
    of("", "query", "", "QUERY", "Scene with images without poses"),
    of("", "a", "", "A", "First map, which keeps its frame"),
    of("", "b", "", "B", "Second map, which is moved"),
    of("", "path", "", "PATH", "File or folder to read"),
    of("", "shell", "", "", "Shell that will read the script"),
    of("", "command", "", "COMMAND", "Command whose page is printed"),
    of("", "cameras", INPUT, "PATH", "Read cameras of another program"),
    of("", "detections", INPUT, "PATH", "Read detections of another program"),
    of("", "into", INPUT, "SCENE", "Add the detections to this scene"),
    of("", "source", INPUT, "SOURCE", "Use only the detections of this source"),
    of("", "min_score", INPUT, "SCORE", "Skip detections with a lower score"),
    of("", "class_names", INPUT, "FILE", "Read class names from this file"),
    of("", "image_size", INPUT, "WxH", "Set the width and height of the images"),
    of("", "images", INPUT, "DIR", "Find the images in this folder"),
    of("", "replace", INPUT, "", "Remove the existing detections"),
    of("", "include_posed", INPUT, "", "Locate frames that have a pose too"),
    of("", "frame", INPUT, "ID", "Choose the frame by its id"),
    of("", "matching", INPUT, "auto|ids|overlap", "Choose how estimates and objects are paired"),
    // Outputs.
    of("", "output", OUTPUT, "FILE", "Write the result to this file"),
    of("", "report", OUTPUT, "FILE", "Write a report in HTML"),
    of("", "compact", OUTPUT, "", "Write a third of the size"),
    of("", "coverage", OUTPUT, "", "Calibrate confidence regions on earlier results"),
    of("", "out", OUTPUT, "DIR", "Write the files into this folder"),
    of("", "out_masks", OUTPUT, "DIR", "Write the masks as label images"),
    of("", "contact_sheets", OUTPUT, "DIR", "Write pictures of crops with masks"),
    of("", "map", OUTPUT, "FILE", "Write the object map as a result"),
    of("", "save_every", OUTPUT, "N", "Write map and state every N frames"),
    of("", "state", OUTPUT, "FILE", "Write what --resume continues from"),
    of("", "rerun", OUTPUT, "TARGET", "Show the stream live in Rerun"),
    of("", "drop_unposed", OUTPUT, "", "Drop frames without a pose"),
    of("", "no_browser", OUTPUT, "", "Print the path without opening it"),
    of("", "open", OUTPUT, "", "Open the report in the browser"),
    of("", "labels", OUTPUT, "", "Write labels beside the objects"),
    of("", "enclosing", OUTPUT, "", "Export the enclosing ellipsoids instead"),
    of("", "frusta", OUTPUT, "LENGTH", "Set the depth of the camera frusta"),
    of("", "only_detected", OUTPUT, "", "Write only frames with a detection"),
    of("", "calib", INPUT, "FILE", "Read the KITTI calibration of the sequence"),
    of("", "scene_id", OUTPUT, "N", "Set the column scene_id"),
    of("", "origin", OUTPUT, "LAT,LON,ALT", "Set the place of the world's origin"),
    of("", "north", OUTPUT, "X,Y,Z", "Set the world direction of north"),
    of("", "crs", OUTPUT, "EPSG:N", "Set the coordinates of the world"),
    of("", "length_unit", OUTPUT, "UNIT", "Set the unit of the lengths"),
    of("", "frame_id", OUTPUT, "FRAME", "Name the world frame in headers"),
    of("", "views", OUTPUT, "FILE", "Write a second table of views"),
    // The model.
    of("", "priors", MODEL, "FILE", "Read typical sizes of categories"),
    of("", "edge_noise", MODEL, "SHARE", "Set the relative error of box edges"),
    of("", "baseline", MODEL, "CAM_A,CAM_B,LENGTH", "Set the distance between two cameras"),
    of("", "still", MODEL, "CATEGORY", "Name categories whose objects do not move"),
    of("", "rigid", MODEL, "", "Align maps of one scale"),
    of("", "similarity", MODEL, "", "Estimate the scale of the second map"),
    of("", "no_up", MODEL, "", "Do not use the up directions"),
    // Association and poses.
    of("", "up_in_camera", POSES, "X,Y,Z", "Set the direction upwards in the cameras"),
    of("", "up_sd", POSES, "DEG", "Set the error of that direction"),
    // Corrections.
    of("", "allow_inconsistent", CORRECTIONS, "", "Continue with an inconsistent scene"),
    of("", "assume", CORRECTIONS, "KEY=VALUE", "State what the inputs really are"),
    of("", "up", CORRECTIONS, "AXIS", "Set the world direction against gravity"),
    // Other formats.
    of("", "by", FORMATS, "auto|name|stem|index|time", "Choose how images are matched to frames"),
    of("", "annotations", FORMATS, "FILE", "Read images and categories of COCO"),
    of("", "frame_column", FORMATS, "COLUMN", "Name the column of the images"),
    of("", "columns", FORMATS, "COLUMNS", "State the columns after the box"),
    of("", "kind", FORMATS, "auto|box|polygon|obb", "State what follows the class"),
    of("", "box_origin", FORMATS, "0|1", "Set the coordinate of the first pixel"),
    of("", "pixel_centers", FORMATS, "integer|half", "Set the center of the first pixel"),
    of("", "points", FORMATS, "N", "Keep at most this many sparse points"),
    of("", "sequence", FORMATS, "SEQUENCE", "Choose the sequence or scene"),
    of("", "frames", FORMATS, "FIRST-LAST", "Choose the first and last frame"),
    of("", "intrinsics", FORMATS, "FILE", "Read the intrinsics of the camera"),
    of("", "image_list", FORMATS, "FILE", "Read the images and their times"),
    of("", "time_tolerance", FORMATS, "SECONDS", "Set the maximum difference of times"),
    of("", "camera", FORMATS, "N", "Choose the camera by its number"),
    of("", "calibration_folder", FORMATS, "DIR", "Find the calibration in this folder"),
    of("", "channels", FORMATS, "CHANNEL,...", "Choose the cameras by their names"),
    of("", "sweeps", FORMATS, "", "Read images between the key frames"),
    of("", "world_object", FORMATS, "ID", "Use the model frame of this object"),
    of("", "models", FORMATS, "FILE", "Read the models of the data set"),
    of("", "topics", LOGS, "TOPIC,...", "Choose the topics to use"),
    of("", "world_frame", LOGS, "FRAME", "Choose the frame of the world"),
    of("", "camera_frame", LOGS, "FRAME", "Choose the frame of the camera"),
    of("", "max_gap", LOGS, "SECONDS", "Limit the time between interpolated transforms"),
    of("", "rectified", LOGS, "", "State that boxes are of rectified images"),
    of("", "skip_errors", LOGS, "", "Leave out what cannot be read"),
    of("", "write_images", LOGS, "DIR", "Write the images of the log"),
    // Synthetic scenes.
    of("", "objects", SCENE, "N", "Set the number of objects"),
    of("synth", "views", SCENE, "N", "Set the number of views"),
    of("", "standing", SCENE, "", "Stand the objects on a plane"),
    of("", "noise", SCENE, "KIND:AMOUNT", "Add noise to the measurements"),
    of("", "edge_bias", SCENE, "SHARE", "Add systematic errors of box edges"),
    of("", "outliers", SCENE, "SHARE", "Replace some detections by wrong boxes"),
    of("", "trajectory", SCENE, "TRAJECTORY", "Choose the positions of the cameras"),
    of("", "cube", SCENE, "LENGTH", "Set the side of the objects' cube"),
    of("", "scale", SCENE, "FACTOR", "Scale the whole world"),
    of("", "offset", SCENE, "X,Y,Z", "Translate the whole world"),
    of("", "point_noise", SCENE, "PX", "Set the pixel error of points"),
    of("", "misses", "", "SHARE", "Miss some of the visible objects"),
    of("", "false_positives", "", "RATIO", "Add false boxes per true box"),
    of("", "duplicates", "", "SHARE", "Detect some objects twice"),
    of("", "occlusion", "", "", "Let objects occlude each other"),
    of("", "no_ids", "", "", "Write detections without object ids"),
    of("", "fragments", "", "SHARE", "Break tracks into fragments"),
    of("", "switches", "", "SHARE", "Swap the tracks of neighbors"),
    of("", "cues", "", "CUE,...", "Choose what detections carry besides boxes"),
    of("", "cue_noise", "", "KIND:AMOUNT", "Set the errors of these cues"),
    of("", "pedestrians", "", "N", "Write a hall with walking people"),
    of("", "time_steps", "", "N", "Set the number of time steps"),
    // All commands.
    of("", "strict", RUN, "", "Stop at the first wrong line"),
    of("", "seed", RUN, "N", "Set the seed of random numbers"),
    of("", "threads", RUN, "N", "Set the number of threads"),
    of("", "json", OUTPUT, "", "Print one JSON document"),
    of("", "verbose", RUN, "", "Print details to standard error"),
    of("", "quiet", RUN, "", "Print only errors"),
    of("", "max_pixels", RUN, "N", "Limit the pixels of an image"),
];

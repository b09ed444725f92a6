//! The scenes of the comparison. The list is fixed: figures of different days can be compared.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use quadlift::geometry::{Body, BodyKind};
use quadlift::scene::Detection;
use quadlift::synthetic::{
    Box3dNoise, CueOptions, DepthNoise, Detector, Noise, Observations, ShapeOptions, SyntheticIds, SyntheticOptions,
    SyntheticScene, Trajectory, generate, simulate_cues, simulate_shapes,
};
use quadlift_io::{SceneFile, read_scene_file};

use crate::association::driving::with_true_ids;
use crate::error::Error;
use quadlift_io::synthetic_file;

/// A true object counts if it is detected this often.
const MIN_DETECTIONS: usize = 2;

/// Objects of a synthetic scene.
const OBJECTS: usize = 20;

/// Objects of a synthetic scene without ids: a crowd.
const CROWD: usize = 40;

/// First seed of synthetic scenes: none that thresholds were tuned on.
const FIRST_SEED: u64 = 7000;

/// The volume IoU of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Overlap {
    /// Of the ellipsoids (O3D).
    Ellipsoids,
    /// Of the enclosing ellipsoid: the truth is the envelope of the object.
    Enclosing,
    /// Of the bodies of their own kinds.
    Bodies,
}

/// One scene: what the programs get, and the truth.
pub(crate) struct SceneCase {
    /// Name within the set.
    pub name: String,
    /// The scene without true objects, and without ids if they are to be found.
    pub input: SceneFile,
    /// The same with the true objects and ids.
    pub truth: SceneFile,
    /// Ids of the true objects that count.
    pub counted: BTreeSet<String>,
}

/// Scenes of one kind.
pub(crate) struct Set {
    /// Name in the table.
    pub name: String,
    /// Whether it is real data.
    pub is_real: bool,
    /// Whether detections have ids.
    pub has_ids: bool,
    /// How objects are scored.
    pub overlap: Overlap,
    /// Options of `localize`.
    pub options: Vec<&'static str>,
    /// The scenes.
    pub scenes: Vec<SceneCase>,
}

impl SceneCase {
    /// Takes the truth from the input: its objects and, if `has_ids` is false, the ids of detections.
    fn new(name: String, truth: SceneFile, has_ids: bool) -> Self {
        let mut detections: HashMap<&str, usize> = HashMap::new();
        for object in truth.detections.iter().filter_map(|record| record.object.as_deref()) {
            *detections.entry(object).or_default() += 1;
        }
        let is_seen = |id: &str| detections.get(id).is_some_and(|count| *count >= MIN_DETECTIONS);
        let counted = truth.objects.iter().map(|object| object.id.clone()).filter(|id| is_seen(id)).collect();
        let mut input = SceneFile { objects: Vec::new(), ..truth.clone() };
        if !has_ids {
            for record in &mut input.detections {
                record.object = None;
            }
        }
        Self { name, input, truth, counted }
    }
}

/// Options for cars from a car.
const CAR: &[&str] = &["--body", "cuboid", "--priors", "builtin", "--camera-height", "1.65"];

/// Frames of each video of KITTI tracking: all of them (154 to 803) would take longer than everything else.
const VIDEO_FRAMES: usize = 150;

/// A real set: name, files, source of the boxes, whether they have ids, overlap, options.
type RealSet = (&'static str, &'static [&'static str], &'static str, bool, Overlap, &'static [&'static str]);

/// The real sets, with all views of all scenes.
#[rustfmt::skip]
const REAL: [RealSet; 12] = [
    ("LINEMOD, YOLO", &LINEMOD, "yolo", true, Overlap::Enclosing, &[]),
    ("LINEMOD, model boxes", &LINEMOD, "model", true, Overlap::Enclosing, &[]),
    ("LM-O, model boxes", &LMO, "model", true, Overlap::Enclosing, &[]),
    ("LM-O, visible boxes", &LMO, "visible-mask", true, Overlap::Enclosing, &[]),
    ("LM-O, visible boxes, no ids", &LMO, "visible-mask", false, Overlap::Enclosing, &[]),
    ("TUW", &["tuw_demo"], "authors", true, Overlap::Ellipsoids, &[]),
    ("TUW, no ids", &["tuw_demo"], "authors", false, Overlap::Ellipsoids, &[]),
    ("KITTI aligned, RRC", &ALIGNED, "rrc", true, Overlap::Ellipsoids, &[]),
    ("KITTI aligned, RRC, car options", &ALIGNED, "rrc", true, Overlap::Ellipsoids, CAR),
    ("KITTI aligned, RRC, no ids, car options", &ALIGNED, "rrc", false, Overlap::Ellipsoids, CAR),
    ("KITTI GPS/IMU, RRC, car options", &OXTS, "rrc", true, Overlap::Ellipsoids, CAR),
    ("KITTI aligned, labels, car options", &LABELED, "label", true, Overlap::Ellipsoids, CAR),
];

const LINEMOD: [&str; 8] =
    ["accv_ape", "accv_can", "accv_cat", "accv_driller", "accv_duck", "accv_glue", "accv_iron", "accv_vise"];
const LMO: [&str; 2] = ["lmo_A", "lmo_B"];
const ALIGNED: [&str; 4] = ["kitti_S05_aligned", "kitti_S09_aligned", "kitti_S22_aligned", "kitti_S36_aligned"];
const OXTS: [&str; 4] = ["kitti_S05_oxts", "kitti_S09_oxts", "kitti_S22_oxts", "kitti_S36_oxts"];
const LABELED: [&str; 7] = [
    "kitti_S05_aligned",
    "kitti_S09_aligned",
    "kitti_S22_aligned",
    "kitti_S23_aligned",
    "kitti_S35_aligned",
    "kitti_S35ext_aligned",
    "kitti_S36_aligned",
];

/// The real sets. Of KITTI, boxes that are largely occluded or truncated are left out, as in the paper.
///
/// # Errors
/// [`Error::Read`].
pub(crate) fn real(data: &Path) -> Result<Vec<Set>, Error> {
    let set = |(name, files, source, has_ids, overlap, options): RealSet| -> Result<Set, Error> {
        let scene = |file: &&str| -> Result<SceneCase, Error> {
            let mut truth = read_scene_file(&data.join("scenes").join(format!("{file}.json")))?;
            truth.detections.retain(|record| {
                record.source.as_deref() == Some(source)
                    && record.occluded.is_none_or(|level| level <= 1.0)
                    && record.truncated.is_none_or(|level| level <= 0.0)
            });
            Ok(SceneCase::new((*file).to_owned(), truth, has_ids))
        };
        let scenes = files.iter().map(scene).collect::<Result<_, _>>()?;
        Ok(Set { name: name.to_owned(), is_real: true, has_ids, overlap, options: options.to_vec(), scenes })
    };
    let mut sets: Vec<Set> = REAL.into_iter().map(set).collect::<Result<_, Error>>()?;
    if data.join("kitti_tracking").is_dir() {
        let videos = with_true_ids(data)?.into_iter();
        sets.push(Set {
            name: "KITTI tracking, RRC, no ids".to_owned(),
            is_real: true,
            has_ids: false,
            overlap: Overlap::Ellipsoids,
            options: Vec::new(),
            scenes: videos.map(|(name, file)| SceneCase::new(name, beginning(file), false)).collect(),
        });
    }
    Ok(sets)
}

/// The first frames of a video.
fn beginning(mut file: SceneFile) -> SceneFile {
    file.frames.truncate(VIDEO_FRAMES);
    let kept: BTreeSet<&str> = file.frames.iter().map(|frame| frame.id.as_str()).collect();
    file.detections.retain(|record| kept.contains(&*record.frame));
    file
}

/// What detections carry besides boxes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Cue {
    None,
    DepthAndBox3d,
    Outline,
}

/// The synthetic sets: name, options of the scenes, and cues.
fn synthetic_options() -> Vec<(&'static str, SyntheticOptions, Cue)> {
    let boxes = |views: usize, noise: f64| SyntheticOptions {
        objects: OBJECTS,
        views,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(noise)],
        ..Default::default()
    };
    let wrong = |views, share| SyntheticOptions { outlier_share: share, ..boxes(views, 0.05) };
    let kinds = SyntheticOptions {
        kinds: vec![BodyKind::Cuboid, BodyKind::Cylinder, BodyKind::Ellipsoid],
        standing: true,
        trajectory: Trajectory::Random,
        edge_bias: 0.04,
        ..boxes(20, 0.02)
    };
    let crowd = |views, noise, misses, false_boxes, cube_side| SyntheticOptions {
        objects: CROWD,
        cube_side,
        ids: SyntheticIds::Absent,
        detector: Detector { misses, false_boxes, ..Default::default() },
        ..boxes(views, noise)
    };
    let cuboids = |noise| SyntheticOptions { body: BodyKind::Cuboid, ..boxes(8, noise) };
    let street = SyntheticOptions { trajectory: Trajectory::Street, pose_noise: 0.2, ..boxes(40, 0.05) };
    vec![
        ("exact boxes, 3 views", boxes(3, 0.0), Cue::None),
        ("exact boxes, 8 views", boxes(8, 0.0), Cue::None),
        ("5 % noise, 3 views", boxes(3, 0.05), Cue::None),
        ("5 % noise, 4 views", boxes(4, 0.05), Cue::None),
        ("5 % noise, 8 views", boxes(8, 0.05), Cue::None),
        ("5 % noise, 20 views", boxes(20, 0.05), Cue::None),
        ("10 % wrong boxes, 4 views", wrong(4, 0.1), Cue::None),
        ("10 % wrong boxes, 8 views", wrong(8, 0.1), Cue::None),
        ("30 % wrong boxes, 20 views", wrong(20, 0.3), Cue::None),
        ("exact cuboids, 8 views", cuboids(0.0), Cue::None),
        ("cuboids, 5 % noise, 8 views", cuboids(0.05), Cue::None),
        ("standing kinds, 20 views", kinds, Cue::None),
        ("street, poses off by 0.2 degrees", street, Cue::None),
        ("no ids, 8 views", crowd(8, 0.05, 0.2, 0.15, 30.0), Cue::None),
        ("no ids, 20 views", crowd(20, 0.1, 0.3, 0.2, 30.0), Cue::None),
        ("depths and 3D boxes, 3 views", boxes(3, 0.05), Cue::DepthAndBox3d),
        ("outlines, 4 views", boxes(4, 0.05), Cue::Outline),
    ]
}

/// The synthetic sets, each of `count` scenes.
///
/// # Errors
/// [`Error::Synthetic`], [`Error::Scene`].
pub(crate) fn synthetic(count: u64) -> Result<Vec<Set>, Error> {
    let set = |(name, options, cue): (&str, SyntheticOptions, Cue)| {
        let has_ids = options.ids == SyntheticIds::True;
        let scene = |number: u64| -> Result<SceneCase, Error> {
            let seed = FIRST_SEED + number;
            let made = generate(&SyntheticOptions { seed, ..options.clone() })?;
            let file = with_cue(made, cue, seed)?;
            Ok(SceneCase::new(format!("scene {number}"), file, has_ids))
        };
        let scenes = (0..count).map(scene).collect::<Result<_, _>>()?;
        let (name, options) = (name.to_owned(), Vec::new());
        Ok(Set { name, is_real: false, has_ids, overlap: Overlap::Bodies, options, scenes })
    };
    synthetic_options().into_iter().map(set).collect()
}

/// The scene with true ids, whose detections of true objects carry cues.
fn with_cue(mut made: SyntheticScene, cue: Cue, seed: u64) -> Result<SceneFile, Error> {
    let (objects, truth) = (made.true_objects.clone(), made.truth.clone());
    let body_of =
        |index: usize, _: &Detection| -> Option<Body> { Some(truth[objects.get(index).copied().flatten()?].1) };
    if cue == Cue::DepthAndBox3d {
        let cues = CueOptions { depth: Some(DepthNoise::default()), box3d: Some(Box3dNoise::default()) };
        made.scene = simulate_cues(&made.scene, body_of, &cues, seed)?;
    }
    let mut file = synthetic_file::with_true_ids(synthetic_file::scene_file(&made), &made);
    if cue == Cue::Outline {
        let shapes = ShapeOptions { outline: Some(0.05), ..Default::default() };
        for (record, shape) in file.detections.iter_mut().zip(simulate_shapes(&made.scene, body_of, &shapes, seed)) {
            record.outline = shape.outline.map(Vec::into_boxed_slice);
        }
    }
    Ok(file)
}

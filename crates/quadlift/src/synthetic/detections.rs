//! The detections of a synthetic scene, before they are added to it, and the ids that they name.

use nalgebra::{Vector2, Vector3};

use super::cameras;
use super::detector::{self, DetectorSource};
use super::noise::NoiseSource;
use super::objects::Object;
use super::options::{SyntheticError, SyntheticIds, SyntheticOptions};
use super::scene::SyntheticFrame;
use super::tracks::{Tracked, tracks};
use crate::geometry::{Body, BoundingBox, ConvexBody, Ellipse, Projection, project_bounding_box, project_ellipsoid};
use crate::random;
use crate::sorting::StableSort;

/// Streams of the seed.
const FIRST_NOISE_STREAM: u64 = 1;
const FIRST_DETECTOR_STREAM: u64 = 10;
const TRACK_STREAM: u64 = 13;
const EDGE_BIAS_STREAM: u64 = 14;

/// A detection before it has a name.
pub(super) struct Found {
    pub frame: usize,
    pub object: Option<usize>,
    pub bounding_box: Option<BoundingBox>,
    pub ellipse: Option<Ellipse>,
    pub is_outlier: bool,
}

/// All detections: of the objects, then the false ones and duplicates.
pub(super) fn detect(
    options: &SyntheticOptions,
    objects: &[Object],
    truth: &[(String, Body)],
    frames: &[SyntheticFrame],
    projections: &[Projection],
) -> Result<Vec<Found>, SyntheticError> {
    let [width, height] = cameras::image_size(options.trajectory);
    let image = Vector2::new(f64::from(width), f64::from(height));
    let is_free = options.trajectory.is_free();
    let bodies: Vec<Body> =
        objects.iter().enumerate().map(|(k, o)| o.body(options.kind_of(k), 1.0, &Vector3::zeros())).collect();
    // The exact boxes of visible objects, by object and frame.
    let mut exact_boxes = vec![vec![None; projections.len()]; bodies.len()];
    for (object, body) in bodies.iter().enumerate() {
        for (frame, projection) in projections.iter().enumerate() {
            exact_boxes[object][frame] = match project_bounding_box(projection, body) {
                Ok(exact) => {
                    let is_near = projection.depth(&body.center()) <= options.trajectory.range();
                    (!is_free || is_near && detector::is_in_image(&exact, image)).then_some(exact)
                }
                Err(_) if is_free => None,
                Err(reason) => {
                    let (object, frame) = (truth[object].0.clone(), frames[frame].id.clone());
                    return Err(SyntheticError::NotInView { object, frame, reason });
                }
            };
        }
    }
    let covered = if options.detector.occlusion { covered(&bodies, projections, &exact_boxes) } else { Vec::new() };
    let mut noise = NoiseSource::new(options, FIRST_NOISE_STREAM);
    let mut biases = random::stream(options.seed, EDGE_BIAS_STREAM);
    let mut detector = DetectorSource::new(options.detector, options.seed, FIRST_DETECTOR_STREAM);
    let measured = |bounding_box: BoundingBox| {
        let ellipse = options.observations.ellipses().then(|| Ellipse::inscribed_in(&bounding_box));
        (options.observations.boxes().then_some(bounding_box), ellipse)
    };
    let (mut found, mut duplicates) = (Vec::new(), Vec::new());
    let mut boxes_in: Vec<Vec<BoundingBox>> = vec![Vec::new(); projections.len()];
    for (object, body) in bodies.iter().enumerate() {
        let bias = [(); 4].map(|()| options.edge_bias * random::normal(&mut biases));
        for (frame, projection) in projections.iter().enumerate() {
            let Some(exact_box) = exact_boxes[object][frame] else { continue };
            // All random numbers are drawn, even if unused, so that options are independent.
            let outlier = noise.outlier(&exact_box)?;
            let mut bounding_box = exact_box;
            if options.observations.boxes() {
                let noisy = noise.bounding_box(&exact_box, &bias)?;
                bounding_box = outlier.unwrap_or(noisy);
            }
            let mut ellipse = None;
            if options.observations.ellipses() {
                let not_in_view = |reason| SyntheticError::NotInView {
                    object: truth[object].0.clone(),
                    frame: frames[frame].id.clone(),
                    reason,
                };
                let exact = project_ellipsoid(projection, &body.closest_ellipsoid()).map_err(not_in_view)?;
                let noisy = noise.ellipse(&exact)?;
                ellipse = Some(outlier.as_ref().map_or(noisy, Ellipse::inscribed_in));
            }
            let is_missed = detector.misses();
            let duplicate = detector.duplicate(&bounding_box);
            let is_covered = covered.get(object).is_some_and(|by_frame| by_frame[frame]);
            if is_missed || is_covered {
                continue;
            }
            if is_free {
                let Some(inside) = detector::cut(&bounding_box, image) else { continue };
                bounding_box = inside;
            }
            boxes_in[frame].push(bounding_box);
            let duplicate = if is_free { duplicate.and_then(|d| detector::cut(&d, image)) } else { duplicate };
            duplicates.extend(duplicate.map(|d| (frame, d)));
            let bounding_box = options.observations.boxes().then_some(bounding_box);
            found.push(Found { frame, object: Some(object), bounding_box, ellipse, is_outlier: outlier.is_some() });
        }
    }
    let all: Vec<BoundingBox> = boxes_in.iter().flatten().copied().collect();
    let mut others = duplicates;
    for (frame, in_frame) in boxes_in.iter().enumerate() {
        let made = detector.false_boxes(in_frame, &all, projections.len(), image)?;
        others.extend(made.into_iter().map(|b| (frame, b)));
    }
    others.stable_sort_by_key(|&(frame, _)| frame);
    for (frame, bounding_box) in others {
        let (bounding_box, ellipse) = measured(bounding_box);
        found.push(Found { frame, object: None, bounding_box, ellipse, is_outlier: false });
    }
    Ok(found)
}

/// Which objects are covered by nearer ones, by object and frame.
fn covered(bodies: &[Body], projections: &[Projection], boxes: &[Vec<Option<BoundingBox>>]) -> Vec<Vec<bool>> {
    let mut covered = vec![vec![false; projections.len()]; bodies.len()];
    for (frame, projection) in projections.iter().enumerate() {
        let in_view: Vec<usize> = (0..bodies.len()).filter(|&object| boxes[object][frame].is_some()).collect();
        let with_depth = in_view
            .iter()
            .filter_map(|&object| Some((boxes[object][frame]?, projection.depth(&bodies[object].center()))));
        for (&object, hidden) in in_view.iter().zip(detector::covered(&with_depth.collect::<Vec<_>>())) {
            covered[object][frame] = hidden;
        }
    }
    covered
}

/// The id of each detection.
pub(super) fn names(options: &SyntheticOptions, found: &[Found], truth: &[(String, Body)]) -> Vec<Option<String>> {
    match options.ids {
        SyntheticIds::True => found.iter().map(|f| f.object.map(|object| truth[object].0.clone())).collect(),
        SyntheticIds::Absent => vec![None; found.len()],
        SyntheticIds::Tracks { fragments, switches } => {
            let tracked = found.iter().enumerate().filter_map(|(detection, f)| {
                let outline = f.ellipse.as_ref().map(|e| e.center);
                let place = f.bounding_box.as_ref().map(BoundingBox::center).or(outline)?;
                Some(Tracked { detection, frame: f.frame, object: f.object?, place })
            });
            let mut rng = random::stream(options.seed, TRACK_STREAM);
            let mut names = vec![None; found.len()];
            for (detection, track) in tracks(tracked.collect(), fragments, switches, &mut rng) {
                names[detection] = Some(format!("track_{track:04}"));
            }
            names
        }
    }
}

//! Do poses and detections fit together? Wrong conventions (camera axes, direction of the transform, units) give valid
//! scenes in which nothing is where it was seen.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Vector2};
use quadlift::geometry::Projection;
use quadlift::scene::Scene;
use quadlift::solve::triangulate;
use quadlift_io::SceneFile;

/// So many objects are enough to tell.
const MOST_OBJECTS: usize = 100;

/// Objects in fewer views fit to almost any poses.
const FEWEST_VIEWS: usize = 3;

/// Poses are suspicious when the centres of the boxes miss by more than this share of the boxes' half sizes...
const BAD_FIT: f64 = 0.5;

/// ...and another convention has this share of the error.
const MUCH_BETTER: f64 = 0.3;

/// Nothing that a detector sees well is farther away than this, in metres.
const FAR_AWAY: f64 = 300.0;

/// The views of one object: its projections, and centre and half size of its measurements, in pixels.
type Seen = Vec<(usize, Vector2<f64>, f64)>;

/// Oddities in words.
pub fn pose_oddities(file: &SceneFile, scene: &Scene) -> Vec<String> {
    let mut oddities = Vec::new();
    oddities.extend(true_objects_behind(file, scene));
    let objects = objects(scene);
    if objects.is_empty() {
        return oddities;
    }
    let as_given: Vec<Projection> = scene.frames.iter().map(|frame| frame.projection).collect();
    let given = fit(&objects, &as_given);
    let better = ALTERNATIVES.iter().find_map(|(what, change)| {
        let projections = changed(file, scene, change)?;
        let other = fit(&objects, &projections);
        let much_better = given.error > BAD_FIT && other.error < MUCH_BETTER * given.error;
        (other.in_front > 0.9 && (much_better || given.in_front < 0.5 && other.error < BAD_FIT)).then_some(what)
    });
    if given.in_front < 0.5 {
        oddities.push(format!(
            "{} of {} objects lie behind most cameras that see them, by the centres of their boxes",
            given.behind,
            objects.len()
        ));
    }
    if let Some(what) = better {
        oddities.push(format!("the detections fit much better to other poses: {what}"));
    }
    if scene.length_unit.as_deref() == Some("m") && given.depth > FAR_AWAY {
        oddities
            .push(format!("the objects are {:.0} m away, by their boxes: are the lengths millimetres?", given.depth));
    }
    oddities
}

/// What may have gone wrong, and the matrix that undoes it, from the given `cam_from_world` to the true one.
type Change = fn(&Matrix4<f64>) -> Option<Matrix4<f64>>;

const ALTERNATIVES: [(&str, Change); 3] = [
    ("the camera axes may be OpenGL's (y up, z backwards) instead of OpenCV's", |pose| Some(opengl() * pose)),
    ("the poses may map from the camera to the world instead of the other way", |pose| pose.try_inverse()),
    ("the poses may map from the camera to the world, with OpenGL's axes", |pose| Some(opengl() * pose.try_inverse()?)),
];

fn opengl() -> Matrix4<f64> {
    Matrix4::from_diagonal(&nalgebra::Vector4::new(1.0, -1.0, -1.0, 1.0))
}

/// The projections with changed poses; `None` when a frame has no pose of its own.
fn changed(file: &SceneFile, scene: &Scene, change: &Change) -> Option<Vec<Projection>> {
    let projection = |(record, frame): (&quadlift_io::scene_file::FrameRecord, &quadlift::scene::Frame)| {
        let rows = record.cam_from_world?;
        let pose = Matrix4::from_fn(|i, j| if i < 3 { rows[i][j] } else { f64::from(u8::from(j == 3)) });
        let rotation: Matrix3<f64> = pose.fixed_view::<3, 3>(0, 0).into_owned();
        let intrinsics = frame.projection.m() * rotation.try_inverse()?;
        let changed = change(&pose)?;
        Projection::from_matrix(intrinsics * Matrix3x4::from(changed.fixed_view::<3, 4>(0, 0))).ok()
    };
    file.frames.iter().zip(&scene.frames).map(projection).collect()
}

/// The measurements of the objects with enough views, by source.
fn objects(scene: &Scene) -> Vec<Seen> {
    let mut seen = Vec::new();
    for source in (0..scene.sources.len()).map(|index| Some(index as u32)).chain([None]) {
        for group in scene.detections_by_object(|detection| detection.source_index == source) {
            let views: Seen = group
                .iter()
                .filter_map(|&index| {
                    let detection = &scene.detections[index as usize];
                    let ellipse = scene.view(detection).ellipse_or_inscribed()?;
                    Some((detection.frame_index as usize, ellipse.center, ellipse.semi_axes.mean()))
                })
                .collect();
            if views.len() >= FEWEST_VIEWS {
                seen.push(views);
            }
            if seen.len() == MOST_OBJECTS {
                return seen;
            }
        }
    }
    seen
}

/// How objects fit to projections.
struct Fit {
    /// Median error of the centres, in half sizes.
    error: f64,
    /// Share of the objects in front of most of their cameras, and the number of the others.
    in_front: f64,
    behind: usize,
    /// Median distance from the cameras.
    depth: f64,
}

fn fit(objects: &[Seen], projections: &[Projection]) -> Fit {
    let (mut errors, mut depths, mut in_front) = (Vec::new(), Vec::new(), 0);
    for views in objects {
        let observations: Vec<_> = views.iter().map(|(frame, center, _)| (projections[*frame], *center)).collect();
        let Some(point) = triangulate(&observations) else {
            errors.push(f64::INFINITY);
            continue;
        };
        let miss = |(frame, center, half_size): &(usize, Vector2<f64>, f64)| {
            let h = projections[*frame].matrix() * point.to_homogeneous();
            (Vector2::new(h.x / h.z, h.y / h.z) - center).norm() / half_size
        };
        errors.push(median(views.iter().map(miss).collect()));
        let depth = median(views.iter().map(|(frame, _, _)| projections[*frame].depth(&point)).collect());
        in_front += usize::from(depth > 0.0);
        depths.push(depth);
    }
    Fit {
        error: median(errors),
        in_front: in_front as f64 / objects.len() as f64,
        behind: objects.len() - in_front,
        depth: median(depths),
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Detections of true objects whose centre lies behind the camera.
fn true_objects_behind(file: &SceneFile, scene: &Scene) -> Option<String> {
    let centers: std::collections::HashMap<String, Point3<f64>> =
        (file.to_objects().ok()?.into_iter()).filter_map(|object| Some((object.id, object.center?))).collect();
    let behind = scene.detections.iter().filter(|detection| {
        let center = detection.object_index.and_then(|index| centers.get(&scene.object_ids[index as usize]));
        center.is_some_and(|c| scene.frames[detection.frame_index as usize].projection.depth(c) <= 0.0)
    });
    match behind.count() {
        0 => None,
        1 => Some("1 detection shows an object of the file that lies behind its camera".to_owned()),
        n => Some(format!("{n} detections show an object of the file that lies behind their camera")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use quadlift::synthetic::{SyntheticOptions, generate};

    /// A synthetic scene whose poses are written in another convention.
    fn oddities(wrong: impl Fn(Matrix4<f64>) -> Matrix4<f64>) -> Vec<String> {
        let synthetic = generate(&SyntheticOptions { objects: 5, views: 10, ..Default::default() }).unwrap();
        let mut file = crate::synthetic_file::scene_file(&synthetic);
        for frame in &mut file.frames {
            let rows = frame.cam_from_world.unwrap();
            let pose = wrong(Matrix4::from_fn(|i, j| if i < 3 { rows[i][j] } else { f64::from(u8::from(j == 3)) }));
            frame.cam_from_world = Some([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| pose[(i, j)])));
        }
        file.length_unit = Some("m".to_owned());
        file.objects.clear();
        let scene = file.to_scene().unwrap();
        pose_oddities(&file, &scene)
    }

    #[test]
    fn wrong_conventions_are_named() {
        assert_eq!(oddities(|pose| pose), Vec::<String>::new());
        let named = |oddities: &[String], words: &str| oddities.iter().any(|text| text.contains(words));
        let flipped = oddities(|pose| opengl() * pose);
        assert!(named(&flipped, "may be OpenGL's (y up"), "{flipped:?}");
        let inverted = oddities(|pose| pose.try_inverse().unwrap());
        assert!(named(&inverted, "instead of the other way"), "{inverted:?}");
        let both = oddities(|pose| (opengl() * pose).try_inverse().unwrap());
        assert!(named(&both, "with OpenGL's axes"), "{both:?}");
        let millimetres = oddities(|mut pose| {
            let moved: Vector3<f64> = pose.fixed_view::<3, 1>(0, 3) * 1000.0;
            pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&moved);
            pose
        });
        assert!(named(&millimetres, "are the lengths millimetres?"), "{millimetres:?}");
    }
}

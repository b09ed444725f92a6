//! Positions of objects, triangulated from box centers: behind their cameras, or implausibly far away. The consistency check
//! ([`quadlift::diagnosis`]) tests whether they are consistent with the poses.

use nalgebra::{Point3, Vector2};
use quadlift::geometry::Projection;
use quadlift::scene::Scene;
use quadlift::solve::triangulate;
use quadlift_io::SceneFile;

/// Maximum number of objects for the check.
const MAX_OBJECTS: usize = 100;

/// Objects in fewer views fit to almost any poses.
const MIN_VIEWS: usize = 3;

/// Nothing that a detector sees well is farther away than this, in meters.
const FAR_AWAY: f64 = 300.0;

/// The views of one object: the frames, and the centers of its measurements in pixels.
type Seen = Vec<(usize, Vector2<f64>)>;

/// Possible problems, as text.
pub(crate) fn pose_oddities(file: &SceneFile, scene: &Scene) -> Vec<String> {
    let mut oddities = Vec::new();
    oddities.extend(true_objects_behind(file, scene));
    let objects = objects(scene);
    if objects.is_empty() {
        return oddities;
    }
    let projections: Vec<Projection> = scene.frames.iter().map(|frame| frame.projection).collect();
    let given = fit(&objects, &projections);
    if given.in_front < 0.5 {
        oddities.push(format!(
            "{} of {} objects lie behind most of the cameras that detect them (triangulated from box centers)",
            given.behind,
            objects.len()
        ));
    }
    if scene.length_unit.as_deref() == Some("m") && given.depth > FAR_AWAY {
        oddities
            .push(format!("the boxes place the objects {:.0} m away: are the lengths in millimeters?", given.depth));
    }
    oddities
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
                    Some((detection.frame_index as usize, ellipse.center()))
                })
                .collect();
            if views.len() >= MIN_VIEWS {
                seen.push(views);
            }
            if seen.len() == MAX_OBJECTS {
                return seen;
            }
        }
    }
    seen
}

/// Positions of objects, triangulated from box centers.
struct Fit {
    /// Share of the objects in front of most of their cameras, and the number of the others.
    in_front: f64,
    behind: usize,
    /// Median distance from the cameras.
    depth: f64,
}

fn fit(objects: &[Seen], projections: &[Projection]) -> Fit {
    let (mut depths, mut in_front) = (Vec::new(), 0);
    for views in objects {
        let observations: Vec<_> = views.iter().map(|(frame, center)| (projections[*frame], *center)).collect();
        let Some(point) = triangulate(&observations) else { continue };
        let depth = median(views.iter().map(|(frame, _)| projections[*frame].depth(&point)).collect());
        in_front += usize::from(depth > 0.0);
        depths.push(depth);
    }
    Fit { in_front: in_front as f64 / objects.len() as f64, behind: objects.len() - in_front, depth: median(depths) }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Detections of true objects whose center lies behind the camera.
fn true_objects_behind(file: &SceneFile, scene: &Scene) -> Option<String> {
    let centers: std::collections::HashMap<String, Point3<f64>> =
        (file.to_objects().ok()?.into_iter()).filter_map(|object| Some((object.id, object.center?))).collect();
    let behind = scene.detections.iter().filter(|detection| {
        let center = detection.object_index.and_then(|index| centers.get(&scene.object_ids[index as usize]));
        center.is_some_and(|c| scene.frames[detection.frame_index as usize].projection.depth(c) <= 0.0)
    });
    match behind.count() {
        0 => None,
        1 => Some("1 detection is of an object that lies behind its camera".to_owned()),
        n => Some(format!("{n} detections are of objects that lie behind their camera")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Vector3, Vector4};
    use quadlift::synthetic::{SyntheticOptions, generate};

    /// A synthetic scene whose poses are written in another convention.
    fn oddities(wrong: impl Fn(Matrix4<f64>) -> Matrix4<f64>) -> Vec<String> {
        let synthetic = generate(&SyntheticOptions { objects: 5, views: 10, ..Default::default() }).unwrap();
        let mut file = quadlift_io::synthetic_file::scene_file(&synthetic);
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
    fn objects_behind_cameras_and_lengths_of_millimeters_are_told() {
        assert_eq!(oddities(|pose| pose), Vec::<String>::new());
        let named = |oddities: &[String], words: &str| oddities.iter().any(|text| text.contains(words));
        let backwards = oddities(|pose| Matrix4::from_diagonal(&Vector4::new(-1.0, 1.0, -1.0, 1.0)) * pose);
        assert!(named(&backwards, "5 of 5 objects lie behind"), "{backwards:?}");
        let millimeters = oddities(|mut pose| {
            let moved: Vector3<f64> = pose.fixed_view::<3, 1>(0, 3) * 1000.0;
            pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&moved);
            pose
        });
        assert!(named(&millimeters, "are the lengths in millimeters?"), "{millimeters:?}");
    }
}

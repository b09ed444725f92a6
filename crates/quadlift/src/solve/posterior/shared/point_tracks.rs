//! Which points help to correct poses: those with parallax, enough for every frame (docs/method.md, section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Vector3};

use super::pose_unknowns::PoseUnknowns;
use crate::geometry::Projection;
use crate::geometry::ray_sum::RaySum;
use crate::parallel::map_indices;
use crate::scene::{PointObservation, Scene, TrackedPoint};
use crate::sorting::StableSort;

/// Largest angle between two rays of a point, below which it is left out (1.5 degrees, as COLMAP's `filter_min_tri_angle`).
const MIN_PARALLAX: f64 = 1.5 / 180.0 * std::f64::consts::PI;

/// Points that a frame shows, from which on it asks for no more.
const POINTS_OF_FRAME: usize = 50;

/// Work of a factor (products of blocks) that tracks may cause. Tracks over more frames are divided.
const TRACK_WORK: f64 = 4e5;

/// A point, or a part of its track.
#[derive(Debug, Clone)]
pub(super) struct Track {
    /// Where the scene has it.
    pub given: Point3<f64>,
    /// Where its rays meet, or what the scene has if that is nearer to what they saw; `None` where both lie behind a camera.
    pub start: Option<Point3<f64>>,
    /// Its observations.
    pub seen: Vec<PointObservation>,
}

/// The tracks that are used: with parallax, long ones first, until every frame has enough.
pub(super) fn choose_tracks(scene: &Scene, unknowns: &PoseUnknowns) -> Vec<Track> {
    // So many time steps lie in one part of a track that a factor does not take longer.
    let time_steps = scene.frames.len().max(1) as f64;
    let longest = ((TRACK_WORK / time_steps).sqrt() as usize).max(2);
    let parts: Vec<(Point3<f64>, Vec<PointObservation>)> =
        scene.points.iter().flat_map(|point| parts_of(point, longest, unknowns)).collect();
    let directions: Vec<Option<Matrix3<f64>>> =
        scene.frames.iter().map(|frame| frame.projection.m().try_inverse()).collect();
    let has_parallax = map_indices(parts.len(), |k| parallax(&parts[k].1, &directions) >= MIN_PARALLAX);
    let mut order: Vec<usize> = (0..parts.len()).filter(|k| has_parallax[*k]).collect();
    order.stable_sort_by_key(|k| std::cmp::Reverse(parts[*k].1.len()));
    let mut shown: BTreeMap<u32, usize> = BTreeMap::new();
    order.retain(|k| {
        let seen = &parts[*k].1;
        let is_needed = seen.iter().any(|seen| shown.get(&seen.frame_index).is_none_or(|n| *n < POINTS_OF_FRAME));
        if is_needed {
            seen.iter().for_each(|seen| *shown.entry(seen.frame_index).or_default() += 1);
        }
        is_needed
    });
    order.sort_unstable();
    map_indices(order.len(), |k| {
        let (given, seen) = &parts[order[k]];
        let candidates = [Some(*given), triangulated(seen, scene)];
        let cost = |point: &Point3<f64>| cost(point, seen, scene);
        let start = candidates.into_iter().flatten().filter(|point| cost(point).is_finite());
        let start = start.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        Track { given: *given, start, seen: seen.clone() }
    })
}

/// The observations of a point in parts over at most so many time steps each, those with two of them at least.
fn parts_of(
    point: &TrackedPoint,
    longest: usize,
    unknowns: &PoseUnknowns,
) -> Vec<(Point3<f64>, Vec<PointObservation>)> {
    let mut seen = point.observations.clone();
    seen.stable_sort_by_key(|seen| unknowns.time_step(seen.frame_index as usize));
    let mut parts: Vec<Vec<PointObservation>> = Vec::new();
    let mut first = 0;
    for seen in seen {
        let time_step = unknowns.time_step(seen.frame_index as usize);
        match parts.last_mut() {
            Some(part) if time_step - first <= longest => part.push(seen),
            _ => {
                first = time_step;
                parts.push(vec![seen]);
            }
        }
    }
    parts.into_iter().filter(|part| part.len() > 1).map(|part| (point.position, part)).collect()
}

/// The largest angle between two rays.
fn parallax(seen: &[PointObservation], directions: &[Option<Matrix3<f64>>]) -> f64 {
    let ray = |seen: &PointObservation| {
        let ray = directions[seen.frame_index as usize]? * seen.pixel.push(1.0);
        ray.try_normalize(0.0)
    };
    let rays: Vec<Vector3<f64>> = seen.iter().filter_map(ray).collect();
    let least = rays.iter().enumerate().flat_map(|(k, a)| rays[..k].iter().map(move |b| a.dot(b))).fold(1.0, f64::min);
    least.clamp(-1.0, 1.0).acos()
}

/// The point nearest to the rays.
fn triangulated(seen: &[PointObservation], scene: &Scene) -> Option<Point3<f64>> {
    let mut rays = RaySum::zero();
    for seen in seen {
        let projection: &Projection = &scene.frames[seen.frame_index as usize].projection;
        let (center, ray) = (projection.center_in_world()?, projection.ray_in_world(&seen.pixel)?);
        rays.add(&center.coords, &ray, 1.0, 1.0);
    }
    Some(Point3::from(rays.information.cholesky()?.solve(&rays.toward)))
}

/// How far it appears from where it was seen: a sum of distances in pixels, in which wrong observations do not count more than others;
/// infinite behind a camera.
fn cost(point: &Point3<f64>, seen: &[PointObservation], scene: &Scene) -> f64 {
    let distance = |seen: &PointObservation| {
        let pixel = scene.frames[seen.frame_index as usize].projection.project_point(point);
        pixel.map_or(f64::INFINITY, |pixel| (pixel - seen.pixel).norm() / seen.stretch)
    };
    seen.iter().map(distance).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{CamFromWorld, Intrinsics};
    use crate::scene::SceneBuilder;
    use nalgebra::Matrix3x4;

    /// Cameras along x with this gap, and points that all of them see.
    fn scene(cameras: usize, gap: f64, points: usize) -> Scene {
        let mut builder = SceneBuilder::new("tracks");
        let intrinsics = Intrinsics::new(500.0, 500.0, 320.0, 240.0).unwrap();
        let mut projections = Vec::new();
        for k in 0..cameras {
            let mut matrix = Matrix3x4::identity();
            matrix[(0, 3)] = -gap * k as f64;
            let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(matrix).unwrap());
            builder.add_frame(&k.to_string(), projection, None).unwrap();
            projections.push(projection);
        }
        for k in 0..points {
            let point = Point3::new((0.37 * k as f64) % 3.0, (0.61 * k as f64) % 2.0, 10.0);
            let pixel = |k: usize| (k, projections[k].project_point(&point).unwrap().into());
            // The scene has them elsewhere.
            let seen: Vec<(usize, [f64; 2])> = (0..cameras).map(pixel).collect();
            builder.add_point([point.x, point.y, 12.0], &seen).unwrap();
        }
        builder.build()
    }

    #[test]
    fn frames_get_enough_points_where_their_rays_meet() {
        let tracks = choose_tracks(&scene(6, 0.5, 300), &PoseUnknowns::default());
        assert_eq!(tracks.len(), POINTS_OF_FRAME);
        for track in &tracks {
            let start = track.start.unwrap();
            assert!((start - Point3::new(track.given.x, track.given.y, 10.0)).norm() < 1e-9 && track.seen.len() == 6);
        }
        // Half a degree.
        assert!(choose_tracks(&scene(6, 0.0175, 300), &PoseUnknowns::default()).is_empty());
        let behind = TrackedPoint { position: Point3::new(0.0, 0.0, -5.0), observations: Vec::new() };
        assert_eq!(parts_of(&behind, 5, &PoseUnknowns::default()).len(), 0);
    }

    #[test]
    fn long_tracks_are_divided() {
        let longest = (TRACK_WORK / 1000.0).sqrt() as usize;
        let tracks = choose_tracks(&scene(1000, 0.1, 3), &PoseUnknowns::default());
        // Those parts from which the points are seen well enough.
        assert!(tracks.len() > 30, "{}", tracks.len());
        let span = |track: &Track| track.seen[track.seen.len() - 1].frame_index - track.seen[0].frame_index;
        assert!(tracks.iter().all(|track| span(track) as usize <= longest));
        assert!(tracks.iter().all(|track| track.seen.len() == longest + 1));
    }
}

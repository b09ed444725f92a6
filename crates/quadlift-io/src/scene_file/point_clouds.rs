//! Points: a cloud of a frame (LiDAR), one of the scene, and points of structure from motion with the frames that observed them; the
//! depths of detections that they show.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Vector2};
use quadlift::Observer;
use quadlift::scene::{DepthCue, Frame, Scene, SceneBuilder};
use quadlift_segment::{ProjectedPoint, SurfaceOfPoints, surface_of_points};

use super::depth_images::{DepthsFound, FoundDepth, add, patch_of};
use super::records::{FrameRecord, PointCloudRecord, SceneFile};
use crate::error::{EntryError, ReadError};
use crate::point_cloud::read_point_cloud;
use crate::wording;

/// The source of depths from a cloud without one, and of those from the scene's points.
const CLOUD_SOURCE: &str = "point_cloud";
const POINTS_SOURCE: &str = "points";

/// Most points of clouds that are kept for the next frames.
const MAX_CACHED_POINTS: usize = 20_000_000;

impl PointCloudRecord {
    /// Refuses an unknown frame.
    pub(super) fn check(&self, of_scene: bool, entry: impl Fn(&str) -> String) -> Result<(), EntryError> {
        let expected = match (self.frame.as_deref(), of_scene) {
            (None | Some("world"), _) | (Some("camera"), false) => return Ok(()),
            (Some(_), true) => "\"world\"; a cloud in the frame of a camera belongs to a frame of the scene",
            (Some(_), false) => "\"camera\" or \"world\"",
        };
        let found = self.frame.as_deref().unwrap_or_default();
        Err(EntryError::new(entry(".frame"), format!("found \"{found}\"; expected {expected}")))
    }

    /// Whether the points of a frame's cloud are in the world.
    pub(crate) fn is_in_world(&self) -> bool {
        self.frame.as_deref() == Some("world")
    }

    fn matrix(&self) -> Matrix3x4<f64> {
        self.transform.map_or_else(Matrix3x4::identity, |rows| Matrix3x4::from_fn(|i, j| rows[i][j]))
    }

    /// Follows its points when they move: `by` maps what they are in.
    pub(crate) fn moved_by(&mut self, by: &Matrix4<f64>) {
        let moved =
            by * self.matrix().insert_row(3, 0.0).map_with_location(|i, j, x| if (i, j) == (3, 3) { 1.0 } else { x });
        self.transform = Some([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| moved[(i, j)])));
    }
}

impl FrameRecord {
    /// Checks its cloud and which of the scene's points it observed.
    pub(super) fn check_points(&self, count: usize, entry: impl Fn(&str) -> String) -> Result<(), EntryError> {
        if let Some(cloud) = self.point_cloud.as_deref() {
            cloud.check(false, |field| entry(&format!(".point_cloud{field}")))?;
        }
        let observed = self.observed_points.iter().flatten().enumerate();
        if let Some((k, point)) = observed.into_iter().find(|(_, point)| **point as usize >= count) {
            let problem = format!("found {point}; expected the number of a point from 0, of the scene's {count}");
            return Err(EntryError::new(entry(&format!(".observed_points[{k}]")), problem));
        }
        let Some(pixels) = &self.observed_pixels else { return Ok(()) };
        let points = self.observed_points.as_ref().map_or(0, |points| points.len());
        if pixels.len() != points {
            let problem = format!(
                "found {}; expected one for each of the {} in \"observed_points\"",
                wording::count(pixels.len(), "pixel"),
                wording::count(points, "point")
            );
            return Err(EntryError::new(entry(".observed_pixels"), problem));
        }
        match pixels.iter().position(|pixel| !pixel.iter().all(|x| x.is_finite())) {
            None => Ok(()),
            Some(k) => {
                let problem = format!("found {:?}; expected two finite numbers", pixels[k]);
                Err(EntryError::new(entry(&format!(".observed_pixels[{k}]")), problem))
            }
        }
    }
}

/// Points that a frame may see.
#[derive(Clone, Copy)]
enum Kind {
    /// A cloud of the frame itself.
    OfFrame,
    /// Those of the scene that it observed.
    Observed,
    /// A cloud of the scene, of which some may be hidden.
    OfScene,
}

/// The depth of a detection, and the points that it comes from, if other frames may have it from the same ones.
struct Candidate<'a> {
    depth: FoundDepth<'a>,
    shared: Option<(bool, Vec<u32>)>,
}

/// Whether a frame has a cloud of its own, or it is known which points it observed.
fn has_points(frame: &FrameRecord) -> bool {
    frame.point_cloud.is_some() || frame.observed_points.is_some()
}

impl SceneFile {
    /// Adds the points to a scene whose frames are there and have pixels of them.
    pub(super) fn add_tracked_points(&self, builder: &mut SceneBuilder) -> Result<(), EntryError> {
        let mut tracks: BTreeMap<u32, Vec<(usize, [f64; 2])>> = BTreeMap::new();
        for (index, frame) in self.frames.iter().enumerate() {
            let observed = frame.observed_points.iter().flatten().zip(frame.observed_pixels.iter().flatten());
            observed.for_each(|(point, pixel)| tracks.entry(*point).or_default().push((index, *pixel)));
        }
        for (point, observed) in tracks {
            let Some(position) = self.points.get(point as usize) else { continue };
            let added = builder.add_point(*position, &observed);
            added.map_err(|error| EntryError::new(format!("points[{point}]"), error))?;
        }
        Ok(())
    }

    /// Whether detections may get a depth from points: a frame has a cloud, or the scene has one, or it is known which points a frame
    /// observed.
    pub(crate) fn has_points_of_frames(&self) -> bool {
        self.point_cloud.is_some() || self.frames.iter().any(has_points)
    }

    /// Gives the scene's detections of one source (of all without one) the depth of their visible surface, where they have none, from
    /// points in their mask if they have one, otherwise in their box ([`surface_of_points`]): those of the frame's cloud, those of the
    /// scene that the frame observed, or those of the scene's cloud, in this order. Points of the scene give each object one depth, in one
    /// of its views: its frames see the same points, whose errors are the same. The scene must be that of this file
    /// ([`Self::to_scene`]), associated or not, and `path` is the file's. `observer` is called with the number of frames done and their
    /// total.
    ///
    /// # Errors
    /// As [`Self::to_images`].
    pub fn add_depths_of_points(
        &self,
        path: &Path,
        scene: &mut Scene,
        source_index: Option<u32>,
        observer: &dyn Observer,
    ) -> Result<DepthsFound, EntryError> {
        let mut found = DepthsFound::default();
        let images = self.to_images(path)?;
        let mut clouds = Clouds { folder: path.parent().unwrap_or(Path::new("")), cache: HashMap::new(), cached: 0 };
        let frames = self.without_depth(scene, source_index, |frame| self.point_cloud.is_some() || has_points(frame));
        let mut candidates = Vec::new();
        for (done, (&frame_index, detections)) in frames.iter().enumerate() {
            if observer.progress(done, frames.len()).is_break() {
                break;
            }
            let points = self.points_of_frame(frame_index as usize, scene, &mut clouds, &mut found);
            if points.is_empty() {
                found.without += detections.len();
                continue;
            }
            for (&index, mask) in detections.iter().zip(self.trusted_masks(&images, scene, detections)) {
                let mask = mask.unwrap_or_else(|error| {
                    found.failed(error);
                    None
                });
                let patch = patch_of(scene, index, mask.as_ref(), [0.0; 2]);
                let first = patch.and_then(|patch| {
                    points.iter().find_map(|(kind, source, all)| {
                        Some((*kind, *source, surface_of_points(all, &patch, matches!(kind, Kind::OfScene))?))
                    })
                });
                match first {
                    None => found.without += 1,
                    Some((kind, source, SurfaceOfPoints { depth, points })) => {
                        let shared = match kind {
                            Kind::OfFrame => None,
                            Kind::Observed => Some((false, points)),
                            Kind::OfScene => Some((true, points)),
                        };
                        let cue = DepthCue { median: depth.median, sd: Some(depth.sd), source: None };
                        let known = shared.is_some() && !self.cue_sources.contains_key(source);
                        let depth = FoundDepth { detection: index, cue, source, known };
                        candidates.push(Candidate { depth, shared });
                    }
                }
            }
        }
        let _ = observer.progress(frames.len(), frames.len());
        let given = candidates.len();
        let depths = independent(scene, candidates);
        (found.detections, found.repeated) = (depths.len(), given - depths.len());
        if !depths.is_empty() {
            let added = scene.edit(|parts| depths.iter().for_each(|depth| add(parts, depth)));
            added.map_err(|error| EntryError::new("frames", error))?;
        }
        Ok(found)
    }

    /// The points of a frame in its image, with their source, those that count first at the front.
    fn points_of_frame<'a>(
        &'a self,
        index: usize,
        scene: &Scene,
        clouds: &mut Clouds,
        found: &mut DepthsFound,
    ) -> Vec<(Kind, &'a str, Vec<ProjectedPoint>)> {
        let (record, frame) = (&self.frames[index], &scene.frames[index]);
        let mut points = Vec::new();
        let mut push = |kind: Kind, source: &'a str, all: Vec<ProjectedPoint>| {
            if !all.is_empty() {
                points.push((kind, source, all));
            }
        };
        let source = |cloud: &'a PointCloudRecord| cloud.source.as_deref().unwrap_or(CLOUD_SOURCE);
        if let Some(cloud) = record.point_cloud.as_deref() {
            let to_world = if cloud.is_in_world() { Some(cloud.matrix()) } else { world_from(frame, &cloud.matrix()) };
            match (clouds.read(&cloud.path), to_world) {
                (Ok(all), Some(to_world)) => push(Kind::OfFrame, source(cloud), projected(frame, all, &to_world)),
                (Ok(_), None) => {}
                (Err(error), _) => found.failed(error),
            }
        }
        if let Some(observed) = &record.observed_points {
            let observed: BTreeSet<u32> = observed.iter().copied().collect();
            let point = |&k: &u32| Some((k, Point3::from(*self.points.get(k as usize)?)));
            push(Kind::Observed, POINTS_SOURCE, observed.iter().filter_map(point).filter_map(seen_in(frame)).collect());
        }
        if let Some(cloud) = self.point_cloud.as_deref() {
            match clouds.read(&cloud.path) {
                Ok(all) => push(Kind::OfScene, source(cloud), projected(frame, all, &cloud.matrix())),
                Err(error) => found.failed(error),
            }
        }
        points
    }
}

/// For each object one of the candidates that come from points of the scene, because their errors are the same; those of sensors all. It
/// is the one whose points are most often in the others, too: points of something before or behind the object are rarely. In the order of
/// the detections.
fn independent<'a>(scene: &Scene, mut candidates: Vec<Candidate<'a>>) -> Vec<FoundDepth<'a>> {
    let object = |candidate: &Candidate| scene.detections[candidate.depth.detection].object_index;
    let mut counts: HashMap<(u32, bool, u32), usize> = HashMap::new();
    let mut best: HashMap<u32, (usize, Reverse<usize>)> = HashMap::new();
    for candidate in &candidates {
        if let (Some((of_cloud, points)), Some(object)) = (&candidate.shared, object(candidate)) {
            points.iter().for_each(|point| *counts.entry((object, *of_cloud, *point)).or_default() += 1);
        }
    }
    // How often its points are seen, and the first of those with the same number.
    let rank = |candidate: &Candidate| {
        let ((of_cloud, points), object) = (candidate.shared.as_ref()?, object(candidate)?);
        let seen = points.iter().map(|point| counts[&(object, *of_cloud, *point)]).sum();
        Some((object, (seen, Reverse(candidate.depth.detection))))
    };
    for (object, rank) in candidates.iter().filter_map(rank) {
        let known = best.entry(object).or_insert(rank);
        *known = (*known).max(rank);
    }
    candidates.retain(|candidate| rank(candidate).is_none_or(|(object, rank)| best[&object] == rank));
    candidates.into_iter().map(|candidate| candidate.depth).collect()
}

/// From the camera of a frame to the world, behind a map to the camera; `None` for a camera without a center.
fn world_from(frame: &Frame, camera_from_points: &Matrix3x4<f64>) -> Option<Matrix3x4<f64>> {
    let pose = frame.projection.camera_pose()?;
    let rotation: Matrix3<f64> = pose.matrix().fixed_columns::<3>(0).transpose();
    let mut to_camera = *camera_from_points;
    to_camera.column_mut(3).iter_mut().zip(pose.matrix().column(3).iter()).for_each(|(t, shift)| *t -= shift);
    Some(rotation * to_camera)
}

/// The points that lie before the camera of a frame, where they are in its image; `to_world` maps them to the world.
fn projected(frame: &Frame, points: &[[f64; 3]], to_world: &Matrix3x4<f64>) -> Vec<ProjectedPoint> {
    let in_world = |point: &[f64; 3]| Point3::from(to_world * Point3::from(*point).to_homogeneous());
    let numbered = points.iter().enumerate().filter_map(|(k, point)| Some((u32::try_from(k).ok()?, in_world(point))));
    numbered.filter_map(seen_in(frame)).collect()
}

/// Where a frame sees a numbered point of the world.
fn seen_in(frame: &Frame) -> impl Fn((u32, Point3<f64>)) -> Option<ProjectedPoint> {
    let inside = |pixel: &Vector2<f64>| {
        frame.image_size.is_none_or(|size| (0.0..size.x).contains(&pixel.x) && (0.0..size.y).contains(&pixel.y))
    };
    move |(index, point)| {
        let depth = frame.projection.depth(&point);
        if depth <= 0.0 {
            return None;
        }
        let pinhole = frame.projection.project_point(&point)?;
        let pixel = frame.lens.as_ref().map_or(Some(pinhole), |lens| lens.distort_point(&pinhole))?;
        inside(&pixel).then_some(ProjectedPoint { pixel: pixel.into(), depth, index })
    }
}

/// The clouds that were read, by their paths.
struct Clouds<'a> {
    folder: &'a Path,
    cache: HashMap<PathBuf, Result<Vec<[f64; 3]>, ReadError>>,
    cached: usize,
}

impl Clouds<'_> {
    fn read(&mut self, path: &str) -> Result<&[[f64; 3]], ReadError> {
        let path = self.folder.join(path);
        if !self.cache.contains_key(&path) {
            if self.cached > MAX_CACHED_POINTS {
                (self.cache, self.cached) = (HashMap::new(), 0);
            }
            let points = read_point_cloud(&path);
            self.cached += points.as_ref().map_or(0, Vec::len);
            self.cache.insert(path.clone(), points);
        }
        match &self.cache[&path] {
            Ok(points) => Ok(points),
            Err(error) => Err(error.clone()),
        }
    }
}

#[cfg(test)]
#[path = "point_clouds/tests.rs"]
mod tests;

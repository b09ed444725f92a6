//! What points of structure from motion tell about the poses: each is three unknowns more, eliminated as objects are (docs/method.md,
//! section 11.2).

use crate::optimize::median::median;
use std::collections::BTreeMap;

use nalgebra::{Matrix2x3, Matrix3, Point3, SMatrix, Vector2, Vector3};

use super::point_tracks::Track;
use super::pose_terms::{FrameTerm, Motion, PointPoseTerms};
use super::poses::PoseCorrections;
use crate::geometry::Projection;
use crate::optimize::student_t::StudentT;
use crate::parallel::map_indices;
use crate::scene::{PointObservation, Scene};
use crate::solve::pose_points_report::PosePointsReport;
use crate::sorting::StableSort;

/// The distribution of the errors of an observation, both components together; degrees of freedom as of boxes (section 5.3).
const DOF: f64 = 5.0;
const STUDENT_T: StudentT = StudentT::new(DOF);

/// Least noise level: pixels are rounded to a hundredth.
const MIN_LEVEL: f64 = 0.02;

/// Steps of Gauss and Newton for a point, and rounds of points and their noise level; iterations of the level for the same points.
const STEPS: usize = 3;
const ROUNDS: usize = 3;
const LEVEL_STEPS: usize = 20;

/// Median of the squared length of two standard normal numbers.
const MEDIAN_OF_TWO: f64 = 2.0 * std::f64::consts::LN_2;

/// Least share of an error that a point, or the poses, leave in the residual.
const MIN_FREEDOM: f64 = 0.1;

/// Largest factor on the gradient, and one over the least: that of distributions that are no worse than a normal one or Student's.
const MAX_CALIBRATION: f64 = 1.5;

/// Least information of a point along the rays, relative to that across them. Of 1.5 degrees of parallax it is a few times that; wrong
/// observations, which hardly count, may have feigned them.
const MIN_CONDITION: f64 = 1e-5;

/// The points that help to correct the poses of a scene.
#[derive(Debug, Clone, Default)]
pub(crate) struct PosePoints {
    /// None where points are left out.
    pub(super) tracks: Vec<Track>,
    /// The cameras of all frames, as given.
    pub(super) projections: Vec<Projection>,
    /// The points with the poses as given, if there are any.
    pub(super) as_given: Option<PosePointsReport>,
}

/// A camera: world to pixels, and its center.
struct Camera {
    projection: Projection,
    m: Matrix3<f64>,
    center: Point3<f64>,
}

/// A residual of an observation in pixels of the image, with its derivatives by the position of the point and by the motion of the camera.
struct PointRows {
    residual: Vector2<f64>,
    by_point: Matrix2x3<f64>,
    by_motion: SMatrix<f64, 2, 6>,
}

impl Camera {
    fn new(projection: Projection) -> Option<Self> {
        Some(Self { m: projection.m(), center: projection.center_in_world()?, projection })
    }

    /// `None` behind the camera.
    fn residual(&self, point: &Point3<f64>, seen: &PointObservation) -> Option<Vector2<f64>> {
        Some((self.projection.project_point(point)? - seen.pixel) / seen.stretch)
    }

    fn rows(&self, point: &Point3<f64>, seen: &PointObservation) -> Option<PointRows> {
        let pixel = self.projection.project_point(point)?;
        let v = point - self.center;
        let h = self.m * v;
        let row = |k: usize| (self.m.row(k) - self.m.row(2) * pixel[k]) / (h.z * seen.stretch);
        let by_point = Matrix2x3::from_rows(&[row(0), row(1)]);
        let mut by_motion = SMatrix::<f64, 2, 6>::zeros();
        by_motion.fixed_columns_mut::<3>(0).copy_from(&(by_point * v.cross_matrix()));
        by_motion.fixed_columns_mut::<3>(3).copy_from(&-by_point);
        Some(PointRows { residual: (pixel - seen.pixel) / seen.stretch, by_point, by_motion })
    }
}

/// The residual of an observation.
struct Residual {
    /// Its length, pixels.
    length: f64,
    /// Its square over `free`: as large as that of the error on average.
    square: f64,
    /// The share of the error that the point has left of it.
    free: f64,
}

/// Points under some poses: where they are, and the noise of their observations.
pub(super) struct FittedPoints {
    places: Vec<Option<Point3<f64>>>,
    /// Standard deviation of each component, pixels.
    pub level: f64,
    /// Median distance of observations from where the points appear, pixels; infinite where most points lie behind a camera.
    pub median: f64,
}

/// Factors on weights of the Student t distribution: on them, and on what information they give beyond that. With both a step is one of
/// Newton, and the variance of the gradient is the information (section 12.2).
struct Calibration {
    gradient: f64,
    curvature: f64,
}

impl PosePoints {
    pub(super) fn new(tracks: Vec<Track>, scene: &Scene) -> Self {
        let projections = scene.frames.iter().map(|frame| frame.projection).collect();
        Self { tracks, projections, as_given: None }
    }

    /// Number of observations.
    pub(super) fn observations(&self) -> usize {
        self.tracks.iter().map(|track| track.seen.len()).sum()
    }

    /// The cameras of the frames that show points, corrected.
    fn cameras(&self, poses: &PoseCorrections) -> BTreeMap<u32, Camera> {
        let mut frames: Vec<u32> = self.tracks.iter().flat_map(|t| t.seen.iter().map(|s| s.frame_index)).collect();
        frames.sort_unstable();
        frames.dedup();
        let camera = |frame: u32| {
            let given = &self.projections[frame as usize];
            Some((frame, Camera::new(poses.camera(frame as usize, given)?)?))
        };
        frames.into_iter().filter_map(camera).collect()
    }

    /// What the points tell about the cameras under these corrections, at their places under them.
    pub(crate) fn terms(&self, poses: &PoseCorrections) -> Vec<PointPoseTerms> {
        if self.tracks.is_empty() {
            return Vec::new();
        }
        let cameras = self.cameras(poses);
        let fitted = self.fit(&cameras, poses.determined_by_points());
        let calibration = self.calibration(&fitted, &cameras);
        let terms = |k: usize| terms(&fitted.places[k]?, &self.tracks[k], &cameras, fitted.level, &calibration);
        map_indices(self.tracks.len(), terms).into_iter().flatten().collect()
    }

    /// The points under these corrections.
    pub(super) fn fitted(&self, poses: &PoseCorrections) -> FittedPoints {
        self.fit(&self.cameras(poses), poses.determined_by_points())
    }

    /// Points and the noise of their observations, in turn; the poses took so many degrees of freedom.
    fn fit(&self, cameras: &BTreeMap<u32, Camera>, taken: f64) -> FittedPoints {
        let mut fitted = FittedPoints { places: Vec::new(), level: f64::INFINITY, median: f64::INFINITY };
        for _ in 0..ROUNDS {
            let place = |k: usize| {
                let before = fitted.places.get(k).copied().flatten().or(self.tracks[k].start)?;
                placed(before, &self.tracks[k], cameras, fitted.level)
            };
            fitted.places = map_indices(self.tracks.len(), place);
            let mut seen = self.residuals(&fitted, cameras);
            if seen.is_empty() {
                return FittedPoints { level: MIN_LEVEL, median: f64::INFINITY, ..fitted };
            }
            let free: f64 = seen.iter().map(|seen| seen.free).sum();
            let left = (1.0 - 0.5 * taken / free).max(MIN_FREEDOM);
            seen.iter_mut().for_each(|seen| seen.square /= left);
            seen.stable_sort_by(|a, b| a.square.total_cmp(&b.square));
            let mut level = (seen[seen.len() / 2].square / MEDIAN_OF_TWO).sqrt().max(MIN_LEVEL);
            for _ in 0..LEVEL_STEPS {
                let weighted =
                    |seen: &Residual| STUDENT_T.weight_of(seen.square / (level * level), 2) * seen.square * seen.free;
                level = (seen.iter().map(weighted).sum::<f64>() / (2.0 * free)).sqrt().max(MIN_LEVEL);
            }
            fitted.level = level;
            // Points without a place are the worst ones.
            let mut errors: Vec<f64> = seen.iter().map(|seen| seen.length).collect();
            errors.resize(errors.len().max(self.observations()), f64::INFINITY);
            fitted.median = median(&mut errors).unwrap_or_default();
        }
        fitted
    }

    /// The residuals, in the order of the tracks.
    fn residuals(&self, fitted: &FittedPoints, cameras: &BTreeMap<u32, Camera>) -> Vec<Residual> {
        let of = |k: usize| residuals(&fitted.places[k]?, &self.tracks[k], cameras, fitted.level);
        map_indices(self.tracks.len(), of).into_iter().flatten().flatten().map(|(_, _, residual)| residual).collect()
    }

    fn calibration(&self, fitted: &FittedPoints, cameras: &BTreeMap<u32, Camera>) -> Calibration {
        let inverse = 1.0 / (fitted.level * fitted.level);
        let (mut slope, mut spread, mut weights, mut all) = (0.0, 0.0, 0.0, 0.0);
        for Residual { square, free, .. } in self.residuals(fitted, cameras) {
            let square = square * inverse;
            let weight = STUDENT_T.weight_of(square, 2);
            slope += free * weight * DOF / (DOF + square);
            spread += free * 0.5 * weight * weight * square;
            weights += free * weight;
            all += free;
        }
        if all <= 0.0 {
            return Calibration { gradient: 1.0, curvature: 1.0 };
        }
        // Of exact pixels, below the least level, nothing is spread.
        let gradient = (slope / spread.max(f64::MIN_POSITIVE)).clamp(1.0 / MAX_CALIBRATION, MAX_CALIBRATION);
        Calibration { gradient, curvature: slope / weights }
    }

    /// Median distance, in pixels, of the observations from where the points would be if they were where the scene has them; infinite
    /// behind a camera.
    pub(super) fn median_as_given(&self, poses: &PoseCorrections) -> f64 {
        let cameras = self.cameras(poses);
        let of_track = |track: &Track| {
            let of = |seen: &PointObservation| cameras.get(&seen.frame_index)?.residual(&track.given, seen);
            track.seen.iter().map(|seen| of(seen).map_or(f64::INFINITY, |r| r.norm())).collect::<Vec<f64>>()
        };
        median(&mut self.tracks.iter().flat_map(of_track).collect::<Vec<f64>>()).unwrap_or_default()
    }

    /// Median distance of the points from the cameras that see them.
    pub(super) fn median_distance(&self) -> f64 {
        let center = |frame: u32| self.projections[frame as usize].center_in_world();
        let first = |track: &Track| Some((track.start? - center(track.seen.first()?.frame_index)?).norm());
        median(&mut self.tracks.iter().filter_map(first).collect::<Vec<f64>>()).unwrap_or_default()
    }

    /// Median focal length of the frames that see the points, pixels.
    pub(super) fn usual_focal_length(&self) -> f64 {
        let focal = |track: &Track| Some(self.projections[track.seen.first()?.frame_index as usize].focal_length());
        median(&mut self.tracks.iter().filter_map(focal).collect::<Vec<f64>>()).unwrap_or_default()
    }
}

/// Where the observations of a track say that the point is, under this noise level (infinite: all count alike); `None` where it does not
/// lie before its cameras.
fn placed(mut place: Point3<f64>, track: &Track, cameras: &BTreeMap<u32, Camera>, level: f64) -> Option<Point3<f64>> {
    for _ in 0..STEPS {
        let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for seen in &track.seen {
            let Some(camera) = cameras.get(&seen.frame_index) else { continue };
            let PointRows { residual, by_point, .. } = camera.rows(&place, seen)?;
            let weight = STUDENT_T.weight_of(residual.norm_squared() / (level * level), 2);
            normal += by_point.transpose() * by_point * weight;
            gradient += by_point.transpose() * residual * weight;
        }
        place -= normal.cholesky()?.solve(&gradient);
    }
    let is_before = |seen: &PointObservation| {
        cameras.get(&seen.frame_index).is_none_or(|camera| camera.projection.project_point(&place).is_some())
    };
    (place.iter().all(|x| x.is_finite()) && track.seen.iter().all(is_before)).then_some(place)
}

/// The observations of a point under a noise level: frames, rows, residuals.
fn residuals(
    place: &Point3<f64>,
    track: &Track,
    cameras: &BTreeMap<u32, Camera>,
    level: f64,
) -> Option<Vec<(usize, PointRows, Residual)>> {
    let weighted = |seen: &PointObservation| {
        let rows = cameras.get(&seen.frame_index)?.rows(place, seen)?;
        let weight = STUDENT_T.weight_of(rows.residual.norm_squared() / (level * level), 2);
        Some((seen.frame_index as usize, rows, weight))
    };
    let rows: Vec<(usize, PointRows, f64)> = track.seen.iter().filter_map(weighted).collect();
    let normal: Matrix3<f64> =
        rows.iter().map(|(_, rows, weight)| rows.by_point.transpose() * rows.by_point * *weight).sum();
    let covariance = normal.cholesky()?.inverse();
    let residual = |(frame, rows, weight): (usize, PointRows, f64)| {
        let taken = 0.5 * weight * (rows.by_point * covariance * rows.by_point.transpose()).trace();
        let (length, free) = (rows.residual.norm(), (1.0 - taken).max(MIN_FREEDOM));
        (frame, rows, Residual { length, square: length * length / free, free })
    };
    Some(rows.into_iter().map(residual).collect())
}

/// What a point tells about the cameras.
fn terms(
    place: &Point3<f64>,
    track: &Track,
    cameras: &BTreeMap<u32, Camera>,
    level: f64,
    calibration: &Calibration,
) -> Option<PointPoseTerms> {
    let mut frames: Vec<FrameTerm<3>> = Vec::with_capacity(track.seen.len());
    let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    let inverse = 1.0 / (level * level);
    for (frame, PointRows { residual, by_point, by_motion }, Residual { square, .. }) in
        residuals(place, track, cameras, level)?
    {
        // By the error, not by what a short track leaves of it in the residual.
        let weight = STUDENT_T.weight_of(square * inverse, 2) * inverse * calibration.gradient;
        let mut term = FrameTerm::new(frame);
        for k in 0..2 {
            let motion: Motion = by_motion.row(k).transpose();
            let point: Vector3<f64> = by_point.row(k).transpose();
            term.add(residual[k], &motion, &point.into(), weight);
        }
        normal += by_point.transpose() * by_point * weight;
        gradient += by_point.transpose() * residual * weight;
        term.information *= calibration.curvature;
        term.coupling *= calibration.curvature;
        frames.push(term);
    }
    frames.stable_sort_by_key(|term| term.frame);
    let eigenvalues = normal.symmetric_eigenvalues();
    if eigenvalues.min() < MIN_CONDITION * eigenvalues.max() {
        return None;
    }
    let covariance = (normal * calibration.curvature).cholesky()?.inverse();
    Some(PointPoseTerms { frames, cross: Vec::new(), covariance, step: -(covariance * gradient) })
}

#[cfg(test)]
#[path = "pose_points_tests.rs"]
mod tests;

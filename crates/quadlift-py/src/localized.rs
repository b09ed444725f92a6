//! A localization as the program does it, and its result: estimates as arrays, and as a scene.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use quadlift::Localization;
use quadlift::association::Association;
use quadlift::cross_validation::{Extent, ObjectCrossValidation};
use quadlift::geometry::{Body, quaternion_from_rotation};
use quadlift::nalgebra::{Unit, Vector3};
use quadlift::relocalize::{LandmarkMap, LocateOptions};
use quadlift::run::{Run, RunError};
use quadlift::scene::Scene;
use quadlift::solve::{Alternative, Estimate, Rejection};
use quadlift_io::SceneFile;
use quadlift_io::evaluation::{Matching, evaluate_objects};
use quadlift_io::python::{Correcting, in_python};
use quadlift_io::relocalize::ObjectLandmarks;
use quadlift_io::run::{FileInput, FileOptions, FileRun, FileRunError, run_file};
use quadlift_io::scene_file::coordinates_name;
use quadlift_report::{Content, Scores, page, report};
use serde_json::json;

use crate::association::in_words;
use crate::error::refuse;
use crate::loaded::Loaded;
use crate::recording::recorded;
use crate::relocalize::{LocateQuery, location};
use crate::render::{Drawing, render};
use crate::run::{Ticker, on_threads};
use crate::scene::PyScene;

/// A localization and what it was made from.
#[pyclass(name = "Localized", module = "quadlift._core", frozen)]
pub struct PyLocalized {
    /// The scene as it was given.
    loaded: Arc<Loaded>,
    /// The run.
    run: FileRun,
    /// Index of the used source.
    source: Option<u32>,
    /// Time that the library took, seconds.
    seconds: f64,
    /// The objects in which images are located, made for the first of them.
    map: OnceLock<Result<Landmarks, String>>,
}

/// Ids of landmarks, the map of them, and options with its noise.
type Landmarks = (Vec<String>, LandmarkMap, LocateOptions);

/// Runs all steps on a scene, like the program; `loaded` is the scene as it was given.
pub(crate) fn localized(
    loaded: Arc<Loaded>,
    input: FileInput,
    options: &FileOptions,
    ticker: &Ticker,
) -> Result<PyLocalized, String> {
    let start = Instant::now();
    let source = input.scene().source_index(options.run.localize.source.as_deref());
    let source = source.map_err(|error| format!("{error} (source=...)"))?;
    let run = run_file(input, options, ticker).or_else(|failed| {
        let (input, error) = *failed;
        let FileRunError::Run(error) = error else { return Err(error.to_string()) };
        match *error {
            // As with ids, whose objects are not localized either.
            RunError::NothingFound { check, .. } if !check.diagnosis.consistent => {
                Ok(FileRun { input, run: Run { check: *check, ..Run::default() }, options: options.clone() })
            }
            error => Err(in_words(&error, &input.context)),
        }
    })?;
    Ok(PyLocalized { loaded, run, source, seconds: start.elapsed().as_secs_f64(), map: OnceLock::new() })
}

impl PyLocalized {
    /// The scene that was localized.
    fn scene(&self) -> &Scene {
        self.run.input.scene()
    }

    fn localization(&self) -> &Localization {
        &self.run.run.localization
    }

    fn association(&self) -> Option<&Association> {
        self.run.run.association.as_ref()
    }

    /// As the program makes them of the result.
    fn landmarks(&self) -> Result<Landmarks, String> {
        let ObjectLandmarks { ids, landmarks, .. } = self.file().to_landmarks().map_err(|error| error.to_string())?;
        let options = LocateOptions::with_noise(&self.localization().noise, &landmarks);
        Ok((ids, LandmarkMap::new(landmarks), options))
    }

    /// The result as a file: as the program writes it.
    fn file(&self) -> SceneFile {
        self.run.result()
    }

    /// Why an estimated object may not be one standing object.
    fn doubt(&self, estimate: &Estimate) -> Option<&'static str> {
        let id = &self.scene().object_ids[estimate.object_index];
        // The objects that were found come first, in their order.
        let found = self.association()?.objects.get(estimate.object_index)?;
        found.uncertain.filter(|_| found.id == *id).map(|doubt| doubt.text())
    }
}

#[pymethods]
impl PyLocalized {
    /// Ids of the objects, and the semi-axes of the ellipsoids closest to their bodies.
    fn closest_ellipsoids<'py>(&self, py: Python<'py>) -> (Vec<&str>, Bound<'py, PyArray1<f64>>) {
        let estimates = &self.localization().estimates;
        let axes = |e: &Estimate| e.closest_ellipsoid().map_or([f64::NAN; 3], |ellipsoid| ellipsoid.semi_axes.into());
        let ids = estimates.iter().map(|e| self.scene().object_ids[e.object_index].as_str());
        (ids.collect(), PyArray1::from_vec(py, estimates.iter().flat_map(axes).collect()))
    }

    /// The figures of the objects and of the detections by name.
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let estimates = &self.localization().estimates;
        let dict = PyDict::new(py);
        let name = |e: &Estimate| self.scene().object_ids[e.object_index].as_str();
        let category = |e: &Estimate| e.category_index.map(|index| self.scene().categories[index].as_str());
        dict.set_item("object_ids", estimates.iter().map(name).collect::<Vec<_>>())?;
        dict.set_item("categories", estimates.iter().map(category).collect::<Vec<_>>())?;
        dict.set_item("status", estimates.iter().map(|e| e.status.name()).collect::<Vec<_>>())?;
        let warnings = |e: &Estimate| {
            let doubt = self.doubt(e).map(|doubt| format!("uncertain: {doubt}"));
            e.warnings.iter().map(ToString::to_string).chain(doubt).collect::<Vec<_>>()
        };
        dict.set_item("uncertain", estimates.iter().map(|e| self.doubt(e)).collect::<Vec<_>>())?;
        dict.set_item("warnings", estimates.iter().map(warnings).collect::<Vec<_>>())?;
        let coordinates = |e: &Estimate| e.covariance.map(|covariance| coordinates_name(covariance.coordinates));
        dict.set_item("covariance_coordinates", estimates.iter().map(coordinates).collect::<Vec<_>>())?;
        let body_kind = |e: &Estimate| e.body.as_ref().map(|body| body.kind.to_string());
        dict.set_item("kinds", estimates.iter().map(body_kind).collect::<Vec<_>>())?;
        let rows = |name: &str, width: usize, of: &dyn Fn(&Estimate, &mut Vec<f64>)| {
            let mut values = Vec::with_capacity(width * estimates.len());
            for (index, estimate) in estimates.iter().enumerate() {
                of(estimate, &mut values);
                // Missing values are NaN.
                values.resize(width * (index + 1), f64::NAN);
            }
            dict.set_item(name, PyArray1::from_vec(py, values))
        };
        rows("centers", 3, &|e, to| to.extend(e.center.iter().flat_map(|c| c.iter().copied())))?;
        rows("half_extents", 3, &|e, to| to.extend(e.body.iter().flat_map(|body| body.half_extents.iter().copied())))?;
        rows("half_extents_sd", 3, &|e, to| to.extend(e.half_extents_sd().iter().flat_map(|sd| sd.iter().copied())))?;
        let up = self.scene().up;
        rows("rotation_sd_deg", 2, &|e, to| {
            to.extend(e.rotation_sd(up.as_ref()).into_iter().flatten().map(f64::to_degrees));
        })?;
        rows("yaw_deg", 1, &|e, to| to.extend(e.body.zip(up).map(|(body, up)| yaw(&body, &up).to_degrees())))?;
        rows("bounds_centers", 3, &|e, to| to.extend(e.bounds.iter().flat_map(|b| b.center.iter().copied())))?;
        rows("bounds_half_extents", 3, &|e, to| {
            to.extend(e.bounds.iter().flat_map(|b| b.half_extents.iter().copied()))
        })?;
        rows("bounds_half_extents_sd", 3, &|e, to| {
            to.extend(e.bounds.and_then(|bounds| bounds.half_extents_sd).iter().flat_map(|sd| sd.iter().copied()));
        })?;
        rows("bounds_quaternions", 4, &|e, to| {
            to.extend(e.bounds.iter().flat_map(|b| quaternion_from_rotation(&b.rotation)));
        })?;
        rows("quaternions", 4, &|e, to| {
            to.extend(e.body.iter().flat_map(|b| quaternion_from_rotation(&b.rotation)));
        })?;
        rows("rotations", 9, &|e, to| {
            if let Some(body) = &e.body {
                // By rows; the library's matrices are by columns.
                to.extend(body.rotation.matrix().transpose().iter());
            }
        })?;
        rows("covariances", 81, &|e, to| {
            to.extend_from_slice(e.covariance.as_ref().map_or(&[], |c| c.matrix.as_slice()))
        })?;
        rows("center_sd", 1, &|e, to| to.extend(e.center_sd()))?;
        rows("normalized_residuals", 1, &|e, to| {
            to.extend(e.goodness_of_fit.map(|goodness_of_fit| goodness_of_fit.normalized_residual))
        })?;
        rows("relative_residuals", 1, &|e, to| {
            to.extend(e.goodness_of_fit.map(|goodness_of_fit| goodness_of_fit.relative_residual))
        })?;
        dict.set_item("alternatives", estimates.iter().map(alternatives).collect::<Vec<_>>())?;
        rows("residuals_px", 1, &|e, to| to.extend(e.rms_residual_px()))?;
        let checked = &self.localization().cross_validation;
        let of_object = |index| checked.of_estimate(index).filter(|_| checked.extent == Extent::All);
        let ious = (0..estimates.len()).map(|k| of_object(k).and_then(ObjectCrossValidation::iou).unwrap_or(f64::NAN));
        dict.set_item("predicted_ious", PyArray1::from_vec(py, ious.collect()))?;
        let odd = |k| Some(self.scene().frames.get(of_object(k)?.suspect_view()?.frame_index)?.id.as_str());
        dict.set_item("suspect_views", (0..estimates.len()).map(odd).collect::<Vec<_>>())?;
        let views: Vec<i64> = estimates.iter().map(|e| e.views_used() as i64).collect();
        dict.set_item("views_used", PyArray1::from_vec(py, views))?;
        self.set_detections(py, &dict)?;
        Ok(dict)
    }

    /// The camera of an image in the map that the estimates are, and the ids of the objects that it names by their positions.
    fn relocalize<'py>(&self, py: Python<'py>, query: LocateQuery) -> PyResult<(Bound<'py, PyDict>, Vec<&str>)> {
        let (ids, map, of_map) = self.map.get_or_init(|| self.landmarks()).as_ref().map_err(refuse)?;
        let rows: Vec<usize> = (0..ids.len()).collect();
        let (boxes, options) = (query.query()?, query.options(of_map.clone())?);
        let located = py.detach(|| map.relocalize(&boxes, &options));
        let ids = ids.iter().map(String::as_str).collect();
        Ok((location(py, &located, boxes.boxes.len(), &rows)?, ids))
    }

    /// The scene with the estimates as its objects: what the program writes.
    fn to_scene(&self) -> PyResult<PyScene> {
        let loaded = Loaded::of_result(self.file(), self.loaded.path.clone())?;
        Ok(PyScene { loaded: Arc::new(loaded) })
    }

    /// The page that shows the result.
    fn report(&self, title: &str, truth: Option<&PyScene>) -> PyResult<String> {
        let images = self.loaded.file().to_images(&self.loaded.path).map_err(refuse)?;
        let estimate = self.file();
        let truth = truth.map(|scene| &**scene.loaded.file());
        // Without objects in common there are none.
        let scores = truth.and_then(|truth| {
            let (estimate, truth) = ((Path::new("the estimate"), &estimate), (Path::new("the truth"), truth));
            evaluate_objects(estimate, truth, Matching::Auto).ok()
        });
        let scores = scores.map(|(evaluation, _)| Scores::of(&evaluation));
        let scene = self.scene();
        let (images, scores) = (Some(&images), scores.as_ref());
        let points = &estimate.points;
        let content = Content { title, scene, images, estimate: Some(&estimate), truth, source: None, points, scores };
        on_threads(|| report(&content))?.map_err(refuse).and_then(|report| page(&report).map_err(refuse))
    }

    /// Draws a frame.
    #[pyo3(signature = (frame, path, labels, source, truth))]
    fn render(
        &self,
        py: Python,
        frame: &str,
        path: PathBuf,
        labels: bool,
        source: Option<&str>,
        truth: Option<&PyScene>,
    ) -> PyResult<()> {
        let (estimate, truth) = (self.file(), truth.map(|scene| &**scene.loaded.file()));
        let drawing = Drawing { frame, output: &path, labels, source };
        py.detach(|| render(&self.loaded, self.scene(), (Some(&estimate), truth), &drawing))
    }

    /// What a recording holds, as JSON, and the indices of its frames.
    fn recording(&self, title: &str, truth: Option<&PyScene>) -> PyResult<(String, Vec<usize>)> {
        recorded(title, &self.loaded, self.scene(), &self.file(), truth.map(|scene| &**scene.loaded.file()))
    }

    /// The scene that was localized, as it was given.
    #[getter]
    fn given(&self) -> PyScene {
        PyScene { loaded: Arc::clone(&self.loaded) }
    }

    /// The record of the run as JSON.
    #[getter]
    fn record_json(&self) -> String {
        json!(self.run.record()).to_string()
    }

    /// What is wrong with the scene, in the words of Python.
    #[getter]
    fn problem(&self) -> Option<String> {
        let diagnosis = self.run.diagnosis();
        match self.run.input.memory {
            // Frames of a map are not corrected.
            Some(_) => diagnosis.of_map_in_words(),
            None => Some(in_python(&diagnosis.in_words()?, Correcting::Scene)),
        }
    }

    /// Whether the detections were associated.
    #[getter]
    fn associated(&self) -> bool {
        self.association().is_some()
    }

    #[getter]
    fn problems(&self) -> Vec<String> {
        self.run.input.problems.clone()
    }

    #[getter]
    fn seconds(&self) -> f64 {
        self.seconds
    }
}

impl PyLocalized {
    /// For each detection its object's place among the estimates, whether it was used, and its residual.
    fn set_detections(&self, py: Python, dict: &Bound<PyDict>) -> PyResult<()> {
        let mut place = vec![-1i64; self.scene().object_ids.len()];
        for (index, estimate) in self.localization().estimates.iter().enumerate() {
            place[estimate.object_index] = index as i64;
        }
        let detections = &self.scene().detections;
        let mut objects = Vec::with_capacity(detections.len());
        let mut inliers = Vec::with_capacity(detections.len());
        let mut residuals = Vec::with_capacity(detections.len());
        let mut rejections = Vec::with_capacity(detections.len());
        for detection in detections {
            let is_of_source = self.source.is_none() || detection.source_index == self.source;
            let object = detection.object_index.filter(|_| is_of_source).map(|index| index as usize);
            let row = object.map_or(-1, |object| place[object]);
            let estimate = usize::try_from(row).ok().and_then(|row| self.localization().estimates.get(row));
            // Views are in the order of their frames.
            let frame = detection.frame_index as usize;
            let view =
                estimate.and_then(|e| e.views.get(e.views.binary_search_by_key(&frame, |v| v.frame_index).ok()?));
            objects.push(row);
            inliers.push(view.is_some_and(|view| view.inlier));
            residuals.push(view.and_then(|view| view.residual_px).unwrap_or(f64::NAN));
            rejections.push(view.and_then(|view| view.rejection_reason).map(Rejection::name));
        }
        dict.set_item("object_indices", PyArray1::from_vec(py, objects))?;
        dict.set_item("inliers", PyArray1::from_vec(py, inliers))?;
        dict.set_item("rejection_reason", rejections)?;
        dict.set_item("detection_residuals_px", PyArray1::from_vec(py, residuals))
    }
}

/// Kind, center, half extents, quaternion and log odds of a body.
type AlternativeFigures = (String, [f64; 3], [f64; 3], [f64; 4], f64);

/// The other bodies that fit about as well.
fn alternatives(estimate: &Estimate) -> Vec<AlternativeFigures> {
    let figures = |Alternative { body, log_odds }: &Alternative| {
        let quaternion = quaternion_from_rotation(&body.rotation);
        (body.kind.to_string(), body.center.coords.into(), body.half_extents.into(), quaternion, *log_odds)
    };
    estimate.alternatives.iter().map(figures).collect()
}

/// Angle about `up` from the x axis of the world (from z, where x is steeper than 45 degrees) to the longer horizontal axis of a body,
/// counterclockwise seen from above, in (-pi/2, pi/2].
fn yaw(body: &Body, up: &Unit<Vector3<f64>>) -> f64 {
    let axes = body.rotation.matrix();
    let vertical = axes.tr_mul(up).iamax();
    let [a, b] = [(vertical + 1) % 3, (vertical + 2) % 3];
    let axis = axes.column(if body.half_extents[b] > body.half_extents[a] { b } else { a });
    let zero = if up.x * up.x < 0.5 { Vector3::x() } else { Vector3::z() };
    let angle = up.dot(&zero.cross(&axis)).atan2((zero - up.scale(up.dot(&zero))).dot(&axis));
    if angle > FRAC_PI_2 {
        angle - PI
    } else if angle <= -FRAC_PI_2 {
        angle + PI
    } else {
        angle
    }
}

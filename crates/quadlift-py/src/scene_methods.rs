//! Methods of a scene for Python: files, arrays, localization, association, scores and reports.

use std::path::{Path, PathBuf, absolute};
use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyBytes;
use quadlift::align::AlignStatus;
use quadlift::diagnosis::Correction;
use quadlift::run::Check;
use quadlift_io::SceneFile;
use quadlift_io::align::{ALIGNMENT, Contradiction, MapScale, align_checked, alignment_record, merge, options_of};
use quadlift_io::association::write_objects;
use quadlift_io::correct::assume::up as direction;
use quadlift_io::correct::{Assumption, RecordCorrection, correct};
use quadlift_io::diagnosis::DiagnosisRecord;
use quadlift_io::run::FileInput;
use quadlift_io::scene_file::{parse_scene_file, write_scene};
use quadlift_io::{read_scene_file, write_file, write_scene_file};
use quadlift_report::{Content, page, report};

use crate::association::{AssociateKeywords, associated};
use crate::detections::DetectionArrays;
use crate::error::{refuse, refuse_to_read};
use crate::evaluation::{MATCHING, scores};
use crate::formats::{self, AddKeywords, Given};
use crate::frames::FrameArrays;
use crate::loaded::Loaded;
use crate::localized::{PyLocalized, localized};
use crate::options::{LocalizeKeywords, assumed, choice};
use crate::recording::{jpeg, recorded};
use crate::render::{Drawing, render};
use crate::run::{Ticker, in_background, on_threads};
use crate::scene::PyScene;
use crate::segmentation::SegmentKeywords;

/// An associated object: its id, its evidence, and why it is uncertain.
type Found = (String, Option<f64>, Option<&'static str>);

/// Where the scale between two maps comes from.
const MAP_SCALES: [(&str, MapScale); 3] =
    [("auto", MapScale::OfUnits), ("rigid", MapScale::Rigid), ("estimated", MapScale::Estimated)];

#[pymethods]
impl PyScene {
    /// Reads a scene file; `assume` is what it really holds, as `--assume` has it.
    #[staticmethod]
    fn read(path: PathBuf, assume: &str) -> PyResult<Self> {
        scene_of(read_scene_file(&path).map_err(refuse_to_read)?, path, assume)
    }

    /// The scene in the bytes of a scene file.
    #[staticmethod]
    fn parse(bytes: &[u8], path: PathBuf, assume: &str) -> PyResult<Self> {
        scene_of(parse_scene_file("the document".as_ref(), bytes).map_err(refuse_to_read)?, path, assume)
    }

    /// What paths of images and masks are relative to: the file that was read, or nothing.
    #[getter]
    fn path(&self) -> PyResult<PathBuf> {
        let path = &self.loaded.path;
        if path.as_os_str().is_empty() { Ok(PathBuf::new()) } else { absolute(path).map_err(refuse) }
    }

    /// Posed frames without detections.
    #[staticmethod]
    fn from_frames(frames: FrameArrays) -> PyResult<Self> {
        Self::new(frames.to_file()?, PathBuf::new())
    }

    /// Cameras and poses in a file or folder of another program; and what was left out.
    #[staticmethod]
    #[pyo3(signature = (path, format, images, options))]
    fn read_cameras(
        path: PathBuf,
        format: Option<&str>,
        images: Option<PathBuf>,
        options: Given,
    ) -> PyResult<(Self, Vec<String>)> {
        let (loaded, lost) = formats::read_cameras(&path, format, images.as_deref(), &options)?;
        Ok((Self { loaded: Arc::new(loaded) }, lost))
    }

    /// The scene with these detections too; `orientation` is that of the pictures they were found in, as `--assume` has it.
    #[pyo3(signature = (detections, orientation))]
    fn with_detections(&self, detections: DetectionArrays, orientation: Option<&str>) -> PyResult<Self> {
        let Some(orientation) = orientation else {
            return Ok(Self { loaded: Arc::new(Loaded::with_detections(&self.loaded, detections)?) });
        };
        let corrections = turned_pictures(orientation)?;
        // Only the new detections are turned.
        let mut alone = SceneFile::clone(self.loaded.file());
        let mut kept = std::mem::take(&mut alone.detections);
        let alone = Arc::new(Loaded::new(alone, self.loaded.path.clone())?);
        let mut file = SceneFile::clone(Loaded::with_detections(&alone, detections)?.file());
        correct(&mut file, &corrections).map_err(refuse)?;
        kept.append(&mut file.detections);
        file.detections = kept;
        Self::new(file, self.loaded.path.clone())
    }

    /// All rows whose frame or measurements `with_detections` would reject, with reasons.
    fn detection_problems(&self, detections: DetectionArrays) -> Vec<(usize, String)> {
        detections.problems(&self.loaded.scene.frames)
    }

    /// The scene with the detections of another program's file too; and what was left out.
    #[pyo3(signature = (path, format, keywords, options))]
    fn with_detections_of(
        &self,
        path: PathBuf,
        format: Option<&str>,
        keywords: AddKeywords,
        options: Given,
    ) -> PyResult<(Self, Vec<String>)> {
        let file = SceneFile::clone(self.loaded.file());
        let (file, lost) = formats::with_detections(file, &path, format, &keywords, &options)?;
        Ok((Self::new(file, self.loaded.path.clone())?, lost))
    }

    /// Writes objects or cameras in a format of another program; what was converted, assumed and left out.
    fn export(&self, py: Python, format: &str, path: PathBuf, options: Given) -> PyResult<Vec<String>> {
        py.detach(|| formats::export(&self.loaded, format, &path, &options))
    }

    /// Draws a frame.
    #[pyo3(signature = (frame, path, labels, source))]
    fn render(&self, py: Python, frame: &str, path: PathBuf, labels: bool, source: Option<&str>) -> PyResult<()> {
        let file = &**self.loaded.file();
        let objects = if file.has_estimates() { (Some(file), None) } else { (None, Some(file)) };
        let drawing = Drawing { frame, output: &path, labels, source };
        py.detach(|| render(&self.loaded, &self.loaded.scene, objects, &drawing))
    }

    /// Writes a scene file. Paths of images and masks become absolute where the file goes to another folder.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        self.loaded.check_scene_output(&path)?;
        let here = folder(&self.loaded.path);
        let is_same = matches!((absolute(here), absolute(folder(&path))), (Ok(a), Ok(b)) if a == b);
        if is_same {
            return write_scene_file(&path, self.loaded.file()).map_err(refuse);
        }
        let mut file = SceneFile::clone(self.loaded.file());
        for place in file.paths_mut() {
            *place = absolute(here.join(&*place)).map_err(refuse)?.display().to_string();
        }
        write_scene_file(&path, &file).map_err(refuse)
    }

    /// Refuses to write a page or a recording over what the scene was read from.
    fn check_output(&self, path: PathBuf) -> PyResult<()> {
        self.loaded.check_output(&path)
    }

    /// The scene file as JSON.
    fn to_json(&self) -> PyResult<String> {
        let mut bytes = Vec::new();
        write_scene(self.loaded.file(), &mut bytes).map_err(refuse)?;
        String::from_utf8(bytes).map_err(refuse)
    }

    /// The scene with corrections, as `--assume`, `--up` and `--fix` have them.
    fn corrected(&self, py: Python, assume: &str, up: Option<&str>, fix: bool) -> PyResult<Self> {
        let mut corrections = assumed(assume)?;
        if let Some(text) = up {
            let up = direction(text).map_err(|error| refuse(format!("up is \"{text}\"; {error}")))?;
            corrections.push(RecordCorrection::Known(Correction::Up(up)));
        }
        let file = SceneFile::clone(self.loaded.file());
        let mut input = FileInput::from_file(file, &self.loaded.path, &corrections).map_err(refuse)?;
        if fix {
            py.detach(|| on_threads(|| Check::with_identities(&mut input, None, true)))?.map_err(refuse)?;
        }
        Self::new(SceneFile::clone(&input.file), self.loaded.path.clone())
    }

    /// The consistency check as JSON.
    fn diagnosis(&self, py: Python, source: Option<&str>) -> PyResult<String> {
        let scene = &self.loaded.scene;
        scene.source_index(source).map_err(|error| refuse(format!("{error} (source=...)")))?;
        let mut input = self.loaded.input();
        let check = py.detach(|| on_threads(|| Check::with_identities(&mut input, source, false)))?.map_err(refuse)?;
        let diagnosis = DiagnosisRecord::of(&check, &input.context);
        Ok(serde_json::json!(diagnosis).to_string())
    }

    /// Localizes the objects.
    fn localize(
        &self,
        py: Python,
        keywords: LocalizeKeywords,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<PyLocalized> {
        let (options, loaded) = (keywords.options()?, Arc::clone(&self.loaded));
        let input = loaded.input();
        in_background(py, threads, progress, move |ticker| localized(loaded, input, &options, ticker))
    }

    /// Finds masks and ellipses in the images; the scene with them, and what went wrong.
    fn segment(
        &self,
        py: Python,
        keywords: SegmentKeywords,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<String>)> {
        let settings = keywords.settings()?;
        let loaded = Arc::clone(&self.loaded);
        let work = move |ticker: &Ticker| keywords.segmented(&settings, &loaded, ticker);
        let (file, problems) = in_background(py, threads, progress, work)?;
        Ok((Self::new(file, self.loaded.path.clone())?, problems))
    }

    /// Finds out which detections show the same object; the scene with these objects, and them.
    fn associate(
        &self,
        py: Python,
        keywords: AssociateKeywords,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<Found>)> {
        let options = keywords.for_scene(&self.loaded.scene)?;
        let loaded = Arc::clone(&self.loaded);
        let (scene, association) =
            in_background(py, threads, progress, move |ticker| associated(&loaded, &options, ticker))?;
        let mut file = SceneFile::clone(self.loaded.file());
        write_objects(&mut file.detections, &scene);
        // The true objects, if the scene has any, have other ids.
        file.objects = Vec::new();
        let objects = association.objects.into_iter();
        let objects = objects.map(|o| (o.id, o.evidence, o.uncertain.map(|doubt| doubt.text()))).collect();
        Ok((Self::new(file, self.loaded.path.clone())?, objects))
    }

    /// Scores of the objects and of the identities against the truth, as JSON.
    #[pyo3(signature = (truth, matching, source))]
    fn evaluate(&self, py: Python, truth: &Self, matching: &str, source: Option<&str>) -> PyResult<String> {
        let (estimate, truth) = (&self.loaded, &truth.loaded);
        let matching = choice("match", matching, &MATCHING)?;
        py.detach(|| on_threads(|| scores(estimate.file(), truth.file(), matching, source)))?
            .map(|scores| scores.to_string())
            .map_err(refuse)
    }

    /// Where another map lies in this one, as JSON, and both as one map where that can be trusted.
    #[pyo3(signature = (other, scale, up_sd))]
    fn align(&self, py: Python, other: &Self, scale: &str, up_sd: Option<f64>) -> PyResult<(String, Option<Self>)> {
        let (a, b) = (self.loaded.file(), other.loaded.file());
        let scale = choice("scale", scale, &MAP_SCALES)?;
        let maps = (a.to_map_objects().map_err(refuse)?, b.to_map_objects().map_err(refuse)?);
        let options = options_of(a, b, scale, up_sd);
        let (found, contradiction) = py.detach(|| on_threads(|| align_checked(&maps.0, &maps.1, &options)))?;
        let mut record = alignment_record(&found, [&maps.0, &maps.1]);
        record["contradiction"] = match contradiction {
            None => serde_json::Value::Null,
            Some(Contradiction::Scale { .. }) => "scale".into(),
            Some(Contradiction::Up) => "up".into(),
            Some(Contradiction::Mirrored) => "mirrored".into(),
        };
        let (AlignStatus::Ok, Some(best)) = (found.status, found.transforms.first()) else {
            return Ok((record.to_string(), None));
        };
        let mut moved = SceneFile::clone(b);
        let folder = |path: &Path| path.parent().map(Path::to_owned).unwrap_or_default();
        moved.move_paths([&folder(&other.loaded.path), &folder(&self.loaded.path)]).map_err(refuse)?;
        let mut merged = merge(a, &moved, [&maps.0, &maps.1], best).map_err(refuse)?.file;
        merged.extra.insert(ALIGNMENT.to_owned(), record.clone());
        let loaded = Loaded::of_result(merged, self.loaded.path.clone())?;
        Ok((record.to_string(), Some(Self { loaded: Arc::new(loaded) })))
    }

    /// The page that shows the scene.
    fn report(&self, title: &str) -> PyResult<String> {
        let Loaded { scene, path, .. } = &*self.loaded;
        let file = self.loaded.file();
        let images = file.to_images(path).map_err(refuse)?;
        let content = Content {
            title,
            scene,
            images: Some(&images),
            estimate: Some(file),
            truth: None,
            source: None,
            points: &file.points,
            scores: None,
        };
        on_threads(|| report(&content))?.map_err(refuse).and_then(|report| page(&report).map_err(refuse))
    }

    /// What a recording holds, as JSON, and the indices of its frames.
    fn recording(&self, title: &str) -> PyResult<(String, Vec<usize>)> {
        recorded(title, &self.loaded, &self.loaded.scene, self.loaded.file(), None)
    }

    /// The image of a frame as JPEG, and its width and height.
    fn jpeg<'py>(&self, py: Python<'py>, frame_index: usize) -> PyResult<Option<(Bound<'py, PyBytes>, [u32; 2])>> {
        let image = py.detach(|| jpeg(&self.loaded, frame_index))?;
        Ok(image.map(|(bytes, size)| (PyBytes::new(py, &bytes), size)))
    }

    #[getter]
    fn name(&self) -> Option<&str> {
        self.loaded.file().name.as_deref()
    }

    #[getter]
    fn length_unit(&self) -> Option<&str> {
        self.loaded.file().length_unit.as_deref()
    }

    #[getter]
    fn frame_ids(&self) -> Vec<&str> {
        self.loaded.scene.frames.iter().map(|frame| frame.id.as_str()).collect()
    }

    /// Ids of the objects that the detections name.
    #[getter]
    fn object_ids(&self) -> Vec<&str> {
        self.loaded.scene.object_ids.iter().map(String::as_str).collect()
    }

    /// Number of detections.
    fn __len__(&self) -> usize {
        self.loaded.scene.detections.len()
    }

    /// Number of objects in the file: true ones or estimates.
    #[getter]
    fn object_count(&self) -> usize {
        self.loaded.file().objects.len()
    }
}

/// The cameras that `from_frames` would refuse, and why.
#[pyfunction]
pub(crate) fn frame_problems(frames: FrameArrays) -> Vec<(usize, String)> {
    frames.problems().collect()
}

/// Writes a text.
#[pyfunction]
pub(crate) fn write_text(path: PathBuf, text: &str) -> PyResult<()> {
    write_file(&path, |file| file.write_all(text.as_bytes())).map_err(refuse)
}

/// The correction of boxes in pictures with an EXIF orientation, such as `6` or `6-fractions`; none for 1.
fn turned_pictures(orientation: &str) -> PyResult<Vec<RecordCorrection>> {
    let corrections = format!("orientation={orientation}").parse().and_then(|one| Assumption::corrections(&[one]));
    corrections.map_err(|error| refuse(format!("orientation is \"{orientation}\"; {error}")))
}

/// The scene of a file that really holds what `assume` says.
fn scene_of(mut file: SceneFile, path: PathBuf, assume: &str) -> PyResult<PyScene> {
    correct(&mut file, &assumed(assume)?).map_err(refuse)?;
    PyScene::new(file, path)
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

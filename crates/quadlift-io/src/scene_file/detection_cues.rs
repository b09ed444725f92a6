//! The cues of a detection in a scene file: what files do with them, for every kind of cue.

use nalgebra::{Matrix3, Vector3};
use quadlift::geometry::CamFromWorld;
use quadlift::scene::{Cues, DepthCue, SceneError};

use super::cue_records::{Box3dRecord, DepthRecord};
use super::frame_pose::pose_of;
use super::records::{DetectionRecord, FrameRecord};
use crate::error::EntryError;

impl DetectionRecord {
    /// The names of the cues, and their sources.
    pub(crate) fn cue_sources_mut(&mut self) -> impl Iterator<Item = (&'static str, &mut Option<Box<str>>)> {
        let depth = self.depth.as_deref_mut().map(|depth| ("depth", &mut depth.source));
        depth.into_iter().chain(self.box3d.as_deref_mut().map(|box3d| ("box3d", &mut box3d.source)))
    }

    /// Moves the cues with a world whose points `x` become `linear x + origin`; `linear` is a rotation or a mirror, times a factor.
    pub(crate) fn move_cues(&mut self, linear: &Matrix3<f64>, origin: &Vector3<f64>) {
        self.depth.iter_mut().for_each(|depth| depth.scale(linear.determinant().abs().cbrt()));
        self.box3d.iter_mut().for_each(|box3d| box3d.move_by(linear, origin));
    }

    /// The record with these cues; `source` names their sources.
    pub(super) fn with_cues(self, cues: &Cues, source: impl Fn(Option<u32>) -> Option<Box<str>>) -> Self {
        Self {
            depth: cues.depth.map(|depth| Box::new(DepthRecord::of(&depth, source(depth.source)))),
            box3d: cues.box3d.map(|box3d| Box::new(Box3dRecord::of(&box3d, source(box3d.source)))),
            ..self
        }
    }

    /// The cues, checked; `source_of` gives the index of a source, `pose` is that of the frame.
    ///
    /// # Errors
    /// [`EntryError`] names the first field that is out of range; `entry` makes a place of the name of the field.
    pub fn cues(
        &self,
        mut source_of: impl FnMut(&str) -> Result<u32, SceneError>,
        pose: impl Fn() -> Option<CamFromWorld>,
        entry: impl Fn(&str) -> String,
    ) -> Result<Cues, EntryError> {
        let mut source = |name: &Option<Box<str>>, field: &str| {
            let index = name.as_deref().map(&mut source_of).transpose();
            index.map_err(|error| EntryError::new(entry(field), error))
        };
        let mut cues = Cues::default();
        if let Some(depth) = self.depth.as_deref() {
            let source = source(&depth.source, ".depth.source")?;
            cues.depth = Some(DepthCue { median: depth.median, sd: depth.sd, source });
            cues.check().map_err(|error| EntryError::new(entry(".depth"), error))?;
        }
        if let Some(record) = self.box3d.as_deref() {
            let source = source(&record.source, ".box3d.source")?;
            let box3d = record.cue(source, pose, |field| entry(&format!(".box3d{field}")))?;
            Cues { box3d: Some(box3d), ..Cues::default() }
                .check()
                .map_err(|error| EntryError::new(entry(".box3d"), error))?;
            cues.box3d = Some(box3d);
        }
        Ok(cues)
    }
}

impl Box3dRecord {
    /// Whether it is a valid box in front of the camera of a frame.
    pub(crate) fn is_in_front_of(&self, frame: &FrameRecord) -> bool {
        let cue = self.cue(None, || pose_of(frame), str::to_owned);
        cue.is_ok_and(|box3d| Cues { box3d: Some(box3d), ..Cues::default() }.check().is_ok())
    }
}

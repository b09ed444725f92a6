//! What is written of the map: the result file, the state, the report.

use std::path::Path;

use anyhow::Context;
use quadlift::Localization;
use quadlift::online::ObjectMap;
use quadlift_io::scene_file::{Detail, SceneFile};
use quadlift_io::stream::{MapMemory, StreamState, StreamedScene, write_state_file};
use quadlift_io::write_scene_file;
use serde_json::{Map, Value};

use crate::localization::{Settings, localize_scene, result_file};
use crate::output::Output;
use crate::report::write_localized;

/// The files that are written, and what they depend on.
pub struct MapFiles<'a> {
    /// The result file.
    pub map: Option<&'a Path>,
    /// The state.
    pub state: Option<&'a Path>,
    /// The page.
    pub report: Option<&'a Path>,
    /// The input, to which the paths of images are relative.
    pub input: &'a Path,
    /// What the result file says of each object.
    pub detail: Detail,
    /// How objects are estimated.
    pub settings: &'a Settings,
    /// Options that a state goes on with.
    pub lasting: &'a Map<String, Value>,
}

impl MapFiles<'_> {
    /// Whether anything is written before the end.
    pub fn any_on_the_way(&self) -> bool {
        self.map.is_some() || self.state.is_some()
    }

    /// Writes map and state on the way. The state goes on without what happens at the end of a stream, so that it does not
    /// matter how often it was written.
    pub fn write(&self, stream: &StreamState, out: &Output) -> anyhow::Result<()> {
        if self.map.is_some() {
            let mut settled = stream.map.clone();
            settled.settle();
            self.write_map(&settled, &stream.scene, None, out)?;
        }
        self.write_state(stream)
    }

    /// Writes map, state and report at the end; `settled` is the settled map.
    pub fn write_at_end(&self, stream: &StreamState, settled: &ObjectMap, out: &Output) -> anyhow::Result<()> {
        if self.map.is_some() || self.report.is_some() {
            self.write_map(settled, &stream.scene, self.report, out)?;
        }
        self.write_state(stream)
    }

    fn write_state(&self, stream: &StreamState) -> anyhow::Result<()> {
        if let Some(path) = self.state {
            write_state_file(path, stream, self.lasting)?;
        }
        Ok(())
    }

    fn write_map(
        &self,
        map: &ObjectMap,
        streamed: &StreamedScene,
        report: Option<&Path>,
        out: &Output,
    ) -> anyhow::Result<()> {
        let file = streamed.to_file(map);
        let averaged = streamed.to_averaged_file(map);
        let scene = averaged.to_scene().map_err(|error| error.in_file(self.input))?;
        let localization = if scene.detections.is_empty() {
            Localization::default()
        } else {
            // No bar: the stream goes on.
            localize_scene("map", &scene, self.settings, &Output { quiet: true, ..*out }).context("map")?
        };
        let mut result = result_file(&file, &scene, &localization, self.settings);
        MapMemory::of(map).add_to(&mut result, &file);
        if let Some(path) = self.map {
            self.write_result(path, &result)?;
        }
        if let Some(path) = report {
            let images = file.to_images(self.input).map_err(|error| error.in_file(self.input))?;
            write_localized(path, (self.input, &file), &images, &scene, &result)?;
        }
        Ok(())
    }

    fn write_result(&self, path: &Path, result: &SceneFile) -> anyhow::Result<()> {
        if self.detail == Detail::Full {
            return Ok(write_scene_file(path, result)?);
        }
        // The page shows everything.
        let mut brief = result.clone();
        brief.objects.iter_mut().for_each(|object| self.detail.apply(object));
        Ok(write_scene_file(path, &brief)?)
    }
}

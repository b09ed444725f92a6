//! What is written of the map: the result file, the state, the report.

use std::path::Path;
use std::sync::Arc;

use quadlift::online::ObjectMap;
use quadlift::run::{Check, Input};
use quadlift_io::run::{FileInput, FileOptions};
use quadlift_io::scene_file::Detail;
use quadlift_io::stream::{StreamState, StreamedScene, write_state};
use quadlift_io::write_file;
use serde_json::{Map, Value};

use crate::files::move_paths;
use crate::localization::run_scene;
use crate::output::Output;
use crate::report::write_localized;

/// The files that are written, and what they depend on.
pub(super) struct MapFiles<'a> {
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
    pub options: &'a FileOptions,
    /// Options that a state goes on with.
    pub lasting: &'a Map<String, Value>,
}

impl MapFiles<'_> {
    /// Whether anything is written before the end.
    pub(super) fn any_on_the_way(&self) -> bool {
        self.map.is_some() || self.state.is_some()
    }

    /// Writes map and state on the way. The state goes on without what happens at the end of a stream, so that it does not
    /// matter how often it was written.
    pub(super) fn write(&self, stream: &StreamState, out: &Output) -> anyhow::Result<()> {
        if self.map.is_some() {
            let mut settled = stream.map.clone();
            settled.settle();
            self.write_map(&settled, &stream.scene, None, out)?;
        }
        self.write_state(stream)
    }

    /// Writes map, state and report at the end; `settled` is the settled map.
    ///
    /// Returns the consistency check of the objects, or that of their boxes if nothing is written.
    pub(super) fn write_at_end(
        &self,
        stream: &StreamState,
        settled: &ObjectMap,
        out: &Output,
    ) -> anyhow::Result<Check> {
        let check = match self.map.is_some() || self.report.is_some() {
            true => self.write_map(settled, &stream.scene, self.report, out)?,
            false => {
                let mut input = FileInput::of_map(&stream.scene, settled, self.input)?;
                Check::of(&mut input, None, false)?.with_known(input.known())
            }
        };
        self.write_state(stream)?;
        Ok(check)
    }

    fn write_state(&self, stream: &StreamState) -> anyhow::Result<()> {
        if let Some(path) = self.state {
            write_file(path, |out| write_state(out, stream, self.lasting))?;
        }
        Ok(())
    }

    fn write_map(
        &self,
        map: &ObjectMap,
        streamed: &StreamedScene,
        report: Option<&Path>,
        out: &Output,
    ) -> anyhow::Result<Check> {
        let input = FileInput::of_map(streamed, map, self.input)?;
        // No bar: the stream goes on.
        let mut run = run_scene("map", input, self.options, &Output { quiet: true, ..*out })?;
        let images =
            report.map(|_| run.input.file.to_images(&run.input.path).map_err(|error| error.in_file(&run.input.path)));
        let images = images.transpose()?;
        let input = run.input.path.clone();
        self.map.map_or(Ok(()), |map| move_paths(Arc::make_mut(&mut run.input.file), &input, map))?;
        let result = report.map(|_| run.result());
        if let Some(path) = self.map {
            run.write(path, self.detail, result.as_ref())?;
        }
        if let (Some(path), Some(result), Some(images)) = (report, &result, &images) {
            write_localized(path, (&run.input.path, &run.input.file), images, run.input.scene(), result, out)?;
        }
        Ok(run.run.check)
    }
}

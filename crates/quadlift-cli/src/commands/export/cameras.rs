//! Cameras of a scene, as given or refined: a trajectory, a COLMAP model.

use std::path::{Path, PathBuf};

use anyhow::Context;
use quadlift_io::read_scene_file;
use quadlift_io::write::cameras::{self, COLMAP_FILES};

use super::{Common, finish};
use crate::error::Outcome;
use crate::files::{check_file, refuse_to_overwrite};
use crate::output::Output;

pub fn tum(common: &Common, camera: Option<&str>, out: &Output) -> anyhow::Result<Outcome> {
    let Common { scene, output } = common;
    check_file(output)?;
    refuse_to_overwrite(scene, output)?;
    let document = cameras::tum(&read_scene_file(scene)?, camera).map_err(|error| error.in_file(scene))?;
    finish(out, &[document], &[output], &[])
}

/// Writes the three files of a model into a folder, which is made if it is missing.
pub fn colmap(common: &Common, out: &Output) -> anyhow::Result<Outcome> {
    let Common { scene, output } = common;
    let documents = cameras::colmap_model(&read_scene_file(scene)?).map_err(|error| error.in_file(scene))?;
    std::fs::create_dir_all(output).with_context(|| format!("{}: the folder cannot be made", output.display()))?;
    let paths = COLMAP_FILES.map(|name| output.join(name));
    for path in &paths {
        check_file(path)?;
        refuse_to_overwrite(scene, path)?;
    }
    finish(out, &documents, &paths.each_ref().map(PathBuf::as_path) as &[&Path], &[])
}

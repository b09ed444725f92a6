//! Input and output files: patterns and folders are expanded, outputs are checked before long work starts.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use glob::{MatchOptions, Pattern};
use quadlift::scene::Scene;
use quadlift_io::formats::{find_cameras, find_detections};
use quadlift_io::guard::{common_file, is_same_file};
use quadlift_io::mcap::is_mcap;
use quadlift_io::read::UNREAD;
use quadlift_io::{ReadError, SceneFile, is_standard_output, read_scene_file};

use crate::error::{UsageError, usage};

/// Reads a scene file and checks it.
pub(crate) fn read_scene(path: &Path) -> anyhow::Result<(SceneFile, Scene)> {
    let file = read_scene_file(path).map_err(|error| with_hint(path, error))?;
    let scene = file.to_scene().map_err(|error| error.in_file(path))?;
    Ok((file, scene))
}

/// The error, with a hint for paths with cameras or detections of another program.
pub(crate) fn with_hint(path: &Path, mut error: ReadError) -> ReadError {
    if let Some(hint) = other_format(path) {
        error.problem.push_str(&format!("; {hint}"));
    }
    error
}

/// The hint for a path with cameras or detections of another program instead of a scene file.
fn other_format(path: &Path) -> Option<String> {
    let shown = path.display();
    if is_mcap(path) {
        return Some(format!("it is a log in MCAP: `quadlift import mcap {shown} -o scene.json` converts it"));
    }
    match find_cameras(path).map(|(format, _)| format.name) {
        Ok("scene file") => return None,
        Err(_) => {}
        Ok(name) => {
            return Some(format!(
                "it holds cameras ({name}): `quadlift localize --cameras {shown} --detections PATH` reads them"
            ));
        }
    }
    match find_detections(path) {
        Ok(format) => Some(format!(
            "it holds detections ({}): `quadlift localize --cameras PATH --detections {shown}` reads them",
            format.name
        )),
        Err(error) => error.problem.starts_with(UNREAD).then_some(error.problem),
    }
}

/// The scene files that the arguments name.
#[derive(Debug)]
pub(crate) struct Inputs {
    /// The files, in the order of the arguments; those of a folder or pattern are sorted.
    pub paths: Vec<PathBuf>,
    /// Whether there are several, or could have been (a folder, a pattern).
    pub several: bool,
}

/// Expands folders (their `*.json` files) and patterns that the shell has left alone.
pub(crate) fn expand(arguments: &[PathBuf]) -> anyhow::Result<Inputs> {
    let mut inputs = Inputs { paths: Vec::new(), several: arguments.len() > 1 };
    for argument in arguments {
        if argument.is_dir() {
            inputs.several = true;
            inputs.paths.extend(scenes_in_folder(argument)?);
        } else if let Some(pattern) =
            argument.to_str().filter(|text| !argument.exists() && text.contains(['*', '?', '[']))
        {
            inputs.several = true;
            inputs.paths.extend(matches(pattern)?);
        } else {
            inputs.paths.push(argument.clone());
        }
    }
    Ok(inputs)
}

fn scenes_in_folder(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let failed = || format!("cannot read the folder {}", folder.display());
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        if path.is_file() && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
            paths.push(path);
        }
    }
    if paths.is_empty() {
        let hint = other_format(folder).map_or(String::new(), |hint| format!("; {hint}"));
        bail!("there is no .json file in the folder {}{hint}", folder.display());
    }
    paths.sort();
    Ok(paths)
}

fn matches(pattern: &str) -> anyhow::Result<Vec<PathBuf>> {
    let wrong =
        |error: glob::PatternError| UsageError(format!("\"{pattern}\" is not a pattern of file names: {error}"));
    let mut paths = if pattern.contains("**") {
        recursive_matches(pattern, &Pattern::new(pattern).map_err(wrong)?)?
    } else {
        let found = glob::glob(pattern).map_err(wrong)?;
        found.collect::<Result<Vec<_>, _>>().with_context(|| format!("cannot search for {pattern}"))?
    };
    paths.retain(|path| path.is_file());
    if paths.is_empty() {
        bail!("no file matches {pattern}");
    }
    paths.sort();
    Ok(paths)
}

/// The files below a folder that match a pattern with `**`. Links to folders are not followed: they may lead in circles.
fn recursive_matches(text: &str, pattern: &Pattern) -> anyhow::Result<Vec<PathBuf>> {
    // The part before the first component with a wildcard.
    let plain = &text[..text.find(['*', '?', '[']).unwrap_or(text.len())];
    let start = plain.rfind(std::path::is_separator).map_or("", |end| &plain[..=end]);
    let options = MatchOptions { require_literal_separator: true, ..MatchOptions::new() };
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::from(start)];
    while let Some(folder) = folders.pop() {
        let here = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        let failed = || format!("cannot read the folder {}", here.display());
        for entry in std::fs::read_dir(here).with_context(failed)? {
            let entry = entry.with_context(failed)?;
            let path = folder.join(entry.file_name());
            if entry.file_type().with_context(failed)?.is_dir() {
                folders.push(path);
            } else if pattern.matches_path_with(&path, options) {
                found.push(path);
            }
        }
    }
    Ok(found)
}

/// The results' paths, one per input, checked before anything is computed: the folder exists (of several scenes it is
/// made), no input is overwritten and no two results have one name.
pub(crate) fn outputs(inputs: &Inputs, output: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !inputs.several {
        check_file(output)?;
        if let [input] = inputs.paths.as_slice() {
            refuse_to_overwrite(input, output)?;
        }
        return Ok(vec![output.to_owned()]);
    }
    if output.exists() && !output.is_dir() || is_standard_output(output) {
        bail!("cannot write {}: it is a file; several scenes need a folder", output.display());
    }
    check_parent(output)?;
    let mut paths: Vec<PathBuf> = Vec::with_capacity(inputs.paths.len());
    for input in &inputs.paths {
        let name = input.file_name().ok_or_else(|| anyhow!("{} has no file name", input.display()))?;
        // The result of a log is no log.
        let path = match output.join(name) {
            path if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("mcap")) => path.with_extension("json"),
            path => path,
        };
        if paths.contains(&path) {
            return usage(format!(
                "two scenes have the file name {}: one result would overwrite the other",
                name.display()
            ));
        }
        paths.push(path);
    }
    // Not each its own alone: links make one file of several paths.
    if let Some((input, _)) = common_file(&inputs.paths, &paths) {
        return usage(format!("the result would overwrite the scene {}", input.display()));
    }
    make_folder(output)?;
    Ok(paths)
}

/// Refuses a name that promises another format than that of scene files, which are JSON. `with_objects`: the result has
/// objects, which `quadlift export` can write in other formats.
pub(crate) fn check_result_name(output: &Path, with_objects: bool) -> anyhow::Result<()> {
    let Some(extension) = output.extension().map(|extension| extension.to_string_lossy().to_lowercase()) else {
        return Ok(());
    };
    let json = output.with_extension("json");
    let (json, output) = (json.display(), output.display());
    match extension.as_str() {
        "json" => Ok(()),
        "ply" | "glb" | "gltf" | "obj" | "stl" | "csv" | "parquet" | "rrd" | "txt" | "yaml" if !with_objects => {
            usage(format!("the result is a scene file in JSON: write it with -o {json}"))
        }
        "html" | "htm" => usage(format!("the result is a JSON file, not a page: -o {json} --report {output}")),
        "ply" | "glb" | "csv" | "rrd" => {
            let format = if extension == "rrd" { "rerun" } else { &extension };
            usage(format!(
                "the result is a JSON file: write it with -o {json}, then `quadlift export {format} {json} -o {output}`"
            ))
        }
        "gltf" | "obj" | "stl" | "parquet" | "txt" | "yaml" | "yml" | "xml" | "pcd" | "png" | "jpg" => usage(format!(
            "the result is a JSON file: write it with -o {json}; `quadlift export` converts it to ply, glb, csv and \
             other formats"
        )),
        _ => Ok(()),
    }
}

/// Refuses a file that cannot be written because its folder does not exist or because it is a folder itself.
pub(crate) fn check_file(path: &Path) -> anyhow::Result<()> {
    if path.is_dir() {
        bail!("cannot write {}: it is a folder; expected the name of a file", path.display());
    }
    check_parent(path)
}

/// Makes a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| format!("cannot make the folder {}", path.display()))
}

fn check_parent(path: &Path) -> anyhow::Result<()> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            bail!("cannot write {}: the folder {} does not exist", path.display(), folder.display())
        }
        _ => Ok(()),
    }
}

/// Moves the paths of images, depth images, point clouds and masks of a file that was read from one path and is written to
/// another one.
pub(crate) fn move_paths(file: &mut SceneFile, from: &Path, to: &Path) -> anyhow::Result<()> {
    let folder = |path: &Path| path.parent().map(Path::to_owned).unwrap_or_default();
    let folders = [folder(from), if is_standard_output(to) { PathBuf::new() } else { folder(to) }];
    Ok(file.move_paths([&folders[0], &folders[1]])?)
}

/// Refuses an output that is the scene itself.
pub(crate) fn refuse_to_overwrite(input: &Path, output: &Path) -> anyhow::Result<()> {
    if is_same_file(input, output) {
        return usage(format!("the result would overwrite the scene {}", input.display()));
    }
    Ok(())
}

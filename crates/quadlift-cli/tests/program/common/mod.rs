//! What the end-to-end tests share: a temporary folder in which the built program runs.

pub(crate) mod mistakes;
#[path = "../../../../quadlift-io/src/test_data.rs"]
mod test_data;

use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

/// A temporary folder; the program runs in it, so that messages hold short names.
pub(crate) struct Folder(TempDir);

/// What a run has printed.
pub(crate) struct Run {
    pub code: i32,
    pub stdout: String,
    pub stderr: String,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    /// Copies the files of a folder and of those in it.
    pub(crate) fn copy(&self, from: &Path) {
        let mut folders = vec![from.to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(&folder).unwrap().map(Result::unwrap) {
                let path = entry.path();
                if path.is_dir() {
                    folders.push(path);
                } else {
                    let name = path.strip_prefix(from).unwrap().to_str().unwrap();
                    self.write(name, std::fs::read(&path).unwrap());
                }
            }
        }
    }

    pub(crate) fn write_json(&self, name: &str, value: &Value) {
        self.write(name, serde_json::to_string_pretty(value).unwrap());
    }

    pub(crate) fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub(crate) fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    /// Names of the files and folders in it.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Runs the program with arguments separated by blanks.
    pub(crate) fn run(&self, arguments: &str) -> Run {
        self.run_list(&arguments.split_whitespace().collect::<Vec<_>>())
    }

    pub(crate) fn run_list(&self, arguments: &[&str]) -> Run {
        let output = self.command().args(arguments).output().unwrap();
        Run::from(output)
    }

    pub(crate) fn command(&self) -> Command {
        let mut command = Command::cargo_bin("quadlift").unwrap();
        command.current_dir(self.0.path()).env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        command
    }

    /// Runs the program, which must succeed; gives its standard output.
    pub(crate) fn succeed(&self, arguments: &str) -> String {
        let run = self.run(arguments);
        assert_eq!(run.code, 0, "quadlift {arguments}\n{}{}", run.stdout, run.stderr);
        run.stdout
    }

    /// Writes the first frames, at most eight, of the rendered scene of the fixtures: PNG images of 240 x 180 pixels and true
    /// masks of two objects, each seen in every frame.
    pub(crate) fn rendered_scene(&self, name: &str, frames: usize) {
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/rendered");
        let mut scene: Value = serde_json::from_slice(&std::fs::read(fixture.join("scene.json")).unwrap()).unwrap();
        scene["frames"].as_array_mut().unwrap().truncate(frames);
        scene["detections"].as_array_mut().unwrap().truncate(2 * frames);
        let folder = self.path(name).parent().unwrap().to_owned();
        for inner in ["images", "masks"] {
            std::fs::create_dir_all(folder.join(inner)).unwrap();
        }
        for frame in scene["frames"].as_array_mut().unwrap() {
            let id = frame["id"].as_str().unwrap();
            let [image, mask] = ["images", "masks"].map(|inner| format!("{inner}/{id}.png"));
            std::fs::copy(fixture.join(&mask), folder.join(&mask)).unwrap();
            let photo = image::open(fixture.join(frame["image"].as_str().unwrap())).unwrap();
            photo.save(folder.join(&image)).unwrap();
            frame["image"] = image.into();
        }
        self.write_json(name, &scene);
    }

    /// A small synthetic scene without its truth.
    pub(crate) fn small_scene(&self) -> Value {
        self.succeed("synth -o .small.json --objects 2 --views 6 --seed 1 --noise box:0.02");
        let mut scene = self.json(".small.json");
        std::fs::remove_file(self.path(".small.json")).unwrap();
        scene.as_object_mut().unwrap().remove("objects");
        scene
    }
}

impl From<Output> for Run {
    fn from(output: Output) -> Self {
        // Commands that are printed name the program as it was called.
        let own = assert_cmd::cargo::cargo_bin("quadlift").display().to_string();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap().replace(&own, "quadlift");
        let run =
            Self { code: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) };
        for text in [&run.stdout, &run.stderr] {
            assert!(!text.contains("panicked") && !text.contains("RUST_BACKTRACE"), "{text}");
            assert!(!text.contains('\u{1b}'), "colors without a terminal: {text:?}");
        }
        run
    }
}

/// The folder of real scenes, if it is there.
pub(crate) fn real_scenes() -> Option<PathBuf> {
    std::fs::canonicalize(test_data::real_data("scenes")?).ok()
}

//! Commands on all pages. In "```sh" those of the program are run (`documentation.rs`). In indented blocks, which hold nothing
//! but commands, files are the reader's: of the program's commands the options are checked, and [`OTHERS`] has who runs the
//! others, or why nobody does. Names of benches and experiments, files and extras are those that exist.

use std::collections::BTreeSet;

use crate::common::Folder;
use crate::documentation::{pages, workspace};

/// Who runs a command.
enum Run {
    /// This file, which contains this text.
    By(&'static str, &'static str),
    /// Nobody, for this reason.
    Not(&'static str),
}
use Run::{By, Not};

/// How commands of other programs begin.
const OTHERS: &[(&str, Run)] = &[
    (".ci/release", By(".github/workflows/release.yml", ".ci/release")),
    (".ci/run", Not("it runs the tests")),
    (
        "cargo bench -p quadlift-bench --features timings",
        By(".ci/run", "--all-targets --features quadlift-bench/timings"),
    ),
    ("cargo doc", By(".ci/run", "cargo doc --workspace --no-deps")),
    ("cargo install --locked --path crates/quadlift-cli", By("scripts/test_package.sh", "cargo package")),
    ("cargo install --locked quadlift-cli", Not("true after the first release")),
    ("cargo install --path crates/quadlift-ros2", By("scripts/test_ros2.sh", "cargo test")),
    ("cargo run --release -p quadlift-bench", By("scripts/test_bench.sh", "--test figures --test commands")),
    ("cargo run --release -p quadlift-cli -- demo", By("scripts/test_bench.sh", "cargo build \"${packages[@]}\"")),
    ("docker build", By(".github/workflows/release.yml", "docker build -t quadlift -f packaging/Dockerfile .")),
    ("pip install .", By("scripts/test_wheels.sh", "-m pip install")),
    ("pip install \".[", Not("packages of others; scripts/test_python.sh installs those that the tests use")),
    ("pip install rerun-sdk", By("scripts/test_rerun.sh", "-m pip install --quiet \"rerun-sdk")),
    ("pip install rosbags", By("scripts/test_exports.sh", "-r scripts/check_exports_requirements.txt")),
    ("python3 examples/ros2/yolo_to_vision_msgs.py", By("scripts/test_ros2.sh", "examples/ros2/test_ros2.py")),
    ("python3 examples/to_rerun.py", By("scripts/test_rerun.sh", "examples/test_to_rerun.py")),
    ("quadlift import FORMAT", Not("FORMAT stands for those below it")),
    ("quadlift-ros2", By("scripts/test_ros2.sh", "cargo test")),
    ("rerun ", Not("opens a window")),
    ("ros2 ", Not("needs ROS 2")),
    ("rosbags-convert", Not("needs a recording in the old format")),
    ("scripts/fuzz.sh", Not("needs a nightly compiler; the seeds are among the tests")),
    ("scripts/golden.sh", Not("compares two programs, by hand")),
    ("scripts/test.sh", By(".ci/run", "scripts/test.sh")),
];

fn text_of(file: &str) -> String {
    std::fs::read_to_string(workspace().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The commands of indented blocks and of "```sh", without comments, pipes and redirections, each with its place, and whether
/// it is in an indented block.
fn commands() -> Vec<(String, String, bool)> {
    let mut found = Vec::new();
    for (path, page) in pages() {
        let (mut fence, mut in_block, mut after_blank) = (None, false, true);
        // What is true only after the first release waits in comments.
        let mut in_comment = false;
        let mut lines = page.lines().enumerate();
        while let Some((number, line)) = lines.next() {
            in_comment |= line.starts_with("<!--");
            if in_comment {
                in_comment = !line.contains("-->");
                continue;
            }
            if let Some(kind) = line.trim_start().strip_prefix("```") {
                fence = if fence.is_some() { None } else { Some(kind.to_owned()) };
                continue;
            }
            in_block = fence.is_none() && line.starts_with("    ") && (in_block || after_blank);
            after_blank = line.is_empty();
            if !in_block && fence.as_deref() != Some("sh") || line.trim_start().starts_with('|') {
                continue;
            }
            let mut command = line.trim().to_owned();
            while let Some(start) = command.strip_suffix('\\') {
                command = format!("{start}{}", lines.next().unwrap().1.trim());
            }
            let command = command.split("  #").next().unwrap().split(" > ").next().unwrap();
            let command = command.rsplit(" | ").next().unwrap().trim().to_owned();
            if !command.is_empty() {
                found.push((format!("{}:{}", path.display(), number + 1), command, in_block));
            }
        }
    }
    found
}

#[test]
fn commands_of_the_program_have_these_options() {
    let folder = Folder::new();
    let mut count = 0;
    for (place, command, is_indented) in commands() {
        let Some(arguments) = command.strip_prefix("quadlift ").filter(|_| is_indented) else { continue };
        if arguments.starts_with("import FORMAT") {
            continue;
        }
        // Arguments are read up to `--help`.
        let run = folder.run(&format!("{arguments} --help"));
        assert_eq!(run.code, 0, "{place}: {command}\n{}", run.stderr);
        count += 1;
    }
    assert!(count > 60, "{count}");
}

#[test]
fn other_commands_are_run_somewhere_or_say_why_not() {
    let mut used = BTreeSet::new();
    for (place, command, _) in commands() {
        let of_program = command.starts_with("quadlift ") && !command.starts_with("quadlift import FORMAT");
        if of_program {
            continue;
        }
        let entry = OTHERS.iter().find(|(start, _)| command.starts_with(start));
        let (start, run) =
            entry.unwrap_or_else(|| panic!("{place}: who runs `{command}`? page_commands.rs has no entry"));
        used.insert(*start);
        match run {
            By(file, text) => assert!(text_of(file).contains(text), "{place}: {file} has not `{text}`"),
            Not(reason) => assert!(!reason.is_empty()),
        }
        for word in command.split_whitespace().filter(|word| word.contains('/') && !command.starts_with("ros2 ")) {
            let is_ours =
                ["scripts/", "examples/", "crates/", "packaging/", ".ci/"].iter().any(|start| word.starts_with(start));
            assert!(!is_ours || workspace().join(word).exists(), "{place}: there is no {word}");
        }
        if let Some((_, extras)) = command.split_once(".[") {
            let project = text_of("pyproject.toml");
            for extra in extras.split(']').next().unwrap().split(',') {
                assert!(project.contains(&format!("\n{extra} = [")), "{place}: there is no extra {extra}");
            }
        }
    }
    let unused: Vec<&str> = OTHERS.iter().map(|(start, _)| *start).filter(|start| !used.contains(start)).collect();
    assert!(unused.is_empty(), "on no page: {unused:?}");
}

/// What follows a text in a page, up to the end of the word.
fn names<'a>(page: &'a str, before: &'a str) -> impl Iterator<Item = &'a str> {
    let end = |c: char| !(c.is_ascii_alphanumeric() || "-_".contains(c));
    page.split(before).skip(1).map(move |rest| rest.split(end).next().unwrap_or_default())
}

#[test]
fn benches_and_experiments_on_pages_exist() {
    let experiments = text_of("bench/src/lib.rs") + &text_of("bench/src/main.rs");
    let (mut benches, mut count) = (0, 0);
    let code = std::fs::read_dir(workspace().join("bench/benches")).unwrap().map(|entry| entry.unwrap().path());
    let code = code.filter(|path| path.is_file()).map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()));
    for (path, page) in pages().into_iter().chain(code) {
        for name in names(&page, "--bench ").filter(|name| *name != "NAME") {
            let file = workspace().join(format!("bench/benches/{name}.rs"));
            assert!(file.exists(), "{}: there is no bench {name}", path.display());
            benches += 1;
        }
        for name in names(&page, "quadlift-bench -- ").chain(names(&page, "`quadlift-bench ")) {
            let exists =
                ["NAME", "all", "compare", "render"].contains(&name) || experiments.contains(&format!("=> \"{name}\""));
            // Before the name of `quadlift-bench -- --help` there is none.
            assert!(exists || name.starts_with("--"), "{}: there is no experiment {name}", path.display());
            count += 1;
        }
    }
    // The last column of README's table.
    let readme = text_of("README.md");
    for row in readme.lines().skip_while(|line| !line.contains("Reproduce with `quadlift-bench`")).skip(2) {
        let Some(name) = row.trim_end_matches([' ', '|']).rsplit('|').next().filter(|_| row.starts_with('|')) else {
            break;
        };
        let name = name.trim().trim_matches('`');
        assert!(experiments.contains(&format!("=> \"{name}\"")), "README.md: there is no experiment {name}");
        count += 1;
    }
    assert!(benches >= 5 && count > 15, "{benches} benches, {count} experiments");
}

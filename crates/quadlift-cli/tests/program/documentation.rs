//! The README and the manual are true: their files and commands work in the order in which they are shown, the table of
//! built-in priors is that of the program, links between pages lead to pages and headings, and the files that
//! ARCHITECTURE.md, CONTRIBUTING.md and RELEASING.md name exist.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::Folder;

pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The pages for users and developers, with their texts.
pub(crate) fn pages() -> Vec<(PathBuf, String)> {
    let mut folders = ["", "bench", "docs", "docs/formats", "docs/method", "docs/results", "python"]
        .map(|folder| workspace().join(folder))
        .to_vec();
    folders.extend(std::fs::read_dir(workspace().join("crates")).unwrap().map(|entry| entry.unwrap().path()));
    let mut paths = Vec::new();
    for folder in folders {
        let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        paths.extend(files.filter(|path| path.extension().is_some_and(|extension| extension == "md")));
    }
    paths.into_iter().map(|path| (path.clone(), std::fs::read_to_string(path).unwrap())).collect()
}

/// The fenced blocks of a page: what stands after the opening fence, and the text.
fn blocks(page: &str) -> Vec<(&str, String)> {
    let mut blocks = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        if let Some(kind) = line.strip_prefix("```") {
            let text: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
            blocks.push((kind, text.join("\n")));
        }
    }
    blocks
}

/// The parts of a page whose files and commands belong together: of a page of formats the sections that have commands, each
/// after the beginning of the page, of other pages all.
fn parts(path: &Path, page: &str) -> Vec<String> {
    let mut sections = page.split("\n## ");
    let start = sections.next().unwrap_or_default();
    let rest: Vec<&str> = sections.filter(|section| section.contains("\n```sh\n")).collect();
    if path.parent().is_some_and(|folder| folder.ends_with("formats")) && !rest.is_empty() {
        rest.iter().map(|section| format!("{start}\n## {section}")).collect()
    } else {
        vec![page.to_owned()]
    }
}

/// A block such as "```json cup.json" is the file cup.json; in "```sh" the lines that begin with "quadlift" are run.
#[test]
fn files_and_commands_work_as_shown() {
    let (mut files, mut commands) = (0, 0);
    for (path, page) in pages() {
        for part in parts(&path, &page) {
            let (f, c) = run_as_shown(&path, &part);
            (files, commands) = (files + f, commands + c);
        }
    }
    assert!(files >= 3 && commands >= 40, "{files} files, {commands} commands");
}

/// Writes the files of a page and runs its commands; gives the numbers of both.
fn run_as_shown(path: &Path, page: &str) -> (usize, usize) {
    let (mut files, mut commands) = (0, 0);
    let folder = Folder::new();
    // The files of a page that are too long for its text.
    let data =
        path.with_extension("").file_name().unwrap().to_string_lossy().replace("tutorial", "tutorial-colmap-yolo");
    let data = workspace().join("docs/data").join(data);
    if data.is_dir() {
        folder.copy(&data);
    }
    for (kind, text) in blocks(page) {
        match kind.split_once(' ') {
            Some(("json", name)) => {
                folder.write(name, &text);
                folder.succeed(&format!("localize {name}"));
                files += 1;
            }
            // A file of another program, for the commands below it.
            Some(("text", name)) => folder.write(name, &text),
            Some(("toml", name)) => {
                folder.write(name, &text);
                folder.succeed("synth -o .synthetic.json --objects 2");
                folder.succeed(&format!("localize .synthetic.json --priors {name}"));
                files += 1;
            }
            _ if kind == "sh" => {
                for command in text.lines().filter_map(|line| line.strip_prefix("quadlift ")) {
                    folder.succeed(command);
                    commands += 1;
                }
            }
            _ => assert!(!text.contains("quadlift.scene"), "{}: a scene without a name", path.display()),
        }
    }
    (files, commands)
}

#[test]
fn the_table_of_builtin_priors_is_that_of_the_program() {
    let page = std::fs::read_to_string(workspace().join("docs/priors.md")).unwrap();
    let priors = quadlift_io::builtin_priors();
    for (name, prior) in &priors.by_category {
        let size = prior.size.unwrap();
        let list = |values: [f64; 3]| values.map(|x| x.to_string()).join(" x ");
        let upright = prior.upright_sd.map_or(String::new(), |sd| sd.to_string());
        let ground = if prior.on_ground { "yes" } else { "" };
        let row = format!("| {name} | {} | {} | {upright} | {ground} |", list(size.mean), list(size.sd));
        assert!(page.contains(&row), "docs/priors.md has no row\n{row}");
    }
    let rows = page.lines().filter(|line| line.starts_with("| ") && line.contains(" x ")).count();
    assert_eq!(rows, priors.by_category.len(), "docs/priors.md has rows too many");
}

/// The names by which links reach the headings of a page, as GitHub and mdBook make them.
fn anchors(page: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    let mut in_block = false;
    for line in page.lines() {
        in_block ^= line.starts_with("```");
        let heading = line.trim_start_matches('#');
        if in_block || heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let letters = heading.trim().to_lowercase();
        let anchor: String = letters
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c))
            .map(|c| if c == ' ' { '-' } else { c })
            .collect();
        anchors.insert(anchor);
    }
    anchors
}

#[test]
fn links_between_pages_lead_somewhere() {
    let (mut links, mut headings) = (0, 0);
    for (path, page) in pages() {
        for link in page.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if link.contains("://") {
                continue;
            }
            let (target, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if target.is_empty() { path.clone() } else { path.parent().unwrap().join(target) };
            assert!(target.exists(), "{}: {link}", path.display());
            links += 1;
            if !anchor.is_empty() {
                let anchors = anchors(&std::fs::read_to_string(target).unwrap());
                assert!(anchors.contains(anchor), "{}: {link} names none of the headings {anchors:?}", path.display());
                headings += 1;
            }
        }
    }
    assert!(links > 100 && headings > 10, "{links} links, {headings} to headings");
}

/// The files of the repository that people write, with `/` between folders, relative to the repository.
fn files(folder: &Path, prefix: &str, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let name = entry.file_name().into_string().unwrap();
        let path = format!("{prefix}/{name}");
        if !entry.file_type().unwrap().is_dir() {
            found.push(path);
        } else if !["target", "node_modules", ".git", "dist"].contains(&name.as_str()) {
            found.push(format!("{path}/"));
            files(&entry.path(), &path, found);
        }
    }
}

/// Whether a word in backticks is meant as a file or a folder of the repository.
fn names_a_file(word: &str) -> bool {
    let ends = [".rs", ".toml", ".md", ".sh", ".py", ".pyi", ".ts", ".css", ".html", ".yml", ".ipynb", "/"];
    word.chars().all(|c| c.is_ascii_alphanumeric() || "_-./".contains(c))
        && ends.iter().any(|end| word.ends_with(end))
        && !word.starts_with(['.', '/'])
        && !word.starts_with("target/")
}

#[test]
fn files_that_the_pages_for_developers_name_exist() {
    let mut existing = Vec::new();
    files(&workspace(), "", &mut existing);
    let (mut words, mut missing) = (0, Vec::new());
    for page in ["ARCHITECTURE.md", "CONTRIBUTING.md", "RELEASING.md"] {
        let text = std::fs::read_to_string(workspace().join(page)).unwrap();
        for word in text.split('`').skip(1).step_by(2).filter(|word| names_a_file(word)) {
            words += 1;
            let end = format!("/{word}");
            if !existing.iter().any(|path| path.ends_with(&end)) {
                missing.push(format!("{page}: {word}"));
            }
        }
    }
    assert!(missing.is_empty(), "no such files: {missing:#?}");
    assert!(words > 120, "{words}");
}

/// Pages that nobody reads in an hour go stale. What is generated is built, not committed.
#[test]
fn all_pages_together_are_short() {
    let mut paths = Vec::new();
    files(&workspace(), "", &mut paths);
    let pages = paths.iter().filter(|path| path.ends_with(".md"));
    let words = |path: &String| {
        std::fs::read_to_string(format!("{}{path}", workspace().display())).unwrap().split_whitespace().count()
    };
    let count: usize = pages.map(words).sum();
    assert!((20_000..=60_000).contains(&count), "{count} words");
}

/// The version and the address of the project stand in places that no tool keeps together.
#[test]
fn versions_and_addresses_agree() {
    let version = env!("CARGO_PKG_VERSION");
    let manifest = std::fs::read_to_string(workspace().join("Cargo.toml")).unwrap();
    for line in manifest.lines().filter(|line| line.contains("path = \"crates/")) {
        assert!(line.contains(&format!("version = \"{version}\"")), "Cargo.toml: {line}");
    }
    // Outside of the workspace.
    let manifest = std::fs::read_to_string(workspace().join("crates/quadlift-ros2/Cargo.toml")).unwrap();
    for line in manifest.lines().filter(|line| line.starts_with("version = ") || line.contains("path = \"../")) {
        assert!(line.contains(&format!("version = \"{version}\"")), "crates/quadlift-ros2/Cargo.toml: {line}");
    }
    assert!(manifest.contains(&format!("repository = \"{}\"", env!("CARGO_PKG_REPOSITORY"))));
    let citation = std::fs::read_to_string(workspace().join("CITATION.cff")).unwrap();
    assert!(citation.contains(&format!("\nversion: {version}\n")), "CITATION.cff has not the version {version}");
    let repository = env!("CARGO_PKG_REPOSITORY");
    let recipes = [
        ("packaging/conda/recipe.yaml", format!("\n  version: \"{version}\"\n")),
        ("packaging/homebrew/quadlift.rb", format!("/archive/refs/tags/v{version}.tar.gz\"\n")),
    ];
    for (recipe, line) in recipes {
        let text = std::fs::read_to_string(workspace().join(recipe)).unwrap();
        assert!(text.contains(&line), "{recipe} has not the version {version}");
    }
    for page in ["pyproject.toml", "README.md", "packaging/conda/recipe.yaml", "packaging/homebrew/quadlift.rb"] {
        let text = std::fs::read_to_string(workspace().join(page)).unwrap();
        let addresses: Vec<&str> =
            text.split(['"', '(', ')', ' ', '\n']).filter(|word| word.starts_with("https://github.com/")).collect();
        let ours = |address: &&str| {
            address.strip_prefix(repository).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        assert!(!addresses.is_empty() && addresses.iter().all(ours), "{page}: {addresses:?}, expected {repository}");
    }
}

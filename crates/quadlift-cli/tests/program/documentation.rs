//! The README and the manual are true: their files and commands work in the order in which they are shown, the table of
//! built-in priors is that of the program, and links between pages lead somewhere.

use std::path::{Path, PathBuf};

use crate::common::Folder;

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The pages for users and developers, with their texts.
fn pages() -> Vec<(PathBuf, String)> {
    let mut paths: Vec<PathBuf> = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md"]
        .iter()
        .map(|name| workspace().join(name))
        .collect();
    for folder in ["docs", "docs/formats"] {
        let docs = std::fs::read_dir(workspace().join(folder)).unwrap().map(|entry| entry.unwrap().path());
        paths.extend(docs.filter(|path| path.extension().is_some_and(|extension| extension == "md")));
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

/// A block such as "```json cup.json" is the file cup.json; in "```sh" the lines that begin with "quadlift" are run.
#[test]
fn files_and_commands_work_as_shown() {
    let (mut files, mut commands) = (0, 0);
    for (path, page) in pages() {
        let folder = Folder::new();
        // The files of a tutorial that are too long for its text.
        let data = path.with_extension("");
        let data = workspace().join("docs/data").join(data.file_name().unwrap());
        if data.is_dir() {
            folder.copy(&data);
        }
        for (kind, text) in blocks(&page) {
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
    }
    assert!(files >= 4 && commands >= 40, "{files} files, {commands} commands");
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

#[test]
fn links_between_pages_lead_somewhere() {
    let mut links = 0;
    for (path, page) in pages() {
        for link in page.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let target = link.split('#').next().unwrap();
            if !link.contains("://") && !target.is_empty() {
                assert!(path.parent().unwrap().join(target).exists(), "{}: {link}", path.display());
                links += 1;
            }
        }
    }
    assert!(links > 20, "{links}");
}

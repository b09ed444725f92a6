#!/usr/bin/env python3
"""How large the project is, beside the numbers of budget.toml: the exit code is 1 when one is above. Counts files that git
tracks, without a build. A commit that raises a number says in its message what it bought."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

# Crates whose public items nobody outside of the project uses.
NOT_LIBRARIES = {"quadlift-cli", "quadlift-py", "quadlift-segment", "quadlift-report", "quadlift-ros2"}
TESTS = re.compile(r"/tests/|(^|/|_)tests?\.rs$")
TEST_MODULE = re.compile(r"(pub(\(.*?\))? )?mod \w+ \{")
CONSTANT = re.compile(r"^\s*(?:pub(?:\([a-z]+\))? )?const [A-Z_0-9]+: (?:f64|f32|usize|u\d+|i\d+)", re.M)
MODULE = re.compile(r"^\s*(pub(?:\([a-z ]+\))? )?mod (\w+);", re.M)
EXPORT = re.compile(r"^pub use ([^;]+);", re.M)
ITEM = re.compile(r"^( *)pub (?:const fn|fn|struct|enum|trait|type|const|use) ?(\w*)", re.M)
IMPL = re.compile(r"impl(?:<[^>]*>)? (?:\w+(?:<[^>]*>)? for )?(\w+)")


def code_lines(text: str) -> int:
    """Lines of a Rust file without blank ones, comments and test modules."""
    count = depth = 0
    in_test = after_cfg = False
    for line in map(str.strip, text.split("\n")):
        if in_test:
            depth += line.count("{") - line.count("}")
            in_test = depth > 0
            continue
        if line.startswith("#[cfg(test)]"):
            after_cfg = True
        elif after_cfg and not line.startswith("#["):
            after_cfg = False
            if TEST_MODULE.match(line):
                in_test, depth = True, line.count("{") - line.count("}")
                continue
        count += bool(line) and not line.startswith("//")
    return count


def module_files(files: dict[str, str]) -> Iterator[tuple[str, bool]]:
    """The files of a crate, by their `mod` lines, and whether their whole path is public."""
    waiting = [("lib.rs", "", True)]
    for file, folder, is_public in waiting:
        yield file, is_public
        for visibility, name in MODULE.findall(files[file]):
            inner = f"{folder}{name}/"
            found = [path for path in (f"{folder}{name}.rs", f"{inner}mod.rs") if path in files]
            waiting += [(path, inner, is_public and visibility.strip() == "pub") for path in found]


def public_items(files: dict[str, str]) -> int:
    """Items of a crate that other crates can reach: those of public modules, and those that such a module exports."""
    files = {file: re.split(r"#\[cfg\(test\)\]\nmod", text)[0] for file, text in files.items()}
    public = {file for file, is_public in module_files(files) if is_public}
    exported = {name for file in public for use in EXPORT.findall(files[file]) for name in re.findall(r"\w+", use)}
    count = sum(len(ITEM.findall(files[file])) for file in public)
    for text in (text for file, text in files.items() if file not in public):
        inside = None  # the type whose `impl` a line is in
        for line in text.split("\n"):
            if block := IMPL.match(line):
                inside = block[1]
            elif re.match(r"[^\s}#/]", line):
                inside = None
            if item := ITEM.match(line):
                count += (inside if item[1] else item[2]) in exported
    return count


def measured() -> dict[str, int]:
    """The numbers of budget.toml, as they are."""
    tracked = subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout.split("\n")
    texts = {
        file: Path(file).read_text(encoding="utf-8")
        for file in tracked
        if file.endswith((".rs", ".md", ".py", "Cargo.lock")) and Path(file).is_file()
    }
    source = {file: text for file, text in texts.items() if file.endswith(".rs") and not TESTS.search(file)}
    crates = {file: text for file, text in source.items() if file.startswith("crates/")}
    roots = [file.removesuffix("lib.rs") for file in crates if re.fullmatch(r"crates/[^/]+/src/lib\.rs", file)]
    libraries = [root for root in roots if root.split("/")[1] not in NOT_LIBRARIES]
    python = {file: text.count("\n") for file, text in texts.items() if file.endswith(".py")}
    return {
        "product_code_lines": sum(code_lines(text) for file, text in source.items() if not file.startswith("bench/")),
        "numeric_constants": sum(len(CONSTANT.findall(text)) for text in crates.values()),
        "public_items": sum(
            public_items({file.removeprefix(root): text for file, text in crates.items() if file.startswith(root)})
            for root in libraries
        ),
        "documentation_words": sum(len(text.split()) for file, text in texts.items() if file.endswith(".md")),
        "packages": texts["Cargo.lock"].count("\n[[package]]\n"),
        "python_package_lines": sum(lines for file, lines in python.items() if file.startswith("python/quadlift/")),
        "python_lines": sum(python.values()),
    }


def main() -> int:
    os.chdir(Path(__file__).resolve().parents[1])
    budget = dict(re.findall(r"^(\w+) = (\d+)$", Path("budget.toml").read_text(), re.M))
    counts = measured()
    if counts.keys() != budget.keys():
        print(f"budget.toml: {', '.join(sorted(counts.keys() ^ budget.keys()))}: in one of budget.toml and budget.py only")
        return 1
    above = [name for name, count in counts.items() if count > int(budget[name])]
    for name, count in counts.items():
        note = "  above" if name in above else ""
        print(f"{name:22} {count:7} of {int(budget[name]):7}{note}")
    if above:
        print("remove something else, or raise the number and say in the commit's message what it bought")
    return bool(above)


sys.exit(main())

#!/usr/bin/env python3
"""Checks the layers inside each crate, without a build: the order of `mod` lines is their order. A file uses only siblings above it,
and names their files, not what their folder re-exports; test modules come last. The library does no I/O and reads no clock.

Prints `path:line: message` for each violation; the exit code is then 1."""

import re
import sys
from pathlib import Path

LIBRARY = Path("crates/quadlift/src")
NOT_IN_LIBRARY = {"fs", "io", "net", "process", "env", "time"}
USE = re.compile(r"^ *(?:pub(?:\([\w: ]+\))? )?use ([^;]+);", re.MULTILINE)
MOD = re.compile(r"(?:pub(?:\([\w: ]+\))? )?mod (\w+)( \{|;)")
PATH = re.compile(r"(?<![\w:])(?:crate|super|self|std)(?:::\w+)+")


def without_tests(path, found):
    """The text of a file without comments and tests, on the same lines, and its modules in their order."""
    lines, modules, test, ends = [], [], None, None
    for number, line in enumerate(path.read_text().split("\n"), 1):
        module = MOD.match(line)
        if line.strip() == "#[cfg(test)]":
            ends = line[: -len(line.lstrip())]
        elif ends is not None and module and module[2] == " {":
            # Its content ends the file.
            break
        elif module and module[2] == ";" and ends is not None:
            test = module[1]
        elif module and module[2] == ";":
            modules.append(module[1])
            if test:
                found.add((path, number, f"`{module[1]}` is below the test module `{test}`"))
        lines.append("" if ends is not None else re.sub("//.*", "", line))
        # The last line of the tested item is indented as its first one.
        if ends is not None and re.match(ends + r"(\}|[^ #].*[;}]$)", line):
            ends = None
    return "\n".join(lines), modules


def expanded(tree):
    """The paths of a `use` tree."""
    head, brace, rest = re.sub(r" as \w+", "", tree).partition("{")
    if not brace:
        return [head.strip()]
    parts, depth = [""], 0
    for char in rest[: rest.rindex("}")]:
        depth += {"{": 1, "}": -1}.get(char, 0)
        parts = [*parts, ""] if char == "," and depth == 0 else [*parts[:-1], parts[-1] + char]
    return [head.strip() + path for part in parts if part.strip() for path in expanded(part)]


def check(root, found):
    """Checks the crate with this root."""
    files, waiting = {}, [((), root, root.parent)]
    while waiting:
        module, path, folder = waiting.pop()
        text, modules = without_tests(path, found)
        used = [(m.start(1), path.split("::")) for m in USE.finditer(text) for path in expanded(m[1])]
        rest = USE.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)
        names = used + [(m.start(), m[0].split("::")) for m in PATH.finditer(rest)]
        local = (name[name[0] == "self" :] for _, name in used)
        files[module] = path, modules, {name[-1]: name[0] for name in local if name[0] in modules}, [
            (text.count("\n", 0, at) + 1, name) for at, name in names
        ]
        for name in modules:
            below = folder / name
            inside = below / "mod.rs"
            waiting.append(((*module, name), inside if inside.exists() else folder / f"{name}.rs", below))
    for module, (path, _, _, names) in files.items():
        for line, (first, *rest) in names:
            if first == "std" and path.is_relative_to(LIBRARY) and rest[0] in NOT_IN_LIBRARY:
                found.add((path, line, f"the library does not use std::{rest[0]}"))
            base = {"crate": (), "self": module, "super": module[:-1]}.get(first, module)
            target = (*base, *(rest if first in ("crate", "self", "super") else (first, *rest)))
            while "super" in target:
                at = target.index("super")
                target = target[: at - 1] + target[at + 1 :]
            level = next((k for k, (a, b) in enumerate(zip(module, target)) if a != b), None)
            if level is None:
                continue
            parent, siblings, exported, _ = files[module[:level]]
            own, other = module[level], target[level]
            if other not in siblings and other in exported:
                found.add((path, line, f"`{other}` is of `{exported[other]}`: name that, not its re-export in {parent}"))
            elif other in siblings and siblings.index(other) > siblings.index(own):
                found.add((path, line, f"`{own}` uses `{other}`, which is below it in {parent}"))


violations = set()
for crate in sorted(Path("crates").glob("*/src")):
    for name in ("lib.rs", "main.rs"):
        if (crate / name).exists():
            check(crate / name, violations)
for path, line, message in sorted(violations):
    print(f"{path}:{line}: {message}")
sys.exit(bool(violations))

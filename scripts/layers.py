#!/usr/bin/env python3
"""Checks the layers inside each crate, without a build: the order of `mod` lines is their order. A file uses only siblings
above it, and names their files, not what their folder re-exports; test modules come last. The library does no I/O and
reads no clock.

An inherent `impl` is in the file of its type: what another file does with it is a function that takes the parts it needs.

Prints `path:line: message` for each violation; the exit code is then 1."""

import re
import sys
from pathlib import Path

NOT_IN_LIBRARY = {"fs", "io", "net", "process", "env", "time"}
TEST = re.compile(r" *#\[cfg\((all\()?test\b")
MOD = re.compile(r"(?:pub(?:\([\w: ]+\))? )?mod (\w+)( \{|;)")
USE = re.compile(r"^ *(?:pub(?:\([\w: ]+\))? )?use ([^;]+);", re.MULTILINE)
PATH = re.compile(r"(?<![\w:])(?:crate|super|self|std)(?:::\w+)+")

TYPE = re.compile(r"^ *(?:pub(?:\([\w: ]+\))? )?(?:struct|enum|union) (\w+)", re.MULTILINE)
# Up to the name of the type; one of a trait has ` for ` behind it.
IMPL = re.compile(r"^ *impl(?:<.*?>)? (?:\w+::)*(\w+)(?:<(?:(?! for )[^{])*>)?\s*(?:where[^{]*)?\{", re.MULTILINE)

# Types with an inherent `impl` in other files, which are few: the scene is made in one and viewed in others, and what
# follows is to be divided or moved, type by type.
OTHER_FILES = {
    "Scene": "scene/occluded scene/sources scene/views",
    "SceneFile": "align/map_objects align/moved calibrate_rig/rig relocalize/landmarks relocalize/query run/record "
    "scene_file/bodies scene_file/convert scene_file/depth_images scene_file/images scene_file/paths "
    "scene_file/point_clouds scene_file/run scene_file/tangent_lines",
    # Records beside the code that reads what they name.
    "Box3dRecord DepthImageRecord DetectionRecord FrameRecord ObjectRecord PointCloudRecord": "scene_file/bodies scene_file/convert "
    "scene_file/depth_images scene_file/detection_cues scene_file/point_clouds quadlift-io/src/stream/map_file",
    "RigScene": "calibrate_rig/record",
    "CheckedScene": "write/frusta write/units write/views",
    # The fit of an object: its stages.
    "Fit": "object/alternatives object/few_views object/learned_size object/scale_terms scene/upright",
    "CueScales ObjectProblem PosePoints PosePrior": "object/first_fit shared/found_scales shared/point_check shared/pose_evidence",
    # Names and ranges of options, all in one place.
    "IdPolicy MeasurementKind Method PoseMotion": "quadlift/src/names",
    "LocalizeOptions Method PosteriorOptions": "localize/validate solve/validate",
    # The search, the check and relocalization, stage by stage.
    "State": "search/em search/passes",
    "Correction Diagnosis Mistake": "diagnosis/apply diagnosis/fit diagnosis/hypotheses diagnosis/lengths",
    "LandmarkMap": "relocalize/check relocalize/prepared",
    "PreparedBox ShapePrior": "calibrate_rig/assemble calibrate_rig/prepared",
    "Camera": "lens/measurements",
    # Segmentation: the model of colors, step by step.
    "Model": "sca/components sca/expectation sca/fit sca/maximization",
    "PyScene": "quadlift-py/src/scene_methods",
    "Report ReportDetections": "quadlift-report/src/colors quadlift-report/src/cues quadlift-report/src/document",
}

violations = []


def without_tests(path):
    """The text of a file without comments and tests, on the same lines, and its modules in their order."""
    lines, modules, test_module, indent = [], [], None, None
    for number, line in enumerate(path.read_text().split("\n"), 1):
        if TEST.match(line):
            indent = " " * (len(line) - len(line.lstrip()))
        is_test = indent is not None
        if module := MOD.match(line):
            name, inside = module.groups()
            if is_test and inside == " {":
                break  # it ends the file
            if is_test:
                test_module = name
            elif inside == ";":
                modules.append(name)
                if test_module:
                    violations.append((path, number, f"`{name}` is below the test module `{test_module}`"))
        lines.append("" if is_test else re.sub("//.*", "", line))
        # An item ends with a line that is indented as its first one.
        if is_test and re.match(indent + r"(\}|[^ #].*[;}]$)", line):
            indent = None
    return "\n".join(lines), modules


def paths_of(tree):
    """The paths of a `use` tree, in parts."""
    head, brace, rest = re.sub(r" as \w+|\s", "", tree).partition("{")
    if not brace:
        return [head.split("::")]
    trees, depth = [""], 0
    for char in rest[: rest.rindex("}")]:
        depth += {"{": 1, "}": -1}.get(char, 0)
        trees = [*trees, ""] if char == "," and depth == 0 else [*trees[:-1], trees[-1] + char]
    return [path for tree in trees if tree for path in paths_of(head + tree)]


def target_of(module, path):
    """What a path in a module names, from the root of the crate."""
    start = {"crate": (), "self": module, "super": module[:-1]}.get(path[0])
    target = [*module, *path] if start is None else [*start, *path[1:]]
    while "super" in target:
        at = target.index("super")
        del target[at - 1 : at + 1]
    return target


def check_impls(path, text):
    """Checks that the types of inherent `impl`s are in the same file; those in other files must be listed, and listed ones exist."""
    own, found = set(TYPE.findall(text)), set()
    listed = {
        name
        for names, files in OTHER_FILES.items()
        if any(str(path).endswith(f"/{file}.rs") for file in files.split())
        for name in names.split()
    }
    for impl in IMPL.finditer(text):
        if impl[1] not in own:
            found.add(impl[1])
        if impl[1] not in own | listed:
            line = text.count("\n", 0, impl.start(1)) + 1
            violations.append((path, line, f"`{impl[1]}` is not of this file: its `impl` is where it is, functions are here"))
    if listed and not found:
        violations.append((path, 1, "all types are of this file: scripts/layers.py need not list it"))


def check(root):
    """Checks the crate with this root."""
    files, waiting = {}, [((), root, root.parent)]
    for module, path, folder in waiting:
        text, modules = without_tests(path)
        check_impls(path, text)
        uses = [(use.start(1), path) for use in USE.finditer(text) for path in paths_of(use[1])]
        others = PATH.finditer(USE.sub(lambda use: " " * len(use[0]), text))
        exported = {path[-1]: path[0] for path in (path[path[0] == "self" :] for _, path in uses) if path[0] in modules}
        named = [
            (text.count("\n", 0, at) + 1, path)
            for at, path in [*uses, *((m.start(), m[0].split("::")) for m in others)]
        ]
        files[module] = path, modules, exported, named
        for name in modules:
            inside = folder / name / "mod.rs"
            waiting.append(((*module, name), inside if inside.exists() else folder / f"{name}.rs", folder / name))
    for module, (path, _, _, named) in files.items():
        for line, names in named:
            if names[0] == "std" and names[1] in NOT_IN_LIBRARY and path.is_relative_to("crates/quadlift/src"):
                violations.append((path, line, f"the library does not use std::{names[1]}"))
            # The place where the ways to the module and to what it names part.
            pairs = enumerate(zip(module, target_of(module, names)))
            if part := next(((level, own, other) for level, (own, other) in pairs if own != other), None):
                level, own, other = part
                parent, siblings, exported, _ = files[module[:level]]
                if other in exported and other not in siblings:
                    violations.append((path, line, f"`{other}` is a re-export of {parent}: name `{exported[other]}`"))
                elif other in siblings and siblings.index(other) > siblings.index(own):
                    violations.append((path, line, f"`{own}` uses `{other}`, which is below it in {parent}"))


for source in sorted(Path("crates").glob("*/src")):
    for root in (source / "lib.rs", source / "main.rs"):
        if root.exists():
            check(root)
for path, line, message in sorted(set(violations)):
    print(f"{path}:{line}: {message}")
sys.exit(bool(violations))

"""The cases of scripts/golden.sh, which describes what they are for. Standard library only."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("QUADLIFT_DATA", ROOT.parent / "shared/data"))
LIMIT = 120  # seconds of one case
SHOWN = 60  # cases that differ

# Synthetic scenes: the options of `quadlift synth`.
SYNTHETIC = {
    "exact": "--objects 8",
    "noisy": "--objects 10 --noise box:0.05",
    "few-views": "--objects 8 --views 3 --noise box:0.03",
    "one-view": "--objects 5 --views 1 --cues depth,box3d --trajectory random",
    "wrong-boxes": "--objects 8 --noise box:0.03 --outliers 0.1",
    "ellipses": "--objects 6 --measurement ellipses --noise se:0.2",
    "both": "--objects 6 --measurement both --noise box:0.03",
    "cuboids": "--objects 8 --body cuboid --noise box:0.03 --trajectory orbit",
    "mixed": "--objects 9 --body cuboid,cylinder,ellipsoid --standing --trajectory random --edge-bias 0.03",
    "superellipsoids": "--objects 5 --body superellipsoid:1.5 --noise box:0.02",
    "street": "--trajectory street --views 24 --body cuboid --noise box:0.03",
    "without-ids": "--objects 12 --cube 40 --no-ids --noise box:0.04 --misses 0.2 --false-positives 0.1 --ground-truth truth.json",
    "detector": "--objects 12 --cube 40 --fragments 0.1 --switches 0.05 --duplicates 0.1 --occlusion --noise box:0.04",
    "street-without-ids": "--trajectory street --views 20 --no-ids --noise box:0.03 --misses 0.1",
    "outlines": "--objects 6 --views 4 --cues outline",
    "oriented-boxes": "--objects 6 --views 5 --cues oriented_box,depth",
    "cues": "--objects 8 --views 5 --cues depth,box3d --cue-noise depth-shift:0.3",
    "wrong-poses": "--objects 15 --noise box:0.02 --pose-noise 0.3 --trajectory orbit",
    "points": "--trajectory street --views 24 --noise box:0.02 --points 300 --pose-noise 0.3",
    "far-away": "--objects 5 --noise box:0.03 --scale 100 --offset 1000,-5000,300",
    "hall": "--pedestrians 2 --cameras 3 --time-steps 40 --noise box:0.02",
    "map": "--objects 30 --views 20 --cube 60 --trajectory random --noise box:0.03 --seed 1",
    "map-seen-again": "--objects 30 --views 20 --cube 60 --trajectory random --noise box:0.03 --seed 1 --no-ids",
}

# Settings of `localize`, on scenes in which they matter.
SETTINGS = {
    "ellipsoid": ("--body ellipsoid", "noisy mixed kitti_S22_aligned"),
    "cuboid": ("--body cuboid", "cuboids kitti_S36_oxts"),
    "cylinder": ("--body cylinder", "mixed"),
    "rounded": ("--body rounded", "superellipsoids"),
    "closed-forms": ("--method {planes,lfd,pfd,reg}", "noisy both"),
    "priors": ("--priors builtin --body cuboid", "kitti_S22_oxts kitti_S09_aligned"),
    "learned-sizes": ("--learn-sizes", "street kitti_S09_oxts"),
    "refined": ("--refine-poses", "wrong-poses points kitti_S05_oxts"),
    "ground": ("--ground-plane", "street mixed"),
    "cross-validated": ("--cross-validate --report page.html", "wrong-boxes tuw_demo"),
    "brief": ("--compact --json", "noisy"),
    "masks": ("--measurement mask", "outlines"),
    "noise_model": ("--noise-model edge_noise=0.03,edge_noise_px=1", "noisy"),
    "associated": ("--associate always --ids ignore", "noisy street"),
    "axes": ("--assume poses=opengl", "exact"),
    "swapped": ("--assume boxes=xywh --allow-inconsistent", "exact"),
}

SOURCES = {"accv": "yolo model", "kitti": "rrc label cuboid", "lmo": "visible-mask model", "tuw": "authors"}
EXPORTS = "ply glb kitti bop coco mcap csv tum colmap rerun"


class Cases:
    """What is run: a name, the words of the command, and the folder in which it runs."""

    def __init__(self, env, folder):
        self.env, self.folder, self.cases = env, folder, []

    def add(self, name, *words, stdin=None):
        words = [word for part in words for word in (part.split() if isinstance(part, str) else [str(part)])]
        self.cases.append((name, words, stdin))

    def run(self):
        """Runs what was added, on all cores, and gives the lines of the record."""
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            lines = list(pool.map(lambda case: self.run_one(*case), self.cases))
        self.cases = []
        return lines

    def run_one(self, name, words, stdin):
        place = self.folder / name
        place.mkdir(parents=True)
        python = words[:1] == ["PYTHON"]
        command = [os.environ["QUADLIFT_PYTHON"], *words[1:]] if python else ["quadlift", *words]
        begun = time.monotonic()
        try:
            with open(place / stdin if stdin else os.devnull, "rb") as source:
                done = subprocess.run(command, cwd=place, env=self.env, stdin=source, capture_output=True, timeout=LIMIT)
            code, out, err = done.returncode, done.stdout, done.stderr
        except subprocess.TimeoutExpired:
            code, out, err = "timeout", b"", b""
        seconds = time.monotonic() - begun
        (place / "stdout").write_bytes(out)
        (place / "stderr").write_bytes(err)
        (place / "command").write_text(" ".join(["quadlift", *words]) + "\n")
        digest = hashlib.sha256()
        for path in sorted(place.rglob("*")):
            if path.is_file() and not path.is_symlink():
                digest.update(str(path.relative_to(place)).encode() + b"\0" + path.read_bytes() + b"\0")
        return f"{name} {code} {digest.hexdigest()[:20]}", seconds


def scenes_at_hand():
    """The real scenes, each with one of its sources."""
    for path in sorted((DATA / "scenes").glob("*.json")):
        for source in SOURCES.get(path.stem.split("_")[0], "").split():
            if f'"{source}"' in path.read_text() and (source != "cuboid" or "aligned" in path.stem):
                yield f"{path.stem}-{source}", path.stem, source


def blocks_of(page):
    """The fenced blocks of a page: what stands after the fence, and the text."""
    return re.findall(r"^```([^\n]*)\n(.*?)^```$", page, re.M | re.S)


def parts_of(path):
    """The parts of a page whose files belong together, with their names: of a page of formats the sections that have commands,
    each after the beginning of the page, of other pages all. As in the program's test of the pages."""
    text = path.read_text()
    start, *sections = text.split("\n## ")
    sections = [section for section in sections if "\n```sh\n" in section]
    if path.parent.name != "formats" or not sections:
        return [(path, path.stem, text)]
    return [(path, f"{path.stem}-{number}", f"{start}\n## {section}") for number, section in enumerate(sections)]


def record(program, folder):
    """Runs all cases; gives their lines."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "in").mkdir()
    for name, target in (("real", DATA / "scenes"), ("cases", DATA.parent / "cases"), ("docs", ROOT / "docs/data"), ("seeds", ROOT / "fuzz/seeds"),
                         ("fixtures", ROOT / "crates/quadlift-io/tests/fixtures"),
                         ("rendered", ROOT / "crates/quadlift-cli/tests/fixtures/rendered")):
        (folder / "in" / name).symlink_to(target)
    # Suggestions of next commands name the program as it was called.
    (folder / "bin").mkdir()
    (folder / "bin/quadlift").symlink_to(program)
    env = {**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}"}
    cases, lines = Cases(env, folder), []

    # 1: scenes. What follows reads them.
    for name, options in SYNTHETIC.items():
        cases.add(f"synth/{name}", f"synth -o scene.json {options}")
    lines += cases.run()
    paths = {name: f"../../synth/{name}/scene.json" for name in SYNTHETIC} | {"rendered": "../../in/rendered/scene.json"}

    # 2: bodies of all scenes, and in other settings.
    real = list(scenes_at_hand())
    for name in paths:
        cases.add(f"localize/{name}", "localize -o result.json", paths[name])
    for name, scene, source in real:
        cases.add(f"localize/{name}", f"localize -o result.json ../../in/real/{scene}.json --source {source}")
    for name, (options, scenes) in SETTINGS.items():
        choices = re.search(r"\{(.*)\}", options)
        for choice in choices[1].split(",") if choices else [""]:
            for scene in scenes.split():
                at = [paths[scene]] if scene in paths else [f"../../in/real/{scene}.json --source", SOURCES[scene.split("_")[0]].split()[0]]
                if scene in paths or real:
                    cases.add(f"settings/{name}-{choice or 'on'}-{scene}", "localize -o result.json", re.sub(r"\{.*\}", choice, options), *at)
    for name in ("without-ids", "detector", "street-without-ids"):
        cases.add(f"associate/{name}", "associate -o result.json", paths[name])
        cases.add(f"associate/{name}-thorough", "associate --thorough -o result.json", paths[name])
    for name in ("noisy", "detector", "street", "street-without-ids", "cues", "outlines"):
        cases.add(f"stream/{name}", "stream --map result.json", paths[name])
    for name in ("cues", "orbit"):
        cases.add(f"stream/lines-{name}", f"stream --map result.json ../../in/seeds/stream/{name}.jsonl")
    for name, scene, source in real:
        if source in ("rrc", "authors"):
            cases.add(f"stream/{name}", f"stream --map result.json ../../in/real/{scene}.json --source {source}")
    for method in ("sca", "graphcut", "masks"):
        cases.add(f"segment/{method}", f"segment --method {method} -o result.json", paths["rendered"])
    cases.add("segment/default", "segment -o result.json --out-masks masks", paths["rendered"])
    cases.add("calibrate/hall", "calibrate-rig --include-posed -o result.json", paths["hall"])
    for name, path in paths.items():
        cases.add(f"info/{name}", "info --json", path)
        cases.add(f"info-in-words/{name}", "info", path)
    for name, scene, _ in real:
        cases.add(f"info/{name}", f"info --json ../../in/real/{scene}.json")
    for path in sorted((DATA.parent / "cases").glob("*.json")):
        verb = "calibrate-rig --include-posed" if path.stem.startswith("calibrate") else "localize"
        cases.add(f"cases/{path.stem}", f"{verb} -o result.json ../../in/cases/{path.name}")
    if (DATA.parent / "cases").exists():
        cases.add("locate/turned", "relocalize --include-posed -o result.json ../../in/cases/locate_map30.json ../../in/cases/locate_turned90.json")
    cases.add("demo", "demo --out demo")
    lines += cases.run()

    # 3: what reads results.
    for name in ("noisy", "mixed", "wrong-boxes", "cuboids"):
        cases.add(f"evaluate/{name}", f"evaluate --report page.html ../../localize/{name}/result.json", paths[name])
        cases.add(f"evaluate-json/{name}", f"evaluate --json ../../localize/{name}/result.json", paths[name])
    cases.add("evaluate/associated", "evaluate ../../associate/without-ids/result.json ../../synth/without-ids/truth.json")
    cases.add("locate/its-own", "relocalize --include-posed -o result.json ../../localize/map/result.json ../../synth/map-seen-again/scene.json")
    cases.add("locate/another", "relocalize --include-posed -o result.json ../../localize/noisy/result.json ../../synth/exact/scene.json")
    cases.add("align/itself", "align -o result.json ../../localize/map/result.json ../../synth/map/scene.json")
    cases.add("align/another", "align ../../localize/map/result.json ../../synth/noisy/scene.json")
    cases.add("render/every", "render ../../localize/street/result.json -o frames --all --svg --labels")
    for name in EXPORTS.split():
        out = "result" if name in ("colmap", "rerun") else f"result.{name}"
        for scene in ("street", "mixed"):
            cases.add(f"export/{name}-{scene}", f"export {name} ../../localize/{scene}/result.json -o {out}")
    for seed in sorted((ROOT / "fuzz/seeds/mcap").glob("*.mcap")):
        cases.add(f"import/{seed.name}", f"import mcap ../../in/seeds/mcap/{seed.name} -o result.json")
    for path, name in (("colmap/text", "colmap"), ("colmap/binary", "colmap"), ("colmap/rig_text", "colmap"), ("colmap/rig_binary", "colmap"),
                       ("kitti_raw/2030_01_02/2030_01_02_drive_0007_sync", "kitti-raw")):
        cases.add(f"import/{path.replace('/', '-')}", f"import {name} ../../in/fixtures/{path} -o result.json")
    for path in ("yolo", "yolo_seg", "sink.csv", "sink.json", "turned.csv", "results.json", "instances.json"):
        cases.add(f"detections/{path}", f"localize --cameras ../../in/fixtures/colmap/text --detections ../../in/fixtures/detections/{path} -o result.json")
    for name in ("colmap-yolo", "photos"):
        place = ROOT / f"docs/data/tutorial-{name}"
        if place.exists():
            at = f"../../in/docs/tutorial-{name}"
            cases.add(f"tutorial/{name}", f"localize --cameras {at}/sparse/0 --detections {at} -o result.json")
    for name in ["", *"demo segment associate localize relocalize align calibrate-rig stream evaluate view render synth import export info".split()]:
        cases.add(f"help/{name or 'program'}", name, "--help")
        cases.add(f"short-help/{name or 'program'}", name, "-h")
    if os.environ.get("QUADLIFT_PYTHON"):
        for name in ("noisy", "mixed", "without-ids", "cues", "outlines", "wrong-poses"):
            code = "import quadlift,sys;quadlift.Scene.from_file(sys.argv[1]).localize().save('result.json')"
            cases.cases.append((f"python/{name}", ["PYTHON", "-c", code, paths[name]], None))
    lines += cases.run()

    # 4: the files and commands of the pages, one folder each, in their order.
    def page(part):
        path, name, content = part
        place, texts = folder / "pages" / name, []
        data = ROOT / "docs/data" / path.stem.replace("tutorial", "tutorial-colmap-yolo")
        place.mkdir(parents=True)
        if data.is_dir():
            shutil.copytree(data, place, dirs_exist_ok=True)
        found = []
        for kind, text in blocks_of(content):
            kind, _, file = kind.partition(" ")
            if kind in ("json", "text", "toml") and file:
                (place / file).parent.mkdir(parents=True, exist_ok=True)
                (place / file).write_text(text)
            if kind == "json" and file:
                texts.append(f"localize {file}")
            if kind == "sh":
                texts += [line[len("quadlift "):] for line in text.splitlines() if line.startswith("quadlift ")]
        for number, words in enumerate(texts):
            if re.match(r"(view|reproduce)\b", words):
                continue
            done = subprocess.run(["bash", "-c", f"exec quadlift {words}"], cwd=place, env=env, capture_output=True, timeout=LIMIT)
            digest = hashlib.sha256(done.stdout + b"\0" + done.stderr).hexdigest()[:20]
            (place / f".{number}.out").write_bytes(done.stdout + done.stderr)
            found.append((f"pages/{name}/.{number}.out {done.returncode} {digest}", 0.0))
        return found

    pages = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/formats").glob("*.md"))]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for found in pool.map(page, [part for path in pages for part in parts_of(path)]):
            lines += found
    return lines


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("record", "compare"):
        sys.exit("usage: scripts/golden.sh record|compare [PROGRAM]")
    verb, program, base = sys.argv[1], Path(sys.argv[2]).resolve(), Path(sys.argv[3]).resolve()
    begun = time.monotonic()
    folder = base / ("old" if verb == "record" else "new")
    if verb == "compare" and not (base / "old/record").exists():
        sys.exit("nothing was recorded yet: scripts/golden.sh record")
    found = record(program, folder)
    lines = [line for line, _ in found]
    (folder / "record").write_text("\n".join(lines) + "\n")
    slow = ", ".join(f"{line.split()[0]} {seconds:.0f} s" for line, seconds in sorted(found, key=lambda x: -x[1])[:3])
    print(f"{len(lines)} cases in {time.monotonic() - begun:.0f} s; the slowest: {slow}")
    if verb == "record":
        return
    old = dict(line.split(" ", 1) for line in (base / "old/record").read_text().splitlines())
    new = dict(line.split(" ", 1) for line in lines)
    differ = [name for name in [*old, *(name for name in new if name not in old)] if old.get(name) != new.get(name)]
    for name in differ[:SHOWN]:
        print(f"{name}: {old.get(name, 'not there')} -> {new.get(name, 'not there')}")
    print(f"{len(differ)} of {len({*old, *new})} cases differ" + (f": diff -r {base}/old/NAME {base}/new/NAME" if differ else ""))
    sys.exit(bool(differ))


if __name__ == "__main__":
    main()

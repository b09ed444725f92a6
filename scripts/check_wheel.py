"""Checks an installed package from outside of the repository: imports it, localizes the cup of the README, and runs the program."""

import pathlib
import subprocess
import sys
import sysconfig

import numpy as np

import quadlift

source = pathlib.Path(quadlift.__file__).parent
assert "site-packages" in source.parts, f"{source} is not an installed package"

estimates = quadlift.localize(
    intrinsics=[[600, 0, 320], [0, 600, 240], [0, 0, 1]],
    cam_from_world=[
        [[0.0, 1.0, 0, 0], [0.60, 0.00, -0.8, 0], [-0.80, 0.00, -0.6, 1]],
        [[-0.6, 0.8, 0, 0], [0.48, 0.36, -0.8, 0], [-0.64, -0.48, -0.6, 1]],
        [[-0.8, 0.6, 0, 0], [0.48, 0.64, -0.6, 0], [-0.36, -0.48, -0.8, 1]],
        [[-1.0, 0.0, 0, 0], [0.00, 0.60, -0.8, 0], [0.00, -0.80, -0.6, 1]],
    ],
    image_sizes=(640, 480),
    frames=[0, 1, 2, 3],
    boxes=[[271, 190, 332, 256], [269, 182, 326, 248], [269, 182, 329, 250], [273, 175, 342, 235]],
    objects=["cup_1"] * 4,
)
assert np.allclose(estimates.centers, [[0.02, -0.03, 0.05]], atol=0.01), estimates.centers
script = pathlib.Path(sysconfig.get_path("scripts")) / "quadlift"
for command in ([script], [sys.executable, "-m", "quadlift"]):
    said = subprocess.run([*command, "--version"], check=True, capture_output=True, text=True).stdout
    assert said == f"quadlift {quadlift.__version__}\n", said
print(f"quadlift {quadlift.__version__}, Python {sys.version.split()[0]}: {source}")

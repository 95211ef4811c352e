"""The guided tour: its commands run as they stand in its text."""

import os
import subprocess
import sys

from conftest import PROJECT


def test_the_tour_runs_as_it_stands(blender):
    tour = [sys.executable, "examples/tour.py", "--blender", os.environ["MPSNET_BLENDER"]]
    done = subprocess.run(tour, cwd=PROJECT, env=blender.environment, capture_output=True, text=True, timeout=1200)
    told = done.stdout + done.stderr
    assert done.returncode == 0, told[-4000:]
    assert "grey.exr, 3 of 4" in told, "the practice photos tell how far they are"

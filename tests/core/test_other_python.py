"""The same seed gives the same samples under another Python and NumPy.

MPSNET_OTHER_PYTHON is a command that starts one in which this package is installed too, for instance another virtual
environment's python; without it there is nothing to compare with.
"""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.sample import read_sample

COUNT = 12

pytestmark = pytest.mark.skipif("MPSNET_OTHER_PYTHON" not in os.environ, reason="MPSNET_OTHER_PYTHON is not set")


def test_recipes_are_equal_and_arrays_agree(tmp_path: Path) -> None:
    other = shlex.split(os.environ["MPSNET_OTHER_PYTHON"])
    for name, python in (("this", [sys.executable]), ("other", other)):
        command = [*python, "-m", "mpsnet_core", "synthesize", "--count", str(COUNT), "--seed", "21", "--size", "64"]
        done = subprocess.run([*command, "-o", tmp_path / name], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    for number in range(COUNT):
        ours, theirs = (read_sample(sample_path(tmp_path / name, number)) for name in ("this", "other"))
        assert ours.recipe.data() == theirs.recipe.data()
        np.testing.assert_array_equal(ours.material, theirs.material)
        for name in ("normals", "depth", "alpha"):
            np.testing.assert_allclose(
                getattr(ours, name), getattr(theirs, name), atol=1e-5, err_msg=f"{number} {name}"
            )
        for name in ("lights", "lit"):  # kept as half floats, whose neighbours lie a share of 2^-10 apart
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-5, rtol=2**-10, err_msg=name)

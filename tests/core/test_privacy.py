"""Nothing is sent and nothing is kept: an estimate leaves the person's folders as they were."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from mpsnet_core import published_rig, write_image, write_rig
from mpsnet_core.io.child_process import child_environment


def test_an_estimate_with_a_network_leaves_nothing_in_home_or_the_temporary_folder(tmp_path: Path) -> None:
    """onnxruntime 1.31 and later would write a number of this machine's and a store of events."""
    write_image(tmp_path / "photo.exr", np.full((32, 32, 3), 0.4, np.float32))
    write_rig(tmp_path / "rig.json", published_rig())
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    home.mkdir()
    temporary.mkdir()
    places = {"HOME": str(home), "USERPROFILE": str(home), "LOCALAPPDATA": str(home), "TMPDIR": str(temporary)}
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "ORT_"))}
    arguments = ["estimate", "photo.exr", "--rig", "rig.json", "-o", "normals.png", "--model", "multiscale"]
    subprocess.run(
        [sys.executable, "-m", "mpsnet_core", *arguments],
        cwd=tmp_path,
        env={**kept, **places, "TEMP": str(temporary), "TMP": str(temporary)},
        check=True,
        timeout=120,
    )
    assert (tmp_path / "normals.png").is_file()
    assert not [*home.rglob("*"), *temporary.rglob("*")]


def test_files_in_the_current_folder_are_not_imported_by_child_processes(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("open('ran', 'w')\n")
    subprocess.run([sys.executable, "-c", "import numpy"], cwd=tmp_path, env=child_environment(), check=True)
    assert not (tmp_path / "ran").exists()

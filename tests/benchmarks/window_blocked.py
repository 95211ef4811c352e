"""How long Blender's window is blocked at a time, and how often the viewport is drawn, while a heavy object is
photographed, estimated and baked: in a real Blender with a window.

PYTHONPATH=tests/blender:tests/core python tests/benchmarks/window_blocked.py [--faces 500000] [--ngon]

Needs MPSNET_BLENDER and MPSNET_BLENDER_UI, and takes MPSNET_EXTENSION_ZIP, see tests/blender/conftest.py. Told are
how long the press of the button takes and the longest block after that, which holds a draw of the viewport; by the
clock, and by the processor time of Blender's main thread, which what else the machine does changes less.
"""

import argparse
import json
import os
import shlex
import subprocess
import tempfile
from pathlib import Path

from conftest import SCRIPTS, Blender

TIMEOUT = 900


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, default=500_000)
    parser.add_argument("--ngon", action="store_true", help="with one face of eight corners beside the quads")
    parser.add_argument("--shading", choices=["SOLID", "MATERIAL"], default="SOLID")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        blender = Blender(shlex.split(os.environ["MPSNET_BLENDER"]), Path(folder) / "user")
        blender.user.mkdir()
        blender.run(
            "--command", "extension", "install-file", "-r", "user_default", "-e", os.environ["MPSNET_EXTENSION_ZIP"]
        )
        report = Path(folder) / "report.json"
        script = ["--python", SCRIPTS / "blocked.py", "--", report, options.faces, int(options.ngon), options.shading]
        command = [*shlex.split(os.environ["MPSNET_BLENDER_UI"]), *map(str, script)]
        subprocess.run(command, env=blender.environment, capture_output=True, check=True, timeout=TIMEOUT)
        for step, found in json.loads(report.read_text(encoding="utf-8")).items():
            print(
                f"{step}: pressing it takes {found['begun'][0]:.2f} s ({found['begun'][1]:.2f} s of processor time), "
                f"the window is blocked for {found['blocked']:.2f} s at most ({found['processor']:.2f} s), "
                f"the viewport drawn {found['drawn']} times in {found['seconds']:.0f} s"
            )


if __name__ == "__main__":
    main()

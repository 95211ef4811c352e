"""How long Blender's window is blocked at a time, and how often the viewport is drawn, while a heavy object is
photographed, estimated and baked: in a real Blender with a window.

PYTHONPATH=tests/blender:tests/core/made python tests/benchmarks/window_blocked.py [--faces 500000] [--ngon]
    [--subdivided] [--frames 4] [--size 4096]

Needs MPSNET_BLENDER and MPSNET_BLENDER_UI, and takes MPSNET_EXTENSION_ZIP, see tests/blender/conftest.py. Told are
how long the press of the button takes, the longest block while the work runs, and the longest once it is done, when its
result is loaded and the viewport drawn with it; by the clock, and by the processor time of Blender's main thread, which
what else the machine does changes less.

What Blender does in one go blocks the window for as long as it takes: it evaluates the modifiers when *Bake Texture*
is pressed where a render shows other levels than the viewport (--subdivided), goes to each frame and back where the
texture follows an animation (--frames), and draws the viewport anew with what has changed.
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
    parser.add_argument("--subdivided", action="store_true", help="by a modifier that shows in renders alone")
    parser.add_argument("--frames", type=int, default=1, help="that the texture follows, on a surface that moves")
    parser.add_argument("--size", type=int, default=512, help="of the texture in pixels")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        blender = Blender(shlex.split(os.environ["MPSNET_BLENDER"]), Path(folder) / "user")
        blender.user.mkdir()
        blender.run(
            "--command", "extension", "install-file", "-r", "user_default", "-e", os.environ["MPSNET_EXTENSION_ZIP"]
        )
        report = Path(folder) / "report.json"
        script = ["--python", SCRIPTS / "blocked.py", "--", report, json.dumps(vars(options))]
        command = [*shlex.split(os.environ["MPSNET_BLENDER_UI"]), *map(str, script)]
        subprocess.run(command, env=blender.environment, capture_output=True, check=True, timeout=TIMEOUT)
        for step, found in json.loads(report.read_text(encoding="utf-8")).items():
            begins, runs, ends = (
                f"{found[one][0]:.2f} s ({found[one][1]:.2f} s)" for one in ("begins", "runs", "ends")
            )
            print(
                f"{step}: by the clock (of processor time) pressing it takes {begins}, the window is blocked for at "
                f"most {runs} while it runs and {ends} when it is done, the viewport drawn {found['drawn']} times in "
                f"{found['seconds']:.0f} s"
            )


if __name__ == "__main__":
    main()

"""Run every command of the guided tour (docs/tutorials/tour.md) as it stands there, one after the other.

    python examples/tour.py                            leaves its files in examples/output/tour
    python examples/tour.py --blender COMMAND          what `blender` in the text stands for, if not on the path
    python examples/tour.py --list                     only show the commands

Commands are ``bash`` blocks; the first that fails ends the tour.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TOUR = HERE.parent / "docs" / "tutorials" / "tour.md"
OUTPUT = HERE / "output" / "tour"


def blocks(text):
    """The bash blocks of a Markdown text, in order."""
    return re.findall(r"^```bash\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def script(commands):
    """One script of all commands, so that what one sets, `cd` for instance, holds for the next."""
    steps = [f"block={number}\n{command}" for number, command in enumerate(commands, 1)]
    told = 'echo "the tour stopped in block $block of its commands, see above" >&2'
    return "\n".join(["set -Eeuo pipefail", f"trap '{told}' ERR", "set -v", *steps])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", help="command that starts Blender with the extension installed")
    parser.add_argument("--list", action="store_true", help="show the commands and do nothing")
    options = parser.parse_args()
    commands = blocks(TOUR.read_text(encoding="utf-8"))
    if options.list:
        print("\n".join(commands))
        return
    if not shutil.which("bash"):
        raise SystemExit("the tour's commands are for bash, which is not on the path; on Windows, run this in WSL")
    shutil.rmtree(OUTPUT, ignore_errors=True)
    with tempfile.TemporaryDirectory() as tools:
        if options.blender:
            blender = Path(tools) / "blender"
            # Without this folder on the path: the command may itself look for a `blender`.
            blender.write_text(f'#!/bin/bash\nPATH=${{PATH#*:}} exec {options.blender} "$@"\n', encoding="utf-8")
            blender.chmod(0o755)
        # mpsnet stands beside the Python that runs this, which need not be on the path.
        places = [tools, str(Path(sys.executable).parent), os.environ.get("PATH", "")]
        environment = {**os.environ, "PATH": os.pathsep.join(places)}
        done = subprocess.run(["bash", "-c", script(commands)], cwd=HERE.parent, env=environment)
    if done.returncode:
        raise SystemExit(done.returncode)
    print(f"the tour's files are in {OUTPUT}")


if __name__ == "__main__":
    main()

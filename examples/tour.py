"""Run every command of the guided tour (README.md beside this file) as it stands there, one after the other.

    python examples/tour.py                              in examples/output/tour
    python examples/tour.py --blender "blender"          what `blender` in the text stands for, if it is not on the path
    python examples/tour.py --list                       only show them

A command is a ``bash`` block. The first that fails ends the tour with its number and exit code.
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
TOUR = HERE / "README.md"
OUTPUT = HERE / "output" / "tour"


def blocks(text):
    """The bash blocks of a Markdown text, in order."""
    return re.findall(r"^```bash\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def run(commands, folder, tools):
    """Run the commands in `folder`, with the programs in `tools` before all others."""
    # mpsnet stands beside the Python that runs this, which need not be on the path.
    places = [str(tools), str(Path(sys.executable).parent), os.environ.get("PATH", "")]
    environment = {**os.environ, "PATH": os.pathsep.join(places)}
    for number, command in enumerate(commands, 1):
        print(f"-- {number} of {len(commands)}\n{command}", flush=True)
        done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], cwd=folder, env=environment)
        if done.returncode:
            raise SystemExit(f"command {number} of the tour failed with exit code {done.returncode}; see above")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--blender", help="command that starts Blender with the extension installed")
    parser.add_argument("--list", action="store_true", help="show the commands and do nothing")
    options = parser.parse_args()
    commands = blocks(TOUR.read_text(encoding="utf-8"))
    if options.list:
        print("\n".join(commands))
        return
    shutil.rmtree(OUTPUT, ignore_errors=True)
    OUTPUT.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as tools:
        if options.blender:
            blender = Path(tools) / "blender"
            blender.write_text(f'#!/bin/bash\nexec {options.blender} "$@"\n', encoding="utf-8")
            blender.chmod(0o755)
        run(commands, OUTPUT, Path(tools))
    print(f"the tour's files are in {OUTPUT}")


if __name__ == "__main__":
    main()

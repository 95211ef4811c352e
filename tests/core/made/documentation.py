"""What tests read of the documentation: its pages, the code in them, and how that runs as it stands."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[3]
# The pages that docs/generated_pages.py writes.
GENERATED = {PROJECT / "docs" / "reference" / name for name in ("command_line.md", "python.md", "blender.md")}
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *sorted((PROJECT / "docs").rglob("*.md"))]
WRITTEN = [page for page in PAGES if page not in GENERATED and "_build" not in page.parts]


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(page: Path, program: str) -> list[list[str]]:
    """The arguments of a program's calls, without its name, in a page's shell blocks and its tables' last columns."""
    found = []
    rows = re.findall(r"^\|.*\| `([^`]+)`[^|]*\|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    for block in (*blocks(page, "bash"), *rows):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(re.sub(r"(^|\s)#\s.*", "", line))
            if words and words[0] == program:
                found.append(words[1:])
    return found


# What of the pages does not run, by a pattern of its line, and why.
LEFT_OUT = {
    r"\bpip install\b|\bsudo\b|^python3 -m venv|\.venv/bin/": "installs or builds, by the network; .ci/run does it",
    r"--command extension install-file": "needs a Blender; tests/blender/test_install.py does it",
    r"mpsnet train|train_default\.py|evaluate patch-sizes": "takes hours; test_train_cli.py trains small ones",
    r"evaluate diligent": "needs DiLiGenT's photographs; tests/core/test_diligent.py makes its own",
    r"mpsnet scan": "searches all around the mesh, for minutes; tests/core/test_calibrate_mesh.py does it",
    r"tensorboard|http\.server": "serves until it is stopped",
}
# What runs otherwise than it stands.
INSTEAD = {
    # The page's own takes hours.
    r"--count \d+": "--count 2",
    r"range\(1000\)": "range(2)",
    r"--model all": "--model lambertian",
    r"(mpsnet|blender_addon) try-it": r"\1 try-it --pixels 128 --samples 4 --size 128",
    r"\brender-samples\b": "render-samples --samples 4",
    r"--width 512 --height 512": "--width 128 --height 128",
    r"practice_photos\.py$": "practice_photos.py --pixels 512 --samples 8",
    r"^(blender -b --python examples/render_photo\.py)$": (
        r"sed -i.full 's/=512/=128/g; s/samples=64/samples=4/' examples/render_photo.py\n\1"
    ),
    # tests/core/test_presets.py has them all.
    r"for engine in blender unreal unity godot gltf": "for engine in unity",
    # A texture or picture of fewer pixels takes the same way; of two sizes the later one, the page's own, holds.
    r"--size (1024|2048)": "--size 256",
    r"\bsize=2048": "size=256",
    r"^mpsnet (bake|views)\b": r"mpsnet \1 --size 256",
    r"^mpsnet evaluate (materials|rendered|statues|colour)\b": r"mpsnet evaluate \1 --size 96",
    # The search all around the mesh is that of docs/tutorials/one_photo.md, which shows its overlay, and that of
    # tests/addon/test_align.py.
    r"--rig rig\.json -o camera\.json$": "--rig rig.json --points pairs.json -o camera.json",
    r'\bAlign\(image="photo\.dng"': 'Align(image="photo.dng", points="pairs.json"',
    r"\balign-photo --target StatueLow\b": r"\g<0> --start CAMERA",
    # Blender has the extension; pip's bpy has to load it.
    r"^import bpy$": "import bpy, blender_addon; blender_addon.register()",
}


def script(page: Path) -> str:
    """A page's shell and Python blocks as one shell script, without what LEFT_OUT names."""
    steps: list[str] = []
    text = page.read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(bash|python)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        for pattern, other in INSTEAD.items():
            block = re.sub(pattern, other, block, flags=re.MULTILINE)
        cell = language == "python" and not block.startswith(("import", "from"))
        if cell and steps and steps[-1].endswith("\nEND"):  # a notebook's next cell
            steps[-1] = f"{steps[-1][:-3]}{block}END"
        elif language == "python":
            steps.append(f"python - <<'END'\n{block}END")
        else:
            lines = [re.sub(r"(^|\s)#\s.*", "", line) for line in re.sub(r"&&\n", "&& ", block).splitlines()]
            steps += [line for line in lines if line and not any(re.search(pattern, line) for pattern in LEFT_OUT)]
    return "\n".join(steps)


def needs_blender(page: Path) -> bool:
    return re.search(r"\bblender\b|\bbpy\b|blender_addon|practice_photos", script(page)) is not None


def run_page(page: Path, folder: Path, programs: Mapping[str, str] | None = None) -> None:
    """Run a page in a folder; the first command that fails fails the test.

    programs: shell scripts that stand for programs, beside those for `python` and `mpsnet`.
    """
    if sys.platform == "win32" or shutil.which("bash") is None:
        pytest.skip("pages are for bash")
    if find_spec("torch") is None and re.search(r"\.training\b|mpsnet evaluate samples", script(page)):
        pytest.skip("needs PyTorch (the extra train)")
    tools = folder / ".tools"
    tools.mkdir()
    python = f'exec {shlex.quote(sys.executable)} "$@"'
    for name, body in {"python": python, "mpsnet": 'exec python -m mpsnet_core "$@"', **(programs or {})}.items():
        (tools / name).write_text(f"#!/bin/sh\n{body}\n", encoding="utf-8")
        (tools / name).chmod(0o755)
    path = os.pathsep.join([str(tools), os.environ.get("PATH", "")])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    shutil.copytree(PROJECT / "examples", folder / "examples", ignore=shutil.ignore_patterns("output", "__pycache__"))
    bash = ["bash", "-c", f"set -euxo pipefail\n{script(page)}"]
    done = subprocess.run(bash, cwd=folder, env=environment, capture_output=True, text=True, timeout=550)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]

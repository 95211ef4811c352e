"""The rooms of both packages import from below alone, and in no circle (pyproject.toml, tool.importlinter).

The sources are read, not imported: it takes no bpy.
"""

import ast
import subprocess
import sys
from pathlib import Path

import mpsnet_core

PROJECT = Path(__file__).resolve().parents[2]


def test_rooms_import_from_below_alone():
    code = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command(args=['--no-logo'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


def test_type_checkers_know_every_public_name(tmp_path):
    stub = ast.parse((PROJECT / "mpsnet_core" / "__init__.pyi").read_text(encoding="utf-8"))
    told = {
        one.name: part.module.removeprefix("mpsnet_core.")
        for part in stub.body
        if isinstance(part, ast.ImportFrom)
        for one in part.names
    }
    assert told == mpsnet_core._HOME
    (tmp_path / "user.py").write_text("from mpsnet_core import Estimate\nEstimate(typo=3)\n")
    done = subprocess.run([sys.executable, "-m", "mypy", str(tmp_path)], cwd=PROJECT, capture_output=True, text=True)
    assert 'Unexpected keyword argument "typo" for "Estimate"' in done.stdout

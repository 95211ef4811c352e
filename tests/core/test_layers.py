"""The layers of both packages import from below alone, and in no circle (pyproject.toml, tool.importlinter).

The sources are read, not imported: it takes no bpy.
"""

import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]


def test_layers_import_from_below_alone():
    code = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command(args=['--no-logo'])"
    done = subprocess.run([sys.executable, "-c", code], cwd=PROJECT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr

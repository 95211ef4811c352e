"""A folder with what a bake reads."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
from mesh_file import write_mesh
from uv_squares import squares

from mpsnet_core import Camera, NormalMap, write_camera, write_normals
from mpsnet_core.cli import main

TILTED = [0.6, 0.0, 0.8]


class Bench:
    """Four squares in two tiles, of two materials and two objects, and a view from above whose normals are known."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        pose = np.eye(4)
        pose[:3, 3] = [3.5, 0.5, 5]
        write_camera(folder / "camera.json", Camera("orthographic", 96, 16, [12, 12], None, pose))
        write_normals(folder / "n.png", NormalMap(np.broadcast_to(TILTED, (16, 96, 3)), np.ones((16, 96), bool)))
        self.squares("mesh.npz", (0, 0), (0.5, 0.5), (1, 0), (1.5, 0.5))

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    def squares(self, name: str, *places: tuple[float, float], **labels: str) -> Path:
        given = labels or {"materials": "skin skin Skin skin", "objects": "a a b/c b/c"}
        write_mesh(self / name, squares(*places, **given))
        return self / name

    def run(self, *arguments: str | Path, output: str, view: str = "") -> tuple[int, dict, str]:
        """`mpsnet bake`: its exit code, the result, and the sentence on stderr."""
        command: list[str | Path] = ["bake", "--view", view or f"{self / 'camera.json'}={self / 'n.png'}"]
        command += ["--size", "32", "--space", "object", "--progress", "json", "-o", self / output]
        if "--mesh" not in arguments:
            command += ["--mesh", self / "mesh.npz"]
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
            code = main([str(word) for word in (*command, *arguments)])
        last = json.loads(out.getvalue().splitlines()[-1])
        return code, last.get("result", {}), err.getvalue()

    def refused(self, *arguments: str | Path, output: str, view: str = "") -> str:
        code, _, sentence = self.run(*arguments, output=output, view=view)
        assert code == 2 and "Traceback" not in sentence and len(sentence.splitlines()) == 1, sentence
        return sentence

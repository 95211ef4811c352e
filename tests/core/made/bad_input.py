"""Bad input and the one sentence that it gets.

A case is a name, what brings the bad input about on a `Bench`, and the words that its sentence must hold, in order,
parted by "…". Where the words tell what the case is, they are its name. Command lines run in this process, with what
they print on stderr as their sentence.
"""

import contextlib
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_file import write_mesh
from synthetic import diligent_object, shaded_sphere, write_file

from mpsnet_core import Camera, Mesh, NormalMap, write_camera, write_normals, write_rig
from mpsnet_core.cli import main
from mpsnet_core.errors import LONGEST, InputError

SPHERE = shaded_sphere(16)
NAN = float("nan")
# A square that faces +z, its UVs the whole texture.
SQUARE: dict[str, Any] = {
    "vertices": np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]),
    "triangles": np.array([[0, 1, 2], [0, 2, 3]]),
    "corner_normals": np.tile([0, 0, 1.0], (2, 3, 1)),
    "uvs": np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1.0]]]),
}


class Bench:
    """A folder with what each verb needs, in good order, and ways to make the same in bad order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    def text(self, name: str, text: str) -> Path:
        (self / name).write_text(text)
        return self / name

    def bytes(self, name: str, data: bytes) -> Path:
        (self / name).write_bytes(data)
        return self / name

    def rig(self, name: str = "rig.json", **changes: Any) -> Path:
        write_rig(self / name, SPHERE.rig)
        return self.changed(self / name, changes)

    def camera(self, name: str = "camera.json", **changes: Any) -> Path:
        write_camera(self / name, Camera("orthographic", 16, 16, (8, 8)))
        return self.changed(self / name, changes)

    def changed(self, path: Path, changes: dict[str, Any]) -> Path:
        data = json.loads(path.read_text()) | changes
        path.write_text(json.dumps({key: value for key, value in data.items() if value is not None}))
        return path

    def photo(self, name: str = "photo.exr", pixels: np.ndarray = SPHERE.image, kind: str = "float") -> Path:
        return write_file(self / name, pixels, kind)

    def replaced(self, path: Path, old: bytes, new: bytes) -> Path:
        """The same file with some of its bytes changed."""
        data = path.read_bytes()
        assert old in data
        return self.bytes(path.name, data.replace(old, new))

    def mask(self, values: np.ndarray = SPHERE.mask) -> Path:
        return write_file(self / "mask.png", values, "uint8")

    def normals(self, name: str = "normals.png", size: int = 16) -> Path:
        sphere = shaded_sphere(size)
        write_normals(self / name, NormalMap(sphere.normals, sphere.mask))
        return self / name

    def mesh(self, name: str = "mesh.npz", **changes: Any) -> Path:
        """The square as the add-on writes it; None takes an array out."""
        write_mesh(self / name, Mesh(**SQUARE))
        with np.load(self / name) as data:
            arrays = {**data, **changes}
        np.savez(self / name, **{key: value for key, value in arrays.items() if value is not None})
        return self / name

    def diligent(self, **files: str) -> Path:
        """DiLiGenT's layout with one object; `files` overwrites a file's text, "" removes it."""
        diligent_object(self / "pmsData", "ball")
        for name, text in files.items():
            path = next((self / "pmsData" / "ballPNG").glob(f"{name}*"))
            path.write_text(text) if text else path.unlink()
        return self / "pmsData"

    def run(self, *arguments: str | Path) -> None:
        """Run the command line; its one line on stderr is raised as an InputError."""
        words = io.StringIO()
        with contextlib.redirect_stderr(words), contextlib.redirect_stdout(io.StringIO()):
            code = main([str(argument) for argument in arguments])
        assert code == 2, f"exit code {code}: {words.getvalue()}"
        (line,) = words.getvalue().splitlines()
        assert line.startswith("mpsnet: ")
        raise InputError(line.removeprefix("mpsnet: "))

    def estimate(self, *photos: str | Path, output: str = "out.png", **options: str | Path) -> None:
        """`mpsnet estimate` with good values for what is not given."""
        given = {"rig": self.rig(), "mask": self.mask(), **options}
        flags = [part for key, value in given.items() for part in (f"--{key}", value)]
        self.run("estimate", *(photos or [self.photo()]), *flags, "-o", self / output)

    def bake(self, *arguments: str | Path, view: str | None = None, output: str = "texture.png") -> None:
        """`mpsnet bake` with good values for what is not given; later arguments win."""
        view = view or f"{self.camera()}={self.normals()}"
        good = ["--size", "32", "--margin", "2", "--view", view]
        if "--mesh" not in arguments:
            good += ["--mesh", self.mesh()]
        self.run("bake", *good, "-o", self / output, *arguments)

    def evaluate(self, *arguments: str | Path) -> None:
        self.run("evaluate", "diligent", self.diligent(), "--lights", "1,2,3", *arguments)


def cut(path: Path, share: float = 0.6) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


def with_pixel(value: float) -> np.ndarray:
    image = SPHERE.image.copy()
    image[8, 9, 1] = value
    return image


def loop(path: Path) -> Path:
    """A link that leads to itself."""
    path.symlink_to(path.name)
    return path


Case = tuple[str, Callable[[Bench], Any], str] | tuple[Callable[[Bench], Any], str]


def gets_one_clear_sentence(cases: list[Case]) -> Callable[..., None]:
    """A test of each of these cases."""

    @pytest.mark.filterwarnings("error")
    @pytest.mark.usefixtures("process_settings_restored")
    @pytest.mark.parametrize(
        ("bad_input", "words"), [pytest.param(*case[-2:], id=str(case[0 if len(case) > 2 else 1])) for case in cases]
    )
    def test(tmp_path: Path, capfd: pytest.CaptureFixture[str], bad_input: Callable[[Bench], Any], words: str) -> None:
        with pytest.raises(InputError) as caught:
            bad_input(Bench(tmp_path))
        sentence = str(caught.value)
        assert re.search(".*".join(map(re.escape, words.split("…"))), sentence), sentence
        assert "\n" not in sentence and "Traceback" not in sentence
        assert len(sentence.replace(str(tmp_path), "").replace("x" * 300, "")) <= LONGEST, sentence
        assert capfd.readouterr().err == ""
        assert not list(tmp_path.rglob("*unfinished*")) and not (tmp_path / "unpickled").exists()

    return test

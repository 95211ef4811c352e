"""The operation scan: from a photo and a mesh of the object to the texture, without any calibration."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from mpsnet_core.calibrate.operations import CalibrateMesh
from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.defaults import MASK, MAX_FOCAL, MIN_FOCAL
from mpsnet_core.estimate.alignment.operations import Align
from mpsnet_core.estimate.operations import Estimate, RunsModel
from mpsnet_core.operation import Operation, Result, option, optional, settings
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.operations import TakesMesh


@dataclass(frozen=True)
class Scanned(Result):
    """What was made of a photo and a mesh."""

    camera: str
    """File of the photo's camera."""
    rig: str
    """File of the lights."""
    normals: str
    """File of the photo's normal map."""
    texture: str
    """File of the texture on the mesh's UVs."""
    outputs: list[str]
    """All files."""


@dataclass(frozen=True)
class Scan(TakesMesh, RunsModel, ReadsPhotos):
    """Make a normal-map texture from one photo and a mesh: find the camera and the lights, estimate, and bake."""

    command: ClassVar[str] = "scan"

    image: str = option(positional=True, help="photo of the object under the three lights")
    mesh: str = option(help="the object's mesh, with UVs", path="file", provenance="content")
    mask: str = option(default=MASK, help="where the object is, as in `estimate`")
    focal: float | None = optional(
        "35 mm equivalent focal length of the lens, in millimetres",
        metavar="MM",
        low=MIN_FOCAL,
        high=MAX_FOCAL,
        unset="estimated too",
    )
    size: str = option(default="2048", metavar="N|WxH", help="texels along the texture's sides", numbers=True)
    output: str = option(help="folder for the camera, the rig, the normals and the texture", path="folder")

    def run(self, progress: Progress = silent) -> Scanned:
        """Write the four files, each as soon as it is made."""
        from mpsnet_core.bake.operations import Bake
        from mpsnet_core.bake.texture_files import bake_settings
        from mpsnet_core.io.files import check_no_overwrite, ensure_folder
        from mpsnet_core.io.frames import results_folder

        stem = Path(self.image).stem
        folder = results_folder(self.output, "a scan has several results", "results")
        named = [f"{stem}_{name}" for name in ("camera.json", "overlay.png", "rig.json", "normals.exr", "texture.png")]
        files = [str(folder / name) for name in named]
        check_no_overwrite([Path(self.image), *self.inputs(self.mesh, mask=self.mask)], files)
        camera, overlay, rig, normals, texture = files
        bake = Bake(**self._shared(Bake), view=(f"{camera}={normals}",), output=texture)
        bake_settings(bake, 0.0)  # a size or a mesh that cannot be baked is told before the search
        self.read_mesh(self.mesh)
        ensure_folder(folder, "results")
        place: dict[str, Any] = {"camera": camera}
        aligned = Align(**self._shared(Align), image=self.image, overlay=overlay, output=camera)
        aligned.run(part(progress, 0.0, 0.4))
        lights = CalibrateMesh(**self._shared(CalibrateMesh), **place, image=(self.image,), output=rig)
        lights.run(part(progress, 0.4, 0.5))
        options = self._shared(Estimate) | {"mesh": None, "focal": None}
        estimate = Estimate(**options, **place, image=(self.image,), rig=rig, output=normals)
        estimate.run(part(progress, 0.5, 0.9))
        bake.run(part(progress, 0.9, 1.0))
        text = "\n".join(files)
        return Scanned(camera, rig, normals, texture, files, text=text)

    def _shared(self, kind: type[Operation]) -> dict[str, Any]:
        """The options of another kind of operation that have the same name here, but its photo and output."""
        own = {setting.name for setting in settings(type(self))} - {"image", "output"}
        return {setting.name: getattr(self, setting.name) for setting in settings(kind) if setting.name in own}

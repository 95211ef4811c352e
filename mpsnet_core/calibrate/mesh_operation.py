"""The operation calibrate mesh: lights and crosstalk from a photo of an object whose mesh is known."""

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from mpsnet_core.capture.operations import TakesLightPhotos
from mpsnet_core.errors import SettingsError
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.operations import TakesMesh

if TYPE_CHECKING:
    from mpsnet_core.calibrate.lights_on_mesh import LightsOnMesh
    from mpsnet_core.calibrate.report import LightFacts
    from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Crosstalk below this share of a channel's own light is not written.
LEAST_CROSSTALK = 0.02
# Above this median difference between photo and fit, the mesh is probably not where the camera says.
POOR = 0.25


@dataclass(frozen=True)
class MeshCalibrated(Result):
    """The lights that fit a photo of a known mesh, and the file of their rig."""

    output: str
    """The rig file."""
    lights: "list[LightFacts]"
    """The lights, in the order of the camera's channels."""
    residual: float
    """Median relative difference between the photo and its fit."""
    paints: int
    """Number of paints of the object that were told apart."""


@dataclass(frozen=True)
class CalibrateMesh(TakesMesh, TakesLightPhotos):
    """Find the lights' directions and crosstalk from a photo of an object whose mesh is known.

    Any matt object with a scan, or a model that was printed, is a calibration target. Its paint may vary.
    """

    command: ClassVar[str] = "calibrate mesh"

    image: tuple[str, ...] = option(
        positional=True, help="photo of the object under the three lights, or three with --per-light"
    )
    mesh: str = option(help="the object's mesh in the camera's world", path="file")
    camera: str = option(help="camera file of the photo, as `mpsnet align` writes it", path="file")

    def run(self, progress: Progress = silent) -> MeshCalibrated:
        """Write the rig file."""
        import numpy as np

        from mpsnet_core.calibrate.lights_on_mesh import lights_of_photo
        from mpsnet_core.calibrate.report import LightFacts
        from mpsnet_core.io.files import prefix_errors, write_json
        from mpsnet_core.io.image import CHANNELS
        from mpsnet_core.scene.camera import read_camera
        from mpsnet_core.scene.rig import angles_of, write_rig

        files = self.photos(self.image, self.mesh, self.camera)
        camera, mesh = read_camera(self.camera), self.read_mesh(self.mesh, shape_only=True)
        source, *others = self.sources(files, self.mask)
        if others:
            raise SettingsError(f"{len(files)} photos where one is needed; with --per-light, three of one light each")
        image, mask, _ = self.photo_and_mask(source, progress)
        progress(0.3, "fitting the lights")
        with prefix_errors(source):
            found = lights_of_photo(image, mask, camera, mesh, mixed=not self.per_light)
            # Under these lights, the shading may show another encoding.
            again, mask, _ = self.photo_and_mask(replace(source, rig=_rig_of(found)), progress)
            if not np.array_equal(again.pixels, image.pixels):
                found = lights_of_photo(again, mask, camera, mesh, mixed=not self.per_light)
            rig = _rig_of(found)
        write_rig(self.output, rig)
        facts = zip(CHANNELS, rig.directions, *angles_of(rig.directions), found.errors, strict=True)
        lights = [
            LightFacts(name, light.tolist(), float(slant), float(tilt), uncertainty=float(error))
            for name, light, slant, tilt, error in facts
        ]
        if found.residual > POOR:
            words = "the mesh explains the photo badly (typical difference %.0f%%): check the camera and the mesh, and "
            log.warning(words + "that the object is matt [mesh-misfit]", 100 * found.residual)
        text = "\n".join([*map(str, lights), f"{self.output}: the rig"])
        result = MeshCalibrated(self.output, lights, round(found.residual, 4), found.paints, text=text)
        if self.json:
            write_json(self.json, result.metrics())
        progress(1.0, "done")
        return result


def _rig_of(found: "LightsOnMesh") -> "LightRig":
    import numpy as np

    from mpsnet_core.scene.rig import LightRig

    crosstalk = found.mixing * (1 - np.eye(3))
    return LightRig(found.directions, found.mixing if crosstalk.max() > LEAST_CROSSTALK else np.eye(3))

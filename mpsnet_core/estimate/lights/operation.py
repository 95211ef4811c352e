"""The operation calibrate photo: the lights, found in photos of any object."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from mpsnet_core.capture.operations import TakesLightPhotos
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:
    from mpsnet_core.estimate.lights.find import LightFound


@dataclass(frozen=True)
class PhotoCalibrated(Result):
    """The lights that were found in photos, and the file of their rig."""

    output: str
    """The rig file."""
    lights: "list[LightFound]"
    """The lights, in the order of the camera's channels."""


@dataclass(frozen=True)
class CalibratePhoto(TakesLightPhotos):
    """Find the lights' directions in photos of any object, without a ball.

    They are less exact than those of a mirror ball: several photos or frames under the same lights help.
    """

    command: ClassVar[str] = "calibrate photo"

    image: tuple[str, ...] = option(
        positional=True, help="photo(s) under the same three lights, a folder of them, or a pattern (frame_####.png)"
    )

    def run(self, progress: Progress = silent) -> PhotoCalibrated:
        """Write the rig file."""
        from mpsnet_core.estimate.lights.find import find_lights_of
        from mpsnet_core.io.files import write_json
        from mpsnet_core.scene.rig import write_rig

        files = self.photos(self.image)
        progress(0.0, f"looking for the lights in {files[0].name}")
        found = find_lights_of(self.sources(files, self.mask), self.read_options())
        write_rig(self.output, found.rig)
        lines = "\n".join(map(str, found.facts()))
        result = PhotoCalibrated(self.output, found.facts(), text=f"{lines}\n{self.output}: the rig")
        if self.json:
            write_json(self.json, result.metrics())
        progress(1.0, "done")
        return result

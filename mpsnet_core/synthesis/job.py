"""Job: which samples a folder holds or shall hold; kept in the folder as ``job.json``."""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from mpsnet_core.errors import InputError
from mpsnet_core.files import read_json, write_json

JOB_FORMAT = "mpsnet-samples"
JOB_VERSION = 1
JOB_FILE = "job.json"
SHAPES = ("blobs", "drapery", "reliefs", "composites", "groups", "meshes", "scene")
MAX_COUNT = 10_000_000


@dataclass(frozen=True)
class SampleJob:
    """What samples 0 to count - 1 are drawn from.

    renderer: "synthesis" (this package) or "cycles" (Blender). size: pixels a side. shapes: kinds of shapes to draw
    from. meshes: folder of mesh files, for "meshes". objects: names of the objects in the job's ``scene.blend``, for
    "scene" (cycles only). merl: folder of MERL ``.binary`` files, or the ``.npz`` of neural fits; with "" all materials
    are principled (synthesis only). views: how many samples in a row show the same shape. bounces: 0 or more.
    samples: Cycles samples a pixel. denoise: whether Cycles' light is denoised. supersampling: rays a pixel's side.
    """

    renderer: Literal["synthesis", "cycles"]
    count: int
    seed: int = 0
    size: int = 256
    shapes: tuple[str, ...] = ("blobs", "drapery", "reliefs", "composites", "groups")
    meshes: str = ""
    objects: tuple[str, ...] = ()
    merl: str = ""
    views: int = 1
    bounces: int = 1
    samples: int = 64
    denoise: bool = True
    supersampling: int = 1


def sample_path(folder: str | os.PathLike[str], number: int) -> Path:
    """Where sample `number` of the job in `folder` is kept."""
    return Path(folder) / f"sample_{number:06d}.exr"


def read_job(folder: str | os.PathLike[str]) -> SampleJob:
    """The job of a folder. Raises InputError where there is none or it is malformed."""
    names = tuple(SampleJob.__dataclass_fields__)
    data = read_json(Path(folder) / JOB_FILE, JOB_FORMAT, JOB_VERSION, names)
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in data.items() if key in names}
    try:
        return SampleJob(**values)
    except TypeError as error:
        raise InputError(f"{Path(folder) / JOB_FILE}: {error}") from None


def write_job(folder: str | os.PathLike[str], job: SampleJob) -> None:
    """Keep the job in its folder, whole or not at all."""
    write_json(Path(folder) / JOB_FILE, {"format": JOB_FORMAT, "version": JOB_VERSION, **asdict(job)})

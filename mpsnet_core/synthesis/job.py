"""Jobs: descriptions of the samples of a folder, stored in it as ``job.json``."""

import os
import re
import time
from dataclasses import MISSING, asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from mpsnet_core.errors import FileError, FormatError, InputError, SettingsError, check_choice
from mpsnet_core.io.claims import LOCK_FILE, Claims
from mpsnet_core.io.files import check_no_link, ensure_folder, read_json, write_json
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.synthesis.field_limits import check_fields, limited, with_tuples

JOB_FORMAT = "mpsnet-samples"
JOB_VERSION = 1
JOB_FILE = "job.json"
CONTACT_SHEET = "contact_sheet.png"
SHAPES = ("blobs", "drapery", "reliefs", "groups", "hollows", "meshes", "scene")
MAX_COUNT = 10_000_000
MAX_BOUNCES = 3  # of the synthesis
# Workers claim samples by number; this number claims the folder's other files.
FOLDER_CLAIM = MAX_COUNT
FOLDER_SECONDS = 20.0

_NUMBER = "[0-9]{6}|[1-9][0-9]{6,7}"  # of a sample, in the name of its file
# Settings that another run of the same job may change.
_NOT_OF_SAMPLES = ("count", "sample_seconds")


@dataclass(frozen=True)
class SampleJob:
    """Settings from which samples 0 to count - 1 are drawn.

    Raises SettingsError if a value is out of range or settings are incompatible.
    """

    renderer: Literal["synthesis", "cycles"]
    """"synthesis" (this package) or "cycles" (Blender)."""
    count: int = limited(MISSING, 1, MAX_COUNT)
    """Number of samples."""
    seed: int = limited(0, 0, 2**63 - 1)
    """Seed of the random draws: the same seed gives the same samples."""
    size: int = limited(256, 8, 8192)
    """Side of the images in pixels."""
    shapes: tuple[str, ...] = ("blobs", "drapery", "reliefs", "groups")
    """Kinds of shapes."""
    meshes: str = ""
    """Folder of mesh files, for the shapes "meshes"."""
    objects: tuple[str, ...] = ()
    """Names of the objects in the job's ``scene.blend``, for the shapes "scene" (cycles only)."""
    merl: str = ""
    """Folder of MERL ``.binary`` files, or the ``.npz`` of neural fits; if empty, all materials are principled
    (synthesis only)."""
    merl_part: Literal["all", "training", "validation"] = "all"
    """Which measured materials to use: every fifth, sorted by name, is in "validation", the others in "training"."""
    views: int = limited(1, 1, 10_000)
    """Number of consecutive samples that show the same shape."""
    bounces: int = limited(1, 0, 32)
    """Maximum number of bounces between surfaces; at most 3 for synthesis."""
    samples: int = limited(48, 1, 65536)
    """Cycles samples per pixel."""
    denoise: bool = True
    """Whether to denoise Cycles' indirect light."""
    supersampling: int = limited(1, 1, 16)
    """Rays along a pixel's side."""
    style: Literal["photographs", "paper", "paper-all-materials", "paper-one-rig"] = "photographs"
    """"photographs" covers what users photograph. "paper" is like the MPS-Net paper (synthesis only): its rig and the
    rigs of its evaluation, two or more measured materials that are matt and of weak colour, no paint, dirt or fine
    relief. "paper-all-materials" takes glossy, metallic and strongly coloured ones besides, as the paper does.
    "paper-one-rig" takes these too, and the paper's own rig only."""
    rigs: Literal["around", "any"] = "around"
    """"around": three lights around the camera, about 120 degrees apart. "any": each anywhere in front of the object,
    and often all on one side, as long as they determine a normal. For the style "photographs"; the paper's have their
    own rigs."""
    sample_seconds: int = limited(3600, 1, 10_000_000)
    """Time limit in seconds of a worker for one sample."""

    def __post_init__(self) -> None:
        check_fields(self, "the job's")
        for name in ("shapes", "objects"):
            entries = getattr(self, name)
            if len(set(entries)) < len(entries):
                raise SettingsError(f"the job's {name} name one twice ({', '.join(entries)}); name each once")
        if not self.shapes:
            raise SettingsError(f"the job has no shapes; choose some of {', '.join(SHAPES)}")
        for shape in self.shapes:
            check_choice("shape", shape, SHAPES)
        self._check_together()

    def _check_together(self) -> None:
        """Check settings that depend on each other."""
        for kind, what, named in (("meshes", "folder", self.meshes), ("scene", "objects", self.objects)):
            if (kind in self.shapes) != bool(named):
                raise SettingsError(f"the job's shapes have {kind} where it names their {what}; name both, or neither")
        if self.renderer == "synthesis" and "scene" in self.shapes:
            raise SettingsError("a scene's objects are rendered by Blender alone; take other shapes for synthesis")
        if self.renderer == "synthesis" and self.bounces > MAX_BOUNCES:
            raise SettingsError(f"synthesis follows light over 0 to {MAX_BOUNCES} bounces, not {self.bounces}")
        if self.style != "photographs" and not self.merl:
            raise SettingsError("the paper's samples are of measured materials; name them (merl)")
        if self.style != "photographs" and self.rigs != "around":
            raise SettingsError("the paper's samples have the paper's rigs; leave out where the lights are (rigs)")
        if self.renderer == "cycles" and self.merl:
            raise SettingsError("measured materials (merl) are for synthesis alone; leave them out for Blender")


def sample_path(folder: AnyPath, number: int) -> Path:
    """The file of sample `number` of the job in `folder`."""
    return Path(folder) / f"sample_{number:06d}.exr"


def sample_number(name: str) -> int | None:
    """The number of the sample whose file, complete or unfinished, has this name; None if it is no sample's."""
    found = re.match(rf"\.?sample_({_NUMBER})\.", name)
    return int(found[1]) if found else None


def samples_there(folder: AnyPath) -> set[int]:
    """Numbers of the samples in a folder. Empty files, which a power cut may leave, do not count."""
    with os.scandir(folder) as entries:
        whole = [entry for entry in entries if re.fullmatch(rf"sample_({_NUMBER})\.exr", entry.name)]
        return {int(entry.name[7:-4]) for entry in whole if entry.stat().st_size}


def read_job(folder: AnyPath) -> SampleJob:
    """The job of a folder. Raises FileError if there is none, FormatError if it is malformed."""
    names = tuple(SampleJob.__dataclass_fields__)
    data = read_json(Path(folder) / JOB_FILE, JOB_FORMAT, JOB_VERSION, names)
    values = with_tuples({key: value for key, value in data.items() if key in names})
    for name in ("renderer", "count"):
        if name not in values:
            raise FormatError(f'{Path(folder) / JOB_FILE} lacks "{name}"; add it')
    try:
        return SampleJob(**values)
    except InputError as error:
        raise FormatError(f"{Path(folder) / JOB_FILE}: {error}") from None


def write_job(folder: AnyPath, job: SampleJob) -> None:
    """Write the job to its folder, atomically. Raises FileError if its path is a link."""
    path = Path(folder) / JOB_FILE
    check_no_link(path)
    write_json(path, {"format": JOB_FORMAT, "version": JOB_VERSION, **asdict(job)})


def place_job(folder: AnyPath, job: SampleJob) -> bool:
    """Assign the job to a new or empty folder, or to one with the same job, whose count it may increase.

    Returns whether the folder had no job before. Raises SettingsError if the folder has another job, naming the
    difference, and FileError if it has samples without a job or cannot be created.
    """
    folder = ensure_folder(folder, "samples")
    with Claims(folder) as claims:
        deadline = time.monotonic() + FOLDER_SECONDS
        while True:
            with claims.claim(FOLDER_CLAIM) as ours:
                if ours:
                    return _place(folder, job)
            if time.monotonic() > deadline:
                raise FileError(f"{folder} is being written by another run; try again once that is done")
            time.sleep(0.05)


def withdraw_job(folder: Path, *others: str) -> None:
    """Remove a job's own files, and `others`, from its folder, unless there are samples of it."""
    if not samples_there(folder):
        for name in (JOB_FILE, LOCK_FILE, *others):
            (folder / name).unlink(missing_ok=True)


def _place(folder: Path, job: SampleJob) -> bool:
    if not (folder / JOB_FILE).exists():
        if samples_there(folder):
            raise FileError(f"{folder} holds samples but no {JOB_FILE}; choose another folder")
        write_job(folder, job)
        return True
    found = read_job(folder)
    for name in SampleJob.__dataclass_fields__:
        theirs, ours = getattr(found, name), getattr(job, name)
        if name not in _NOT_OF_SAMPLES and theirs != ours:
            raise SettingsError(
                f"{folder} holds another job: its {name} is {_format(theirs)}, not {_format(ours)}; "
                "choose another folder or the same settings"
            )
    if job.count > found.count:
        write_job(folder, replace(found, count=job.count))
    return False


def _format(value: object) -> str:
    return ", ".join(map(str, value)) or "empty" if isinstance(value, tuple) else str(value) or "empty"

"""Operations on training samples: make them without Blender, resume a job, and show samples."""

import os
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from mpsnet_core.errors import InputError, SettingsError
from mpsnet_core.operation import Operation, Result, option, optional
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.synthesis.field_limits import limits_of
from mpsnet_core.synthesis.job import CONTACT_SHEET, MAX_BOUNCES, SampleJob, read_job

# On one machine.
MAX_PROCESSES = 1024
# Most skipped files that `show` lists by name; all are counted.
NAMED = 10


def job_number(name: str, help: str) -> Any:
    """The option for the integer setting `name` of a job."""
    low, high = limits_of(SampleJob)[name]
    return option(default=getattr(SampleJob, name, MISSING), low=low, high=high, help=help)


@dataclass(frozen=True)
class SamplesMade(Result):
    """The samples of a folder that were asked for."""

    output: str
    """The folder."""
    made: int
    """Number of samples made now."""
    there: int
    """Number of samples that were already there."""
    contact_sheet: str
    """File of the folder's contact sheet."""


@dataclass(frozen=True)
class ExampleWritten(Result):
    """The files to try everything with."""

    output: str
    """The folder."""
    commands: list[str]
    """What to type in that folder, line by line."""


@dataclass(frozen=True)
class Example(Operation):
    """Write photos, a scan and true normals to try everything with, and say what to type."""

    command: ClassVar[str] = "example"

    output: str = option(
        default="example", metavar="FOLDER", help="folder for the files", path="folder", provenance="none"
    )

    def run(self, progress: Progress = silent) -> ExampleWritten:
        """Write the files that :func:`mpsnet_core.synthesis.example.write_example` names, unless all are there."""
        progress(0.0, "making the example")
        from mpsnet_core.io.files import ensure_folder, write_transaction
        from mpsnet_core.synthesis.example import COMMANDS, FILES, write_example

        folder = ensure_folder(self.output, "example")
        if self.overwrite or not all((folder / name).is_file() for name in FILES):
            with write_transaction():
                write_example(folder)
        lines = [f"{folder}{os.sep}{name}: {what}" for name, what in FILES.items()]
        lines += ["", "Now type:", "", f'cd "{folder}"' if " " in str(folder) else f"cd {folder}"]
        lines += [line for command, what in COMMANDS.items() for line in (f"# {what}", command)]
        return ExampleWritten(self.output, list(COMMANDS), text="\n".join(lines))


@dataclass(frozen=True)
class RunsWorkers(Operation):
    """The workers that make samples: processes on this machine, or a cluster."""

    heading: ClassVar[str] = "the workers that make the samples"

    processes: int = option(
        default=0,
        low=0,
        high=MAX_PROCESSES,
        help="how many processes run at the same time on this machine. 0: one for each CPU core",
        provenance="none",
    )
    cluster: str = option(
        default="",
        metavar="ADDRESS",
        help="address of a Dask scheduler, whose workers make the samples",
        provenance="none",
    )
    cluster_trusted: bool = option(
        default=False,
        help="trust everybody in the network to run code here: the address needs no tls://",
        provenance="none",
    )

    def make(self, folder: str, job: SampleJob, progress: Progress, blender: str = "", addon: str = "") -> SamplesMade:
        """Make the samples of `job` that are missing in `folder`.

        blender, addon: as in :func:`mpsnet_core.synthesis.farm.run.blender_command`. Raises InputError as in
        `make_samples`, and if a sample could not be made.
        """
        from mpsnet_core.synthesis.farm.run import SYNTHESIS_COMMAND, blender_command, make_samples

        command = SYNTHESIS_COMMAND if job.renderer == "synthesis" else blender_command(blender, addon)
        workers: dict[str, Any] = {name: getattr(self, name) for name in ("processes", "cluster", "cluster_trusted")}
        outcome = make_samples(folder, job, command, **workers, progress=progress)
        facts = f"{outcome.made} made, {outcome.there} there already"
        if outcome.failed:
            number, sentence = min(outcome.failed.items())
            count = len(outcome.failed)
            raise InputError(f"{folder}: {count} of {job.count} samples failed, {facts}; sample {number}: {sentence}")
        sheet = str(Path(folder) / CONTACT_SHEET)
        return SamplesMade(folder, outcome.made, outcome.there, sheet, text=f"{folder}: {facts}")


@dataclass(frozen=True)
class Synthesize(RunsWorkers):
    """Make training samples without Blender."""

    command: ClassVar[str] = "synthesize"

    count: int = job_number(
        "count", "how many samples the folder will hold in total. A larger count continues where a smaller one stopped"
    )
    seed: int = job_number("seed", "seed of the random draws: the same seed gives the same samples")
    size: int = job_number("size", "width and height of a sample in pixels")
    shapes: str | None = optional(
        "kinds of shapes: blobs, drapery, reliefs, groups, hollows, meshes; if not given, meshes with --meshes, "
        "else all others",
        metavar="KIND,...",
    )
    meshes: str = option(default="", metavar="FOLDER", help="folder of mesh files to take shapes from", path="folder")
    merl: str = option(default="", metavar="PATH", help="measured materials: a folder of MERL files, or .npz of fits")
    merl_part: Literal["all", "training", "validation"] = option(
        default=SampleJob.merl_part,
        metavar="PART",
        choices={"all": "", "training": "four in five", "validation": "the remaining fifth"},
        help="which of the measured materials",
    )
    style: Literal["photographs", "paper", "paper-all-materials", "paper-one-rig"] = option(
        default=SampleJob.style,
        choices={
            "photographs": "scenes that users photograph",
            "paper": "as in the MPS-Net paper: its rigs, matt measured materials only",
            "paper-all-materials": "the same, with glossy and strongly coloured materials besides",
            "paper-one-rig": "as paper-all-materials, with its own rig alone, as for its table 1",
        },
        help="style of the samples",
    )
    rigs: Literal["around", "any"] = option(
        default=SampleJob.rigs,
        choices={"around": "around the camera, about 120° apart", "any": "anywhere, and often on one side"},
        help="where the three lights of photographs are",
    )
    views: int = job_number("views", "samples in a row that show one shape, each in another pose, light and material")
    bounces: int = option(
        default=SampleJob.bounces,
        low=0,
        high=MAX_BOUNCES,
        help="how many times light bounces between surfaces at most, drawn for each sample. 0: none",
    )
    supersampling: int = job_number("supersampling", "rays along a pixel's side")
    output: str = option(
        metavar="FOLDER",
        help="folder for the samples; one begun with the same settings is continued",
        path="folder",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> SamplesMade:
        """Make the samples that are missing in the folder."""
        from mpsnet_core.synthesis.reflectance import material_names
        from mpsnet_core.synthesis.shapes import mesh_files

        job = self.job()
        # Report missing files before starting.
        if job.meshes:
            mesh_files(job.meshes)
        if job.merl:
            material_names(job.merl)
        return self.make(self.output, job, progress)

    def job(self) -> SampleJob:
        """The job of the samples. Raises SettingsError as in `SampleJob`."""
        from mpsnet_core.io.files import resolved

        if self.shapes is not None:
            shapes = tuple(name.strip() for name in self.shapes.split(",") if name.strip())
        else:
            shapes = ("meshes",) if self.meshes else SampleJob.shapes
        same = ("count", "seed", "size", "merl_part", "views", "bounces", "supersampling", "style", "rigs")
        # Workers may have another working directory.
        meshes, merl = (str(resolved(place)) if place else "" for place in (self.meshes, self.merl))
        settings = {name: getattr(self, name) for name in same}
        return SampleJob("synthesis", shapes=shapes, meshes=meshes, merl=merl, **settings)


@dataclass(frozen=True)
class MakeSamples(RunsWorkers):
    """Resume making a folder's training samples."""

    command: ClassVar[str] = "make"

    folder: str = option(positional=True, help="folder in which a job of samples was begun", provenance="none")
    blender: str = option(default="", metavar="PROGRAM", help="Blender to render with", unset="this Python's bpy")
    addon: str = option(
        default="", metavar="MODULE", help="module of the extension in that Blender", unset="one that is always enabled"
    )

    def run(self, progress: Progress = silent) -> SamplesMade:
        """Make the samples of the folder's job that are missing."""
        job = read_job(self.folder)
        if self.blender and job.renderer != "cycles":
            raise SettingsError(f"the samples of {self.folder} are made without Blender; leave --blender out")
        return self.make(self.folder, job, progress, self.blender, self.addon)


@dataclass(frozen=True)
class Work(Operation):
    """Make samples of a folder, by numbers from stdin; called by the farm only."""

    command: ClassVar[str] = "work"
    listed: ClassVar[bool] = False

    folder: str = option(positional=True, help="folder in which a job of samples was begun", provenance="none")

    def run(self, progress: Progress = silent) -> Result:
        """Make samples until stdin ends."""
        from mpsnet_core.synthesis.farm.work import serve
        from mpsnet_core.synthesis.make import make_sample

        serve(self.folder, make_sample)
        return Result(text="")


@dataclass(frozen=True)
class SamplesShown(Result):
    """Samples or photos in one image, and statistics of them."""

    output: str
    """File of the image."""
    samples: int
    """Number of valid samples."""
    renderers: dict[str, int]
    """Number of samples by renderer."""
    mean_shares: tuple[float, ...]
    """(4,). Mean share of the object's pixels that no, one, two and three lights reach."""
    samples_with: tuple[int, ...]
    """(4,). Number of samples with at least 1% of such pixels."""
    skipped: list[str]
    """A sentence for each file that is no valid sample."""


@dataclass(frozen=True)
class ShowSamples(Operation):
    """Show samples or photos in one image."""

    command: ClassVar[str] = "show"

    path: tuple[str, ...] = option(positional=True, help="a sample, a folder of samples, or a photo", provenance="none")
    count: int = option(default=8, low=1, help="how many of a folder's samples to show, evenly spread")
    output: str | None = optional(
        "picture: .png or .tif", unset="NAME_sheet.png in the current folder", provenance="none"
    )

    def run(self, progress: Progress = silent) -> SamplesShown:
        """Write the image, and describe the samples."""
        from mpsnet_core.io.files import check_no_overwrite, checked_bits, resolved, writable_path
        from mpsnet_core.io.frames import is_folder_or_pattern, matching_files
        from mpsnet_core.io.image_writing import write_picture
        from mpsnet_core.synthesis.contact_sheet import folder_samples, is_sample, show, summarise

        paths: list[Path] = []
        for given in self.path:
            # The Windows shell does not expand patterns.
            matched = is_folder_or_pattern(given) and not Path(given).is_dir()
            paths += matching_files(given) if matched else [Path(given)]
        first = paths[0]
        # In the current folder: that of the samples may be another person's.
        output = writable_path(self.output or f"{resolved(first).stem}_sheet.png")
        checked_bits(output, 8)
        check_no_overwrite(paths, [output])
        progress(0.0, "reading")
        samples: list[Path] = []
        photos: list[Path] = []
        for path in paths:
            if path.is_dir():
                samples += folder_samples(path)
            else:
                (samples if is_sample(path) else photos).append(path)
        summary = summarise(samples, part(progress, 0.0, 0.8))
        if len(paths) == 1 and summary.skipped and not summary.samples:
            raise InputError(summary.skipped[0])
        write_picture(output, show(samples, photos, self.count))
        progress(1.0, "done")
        skipped = [f"skipped {len(summary.skipped)} file(s)", *summary.skipped[:NAMED]] if summary.skipped else []
        described = [str(summary)] if samples else []
        return SamplesShown(str(output), **vars(summary), text="\n".join([*described, *skipped, str(output)]))

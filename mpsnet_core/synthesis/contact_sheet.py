"""Contact sheets: an image of samples for people, one row each, and statistics of a folder of samples."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.errors import FileError, InputError
from mpsnet_core.io.image import CHANNELS, linear_to_srgb
from mpsnet_core.io.image_reading import image_layers, read_image
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import fingerprint, provenance_line
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.pictures import BACKGROUND, contact_sheet, legend, on_background, photo_picture
from mpsnet_core.synthesis.sample import Sample, read_sample, read_sample_data

ROWS = 8
TILE_HEIGHT = 176

Colour = tuple[float, float, float]
# For none to three lights, also distinct in greyscale.
LIT_COLOURS: tuple[Colour, ...] = ((0.30, 0.20, 0.58), (0.72, 0.22, 0.33), (0.95, 0.62, 0.25), (0.99, 0.95, 0.78))
LIT_WORDS = ("no light", "one light", "two lights", "three lights")
# Okabe and Ito's palette, which is safe for colour-blind people.
MATERIAL_COLOURS: tuple[Colour, ...] = (
    (0.90, 0.62, 0.00),
    (0.34, 0.71, 0.91),
    (0.00, 0.62, 0.45),
    (0.94, 0.89, 0.26),
    (0.00, 0.45, 0.70),
    (0.84, 0.37, 0.00),
    (0.80, 0.47, 0.65),
)
# Least share of a sample's pixels for the sample to count as one with such pixels.
SHOWN = 0.01


@dataclass(frozen=True)
class FolderSummary:
    """Statistics of a folder of samples."""

    samples: int
    """Number of valid samples."""
    renderers: dict[str, int]
    """Number of samples by renderer."""
    mean_shares: tuple[float, ...]
    """(4,). Mean share of the object's pixels that no, one, two and three lights reach."""
    samples_with: tuple[int, ...]
    """(4,). Number of samples with at least 1% of such pixels."""
    skipped: list[str] = field(default_factory=list)
    """A sentence for each file that is no valid sample."""

    def __str__(self) -> str:
        if not self.samples:
            return "no samples"
        makers = ", ".join(f"{count} by {renderer}" for renderer, count in sorted(self.renderers.items()))
        shares = [
            f"{words} {share:.1%} (in {count} samples)"
            for words, share, count in zip(LIT_WORDS, self.mean_shares, self.samples_with, strict=True)
        ]
        return f"{self.samples} sample(s), {makers}\npixels reached by {', '.join(reversed(shares))}"


def folder_samples(folder: AnyPath) -> list[Path]:
    """The EXR files of a folder, sorted. Samples may have any name. Raises FileError if there are none."""
    files = sorted(file for file in Path(folder).glob("*.exr") if not file.name.startswith("."))
    if not files:
        raise FileError(f"folder {folder} holds no samples (.exr); make some with mpsnet synthesize, or in Blender")
    return files


def is_sample(path: AnyPath) -> bool:
    """Whether a file, even a damaged one, is a sample and not a photo. Raises InputError if it is not an image."""
    return "light1" in image_layers(path)


def summarise(files: Sequence[AnyPath], progress: Progress = silent) -> FolderSummary:
    """Statistics of samples from their metadata alone. Damaged and foreign files are skipped and listed."""
    renderers: dict[str, int] = {}
    shares: list[Sequence[float]] = []
    skipped: list[str] = []
    for place, file in enumerate(files):
        progress(place / len(files), f"reading {Path(file).name}")
        try:
            data = read_sample_data(file)
        except InputError as error:
            skipped.append(str(error))
            continue
        renderers[data["renderer"]] = renderers.get(data["renderer"], 0) + 1
        shares.append(data["lit_fractions"])
    table = np.array(shares, np.float64).reshape(-1, 4)
    mean, shown = table.mean(axis=0) if len(table) else np.zeros(4), (table >= SHOWN).sum(axis=0)
    return FolderSummary(len(table), renderers, tuple(mean.tolist()), tuple(shown.tolist()), skipped)


def spread(files: Sequence[Path], count: int) -> list[Path]:
    """At most `count` of the files, evenly spaced from first to last."""
    if len(files) <= count:
        return list(files)
    return [files[round(place)] for place in np.linspace(0, len(files) - 1, count)]


def sheet_of_samples(files: Sequence[Path], count: int = ROWS) -> F32 | None:
    """(H, W, 3) display values: up to `count` samples, evenly spaced, one row each; None if no file is a sample.

    A file that is no valid sample is replaced by the next one that is.
    """
    tiles: list[tuple[str, F32]] = []
    shown: set[Path] = set()
    for wanted in spread(files, count):
        for file in files[files.index(wanted) :]:
            if file in shown:
                continue
            try:
                tiles += sample_row(file.stem, read_sample(file))
            except InputError:
                continue
            shown.add(file)
            break
    if not tiles:
        return None
    picture = contact_sheet(tiles, len(tiles) // len(shown), TILE_HEIGHT)
    words = legend(list(zip(LIT_COLOURS[::-1], LIT_WORDS[::-1], strict=True)), picture.shape[1])
    return np.concatenate([picture, words])


def show(samples: Sequence[Path], photos: Sequence[Path], count: int = ROWS) -> F32:
    """(H, W, 3) display values: the contact sheet of the samples, and below it one row per photo.

    Raises InputError if a photo cannot be read, or there is neither a valid sample nor a photo.
    """
    rows = [sheet_of_samples(samples, count)] if samples else []
    rows += [contact_sheet(photo_row(photo), 5, TILE_HEIGHT) for photo in photos]
    pictures = [row for row in rows if row is not None]
    if not pictures:
        raise FileError(f"{samples[0].parent} holds no whole sample; make some again")
    width = max(picture.shape[1] for picture in pictures)
    edges = [((0, 0), (0, width - picture.shape[1]), (0, 0)) for picture in pictures]
    return np.concatenate(
        [np.pad(picture, edge, constant_values=BACKGROUND) for picture, edge in zip(pictures, edges, strict=True)]
    )


def photo_row(path: Path) -> list[tuple[str, F32]]:
    """A photo's tiles: the photo, each channel and, if it has alpha, its mask. Raises InputError."""
    image = read_image(path)
    inside = image.alpha > 0.5 if image.alpha is not None and (image.alpha > 0.5).any() else None
    photo = photo_picture(image.pixels, inside)
    tiles = [(path.stem[-18:], photo)]
    tiles += [(name, np.repeat(photo[..., k, None], 3, axis=2)) for k, name in enumerate(CHANNELS)]
    if inside is not None:
        tiles.append(("mask", np.repeat(inside[..., None], 3, axis=2).astype(np.float32)))
    return tiles


def sample_row(name: str, sample: Sample) -> list[tuple[str, F32]]:
    """A sample's tiles: each light alone, photo with an ideal rig, normals, number of lights, materials."""
    inside = sample.alpha > 0.5
    # The same exposure for all three lights, because they add up to one photo.
    brightest = sample.lights.max(axis=(0, 3))[inside]
    white = max(float(np.percentile(brightest, 99)) if brightest.size else 0.0, 1e-6)
    lights = linear_to_srgb(sample.lights / white).astype(np.float32)
    photo = np.stack([lights[k, ..., k] for k in range(3)], axis=-1)
    reaching = (sample.lit >= 0.5).sum(axis=0)
    number = np.where(sample.material < 0, -1, sample.material % len(MATERIAL_COLOURS))
    kind = sample.recipe.shape.get("kind", "")
    return [
        (f"{name.removeprefix('sample_')[-10:]} {kind}", lights[0]),
        ("light 2", lights[1]),
        ("light 3", lights[2]),
        ("photo", photo),
        ("normals", on_background(encode(sample.normals), inside)),
        ("lights reaching", on_background(np.array(LIT_COLOURS, np.float32)[reaching], inside)),
        ("materials", on_background(np.array(MATERIAL_COLOURS, np.float32)[number], inside & (number >= 0))),
    ]


def sheet_line(files: Sequence[Path]) -> str:
    """The line to store in the contact sheet of these files. It changes if the sheet would show other samples."""
    return provenance_line("contact sheet", *map(fingerprint, spread(files, ROWS)))

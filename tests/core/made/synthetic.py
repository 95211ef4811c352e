"""What the tests look at: a shaded sphere whose normals are known, and files written without the core's help."""

import os
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from mpsnet_core import Capture, LightRig, published_rig
from mpsnet_core.io.files import unfinished_path

CROSSTALK = [[0.80, 0.15, 0.05], [0.10, 0.85, 0.10], [0.02, 0.18, 0.75]]


@dataclass(frozen=True)
class Sphere:
    """A Lambertian sphere seen orthographically. lit: where all three lights reach it (no attached shadow)."""

    image: np.ndarray
    normals: np.ndarray
    mask: np.ndarray
    lit: np.ndarray
    rig: LightRig

    def capture(self, **changes: Any) -> Capture:
        return Capture(**{"image": self.image, "mask": self.mask, "rig": self.rig, **changes})


def shaded_sphere(size: int = 64, rig: LightRig | None = None, albedo: Sequence[float] = (0.8, 0.8, 0.8)) -> Sphere:
    """A sphere that fills the frame, shaded by the image formation: c = M (albedo * max(n·l, 0))."""
    rig = rig or published_rig()
    x = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(x, -x)
    inside = x**2 + y**2 < 0.98
    z = np.sqrt(np.where(inside, 1 - x**2 - y**2, 0))
    normals = np.stack([x, y, z], axis=-1)
    normals[~inside] = 0
    shading = np.stack([normals @ light for light in rig.directions], axis=-1)
    light = np.maximum(shading, 0) * albedo
    image = np.stack([light @ row for row in rig.mixing], axis=-1).astype(np.float32)
    return Sphere(image, normals, inside, inside & (shading > 0).all(axis=-1), rig)


def degrees_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The angle between vectors (..., 3) of any length, in degrees, by arctan2 of cross and dot product."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def write_file(path: Path, values: np.ndarray, kind: str, **attributes: Any) -> Path:
    """Write (H, W, C) values with OpenImageIO as `kind` (uint8, uint16, half, float); attributes with ':' as '__'."""
    values = np.atleast_3d(values).astype(np.float32)
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, kind)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec) and target.write_image(np.ascontiguousarray(values)), target.geterror()
    assert target.close()
    return path


def write_parts(path: Path, parts: Sequence[tuple[str | None, Mapping[str, np.ndarray]]], kind: str = "float") -> Path:
    """Write an EXR with the given parts: (name, {channel: (H, W) values}) each."""
    specs, buffers = [], []
    for name, channels in parts:
        values = np.stack(list(channels.values()), axis=-1).astype(np.float32)
        spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
        spec.channelnames = tuple(channels)
        if name is not None:
            spec.attribute("oiio:subimagename", name)
        specs.append(spec)
        buffers.append(np.ascontiguousarray(values))
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), specs if len(specs) > 1 else specs[0]), target.geterror()
    for number, (spec, buffer) in enumerate(zip(specs, buffers, strict=True)):
        assert number == 0 or target.open(str(path), spec, "AppendSubimage"), target.geterror()
        assert target.write_image(buffer), target.geterror()
    assert target.close()
    return path


def named(prefix: str, channels: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """{prefix + letter: (H, W)} for the letters of `channels` and values (H, W, C)."""
    return {prefix + letter: values[..., number] for number, letter in enumerate(channels)}


def left_by(pid: int, path: Path) -> Path:
    """What process `pid` of this machine calls `path` while it is writing it."""
    unfinished = unfinished_path(path)
    return unfinished.with_name(unfinished.name.replace(f".{os.getpid()}-", f".{pid}-"))


def listing(folder: Path) -> list[str]:
    """Names of all that lies in a folder, hidden files too."""
    return sorted(file.name for file in folder.iterdir())


def mat_file(path: Path, **arrays: np.ndarray) -> Path:
    """Write float64 arrays as a MATLAB 5 file, by MathWorks' "MAT-File Format"."""

    def element(kind: int, body: bytes) -> bytes:
        return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)

    data = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    for name, values in arrays.items():
        flags, shape = struct.pack("<II", 6, 0), struct.pack(f"<{values.ndim}i", *values.shape)
        numbers = values.astype("<f8").tobytes(order="F")
        parts = [element(6, flags), element(5, shape), element(1, name.encode()), element(9, numbers)]
        packed = zlib.compress(element(14, b"".join(parts)))
        data += struct.pack("<II", 15, len(packed)) + packed
    path.write_bytes(data)
    return path


INTENSITIES = np.array([[0.9, 1.0, 1.1], [0.5, 0.6, 0.7], [1.4, 1.3, 1.2], [1.0, 1.0, 1.0]])


def diligent_object(root: Path, name: str, albedo: Sequence[float] = (0.4, 0.4, 0.4)) -> Sphere:
    """A sphere in DiLiGenT's layout: a photograph under white light from each of four directions."""
    folder = root / f"{name}PNG"
    folder.mkdir(parents=True)
    sphere = shaded_sphere()
    directions = np.array([*sphere.rig.directions, [0, 0, 1]])
    names = [f"{number:03d}.png" for number in range(1, 5)]
    for file, direction, intensity in zip(names, directions, INTENSITIES, strict=True):
        shading = np.maximum(sphere.normals @ direction, 0)[..., None]
        write_file(folder / file, shading * albedo * intensity, "uint16")
    (folder / "filenames.txt").write_text("\n".join(names) + "\n")
    np.savetxt(folder / "light_directions.txt", directions)
    np.savetxt(folder / "light_intensities.txt", INTENSITIES)
    write_file(folder / "mask.png", sphere.mask, "uint8")
    mat_file(folder / "Normal_gt.mat", Normal_gt=sphere.normals)
    return sphere


def matt_fits(path: Path, **albedos: Sequence[float]) -> Path:
    """A file of fits whose materials are matt: their networks answer with one number a channel, whatever they see."""
    names = sorted(albedos)
    arrays: dict[str, Any] = {
        name: np.zeros((len(names), *shape), np.float32)
        for name, shape in {"fc1": (6, 21), "b1": (21,), "fc2": (21, 21), "b2": (21,), "fc3": (21, 3)}.items()
    }
    answers = np.log1p(np.array([albedos[name] for name in names]) / np.pi).astype(np.float32)
    np.savez(path, names=np.array(names), b3=answers, **arrays)
    return path

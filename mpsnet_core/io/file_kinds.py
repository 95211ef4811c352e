"""What image files are by their first bytes, whatever their suffix, and what OpenImageIO does not read of them."""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from math import inf
from pathlib import Path
from typing import IO, Any

from mpsnet_core.io.opening import AnyPath, is_file

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# First bytes of the formats that OpenImageIO reads for us. TGA files have none, and are known by their suffix alone.
READABLE = (PNG_SIGNATURE, b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"v/1\x01", b"BM", b"#?R")
# First bytes of others, by which a message names them.
_OTHERS = {
    b"\xff\x0a": "JPEG XL",
    b"\0\0\0\x0cJXL ": "JPEG XL",
    b"\0\0\0\x0cjP  ": "JPEG 2000",
    b"8BPS": "a Photoshop document",
    b"GIF8": "a GIF, which has 256 colours",
    b"%PDF": "a PDF document",
}
HEIC, AVIF = "HEIC", "AVIF"
# Our names of attributes: the format's name, whether there is a palette, and what OpenImageIO does not read.
FORMAT, PALETTE = "mpsnet:format", "mpsnet:palette"
TRANSFER, STATES_CURVE, STATES_TABLE = "mpsnet:transfer", "mpsnet:states_curve", "mpsnet:states_table"
EXPOSURE = ("mpsnet:exposure_red", "mpsnet:exposure_green", "mpsnet:exposure_blue")
_HEIC_BRANDS = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
HEAD = 64  # bytes by which a kind is told

# Tags of a TIFF file, and JPEG XL's number among its compressions (DNG 1.7).
ORIENTATION, COMPRESSION, TRANSFER_FUNCTION, SUB_DIRECTORIES, JPEG_XL = 274, 259, 301, 330, 52546
# Bounds of what is read of a file's structure: a hostile one can be a maze.
MAX_DIRECTORIES, MAX_ENTRIES, MAX_CHUNKS, MAX_BODY, MAX_HEADER = 64, 512, 65_536, 64, 65_536


def file_head(path: AnyPath, size: int = HEAD) -> bytes:
    """The first bytes of a file, empty if it is none or cannot be read."""
    if not is_file(path):
        return b""
    try:
        with Path(path).open("rb") as file:
            return file.read(size)
    except (OSError, ValueError):
        return b""


def is_readable(path: AnyPath, head: bytes) -> bool:
    """Whether OpenImageIO may open a file that begins with `head`."""
    webp = head[:4] == b"RIFF" and head[8:12] == b"WEBP"
    return head.startswith(READABLE) or webp or (Path(path).suffix.lower() == ".tga" and not kind_of(head))


def kind_of(head: bytes) -> str:
    """What a file that begins with `head` is, if it is none of the readable formats; "" if that is unknown."""
    if head[4:8] == b"ftyp":
        brands = [head[8:12], *(head[start : start + 4] for start in range(16, len(head), 4))]
        if any(brand in (b"avif", b"avis") for brand in brands):
            return AVIF
        return HEIC if any(brand in _HEIC_BRANDS for brand in brands) else ""
    return next((name for start, name in _OTHERS.items() if head.startswith(start)), "")


def png_chunks(path: AnyPath) -> dict[bytes, bytes]:
    """The chunks before a PNG's pixels by their names: the first bytes of each. Empty for other files."""
    chunks: dict[bytes, bytes] = {}
    with Path(path).open("rb") as file:
        if file.read(len(PNG_SIGNATURE)) != PNG_SIGNATURE:
            return chunks
        for _ in range(MAX_CHUNKS):
            head = file.read(8)
            if len(head) < 8 or head[4:] in (b"IDAT", b"IEND"):
                break
            length = int.from_bytes(head[:4], "big")
            chunks.setdefault(head[4:], file.read(min(length, MAX_BODY)))
            file.seek(max(length - MAX_BODY, 0) + 4, os.SEEK_CUR)
    return chunks


def webp_orientation(path: AnyPath) -> int | None:
    """The EXIF orientation of a WebP file, which OpenImageIO 3.0 does not read; None if it states none."""
    with Path(path).open("rb") as file:
        if file.read(12)[8:] != b"WEBP":
            return None
        for _ in range(MAX_CHUNKS):
            head = file.read(8)
            if len(head) < 8:
                break
            length = int.from_bytes(head[4:], "little")
            if head[:4] == b"EXIF":
                start = file.tell()
                start += 6 if file.read(6) == b"Exif\0\0" else 0
                first = next(tiff_directories(file, start), {})
                return next(iter(first.get(ORIENTATION, ())), None)
            file.seek(length + length % 2, os.SEEK_CUR)
    return None


def stated_beside(path: AnyPath, kind: str) -> dict[str, int | float]:
    """What a file of the format `kind`, as OpenImageIO names it, states and OpenImageIO 3.0 does not read.

    By our names of attributes, those that a file lacks left out: the code of its transfer curve by ITU-T H.273; whether
    a PNG states a curve, and a TIFF one by a table; the factors by which an HDR's red, green and blue were multiplied.
    """
    if kind == "png":
        chunks = png_chunks(path)
        code = chunks.get(b"cICP", b"")[1:2]
        return {STATES_CURVE: int(bool(chunks.keys() & {b"sRGB", b"gAMA"})), **({TRANSFER: code[0]} if code else {})}
    if kind == "tiff":
        with Path(path).open("rb") as file:
            return {STATES_TABLE: int(TRANSFER_FUNCTION in next(tiff_directories(file), {}))}
    return dict(zip(EXPOSURE, _radiance_exposure(path), strict=True)) if kind == "hdr" else {}


def _radiance_exposure(path: AnyPath) -> list[float]:
    factors = [1.0, 1.0, 1.0]
    for line in file_head(path, MAX_HEADER).partition(b"\n\n")[0].decode("latin-1").splitlines():
        name, _, value = line.partition("=")
        if name.strip() not in ("EXPOSURE", "COLORCORR"):
            continue
        with suppress(ValueError):
            given = [float(word) for word in value.split()]
            given = given * 3 if len(given) == 1 else given
            if len(given) == 3 and all(0 < one < inf for one in given):
                factors = [factor * one for factor, one in zip(factors, given, strict=True)]
    return factors


def is_in_jpeg_xl(path: AnyPath) -> bool:
    """Whether a TIFF or DNG file has pixels that are compressed as JPEG XL, as in Apple's ProRAW."""
    with Path(path).open("rb") as file:
        return any(JPEG_XL in one.get(COMPRESSION, ()) for one in tiff_directories(file))


def tiff_directories(file: IO[bytes], start: int = 0) -> Iterator[dict[int, tuple[int, ...]]]:
    """The whole numbers of each directory of TIFF data that begin at `start`, by their tags; nested ones, too.

    Tags of other or of many values have none.
    """
    file.seek(start)
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(file.read(4))
    if order is None:
        return
    places, known = [_unpacked(file, f"{order}I")[0]], set[int]()
    while places and len(known) < MAX_DIRECTORIES:
        place = places.pop(0)
        if place in known or not place:
            continue
        known.add(place)
        file.seek(start + place)
        tags: dict[int, tuple[int, ...]] = {}
        for _ in range(min(_unpacked(file, f"{order}H")[0], MAX_ENTRIES)):
            tag, kind, count, value = _unpacked(file, f"{order}HHI4s")
            size = {3: "H", 4: "I", 13: "I"}.get(kind)
            if size is None or not 0 < count <= MAX_ENTRIES:
                tags[tag] = ()
                continue
            layout, after = f"{order}{count}{size}", file.tell()
            if struct.calcsize(layout) <= 4:
                tags[tag] = struct.unpack_from(layout, value)
            else:
                file.seek(start + struct.unpack(f"{order}I", value)[0])
                tags[tag] = _unpacked(file, layout)
                file.seek(after)
        places += [*tags.get(SUB_DIRECTORIES, ()), _unpacked(file, f"{order}I")[0]]
        yield tags


def _unpacked(file: IO[bytes], layout: str) -> tuple[Any, ...]:
    """The next values of a file; zeros where it ends."""
    size = struct.calcsize(layout)
    return struct.unpack(layout, file.read(size).ljust(size, b"\0"))

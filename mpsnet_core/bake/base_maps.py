"""Base maps of textures, found by the tokens of the textures' names or in a list file."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.bake.base_detail_removal import BaseMap, BaseMapInPhotos
from mpsnet_core.bake.detail_blending import read_base_map
from mpsnet_core.bake.map_list import ListedMap, read_map_list
from mpsnet_core.defaults import CONVENTIONS
from mpsnet_core.errors import FileError, SettingsError, check_choice
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_encoding import Convention
from mpsnet_core.scene.texture_names import TOKENS, check_one_texture, map_files
from mpsnet_core.scene.texture_sets import TextureSet

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class MapFile:
    """The file of a base map."""

    file: Path
    """The file."""
    convention: Convention
    """Which way its green channel points."""


def base_map_files(given: AnyPath, convention: Convention, texture_sets: Sequence[TextureSet]) -> list[MapFile | None]:
    """The base map of each texture set, None where there is none.

    given: an image, whose name may contain the same tokens <UDIM>, <MATERIAL> and <OBJECT> as the textures' names; or a
    .json file that lists several (:mod:`mpsnet_core.bake.map_list`), of which the first that matches a texture set's
    object and material applies. convention: of the image, and of listed maps without one.

    Raises InputError if the list is malformed, a name has a token that the textures are not split by, or no texture set
    has a map.
    """
    base_files: list[MapFile | None] = [None] * len(texture_sets)
    is_list = Path(given).suffix.lower() == ".json"
    listed = read_map_list(given) if is_list else [ListedMap(Path(given))]
    sought: list[Path | None] = [None] * len(texture_sets)
    for entry in listed:
        points = entry.convention or convention
        check_choice("convention", points, CONVENTIONS)
        for number, (texture_set, file) in enumerate(
            zip(texture_sets, map_files(entry.file, texture_sets), strict=True)
        ):
            meant = entry.object in (None, texture_set.object) and entry.material in (None, texture_set.material)
            # Not every object or tile needs a map. A missing file whose name has no tokens fails when it is read.
            if meant and base_files[number] is None:
                sought[number] = file
                if file == entry.file or file.is_file():
                    base_files[number] = MapFile(file, points)
    if not any(base_files):
        check = "the objects, materials and files in it" if is_list else f"the path, and {', '.join(TOKENS)} in it"
        raise FileError(f"{given}: there is no existing map for any of the textures; check {check}")
    for texture_set, found, missing in zip(texture_sets, base_files, sought, strict=True):
        if found is None:
            named = f" {missing}" if missing else ""
            log.info("%s: there is no existing map%s, so nothing lies beneath its texture", texture_set.named, named)
    return base_files


def one_base_map(file: str, convention: Convention, shown: BaseMapInPhotos) -> BaseMap:
    """The base map of every texture of a sequence.

    Raises InputError if the file stands for several maps, or cannot be read.
    """
    check_one_texture(file)
    if Path(file).suffix.lower() == ".json":
        raise SettingsError(
            f"{file} lists existing maps for several textures; name the one image that the detail goes on top of"
        )
    return BaseMap(read_base_map(file, convention=convention), shown)


class BaseMaps(Sequence[BaseMap]):
    """The base maps of meshes, read on request. The last one stays in memory. All are read once at construction.

    Texture sets that share a map and a unit square of UV space share one :class:`BaseMap`, whose triangles are those of
    the joined meshes (:func:`mpsnet_core.scene.joined_mesh.join_meshes`).

    base_files: from :func:`base_map_files`, for the texture sets.

    Raises InputError if a map cannot be read.
    """

    def __init__(
        self,
        base_files: Sequence[MapFile | None],
        texture_sets: Sequence[TextureSet],
        meshes: Sequence[Mesh],
        shown: BaseMapInPhotos,
    ) -> None:
        self.shown = shown
        together: dict[tuple[MapFile, tuple[int, int] | None], list[TextureSet]] = {}
        for texture_set, map_file in zip(texture_sets, base_files, strict=True):
            if map_file is not None:
                together.setdefault((map_file, None if texture_set.tile is None else texture_set.corner), []).append(
                    texture_set
                )
        self._maps = [(*key, _triangles(parts, meshes)) for key, parts in together.items()]
        self._number = {texture_set: number for number, parts in enumerate(together.values()) for texture_set in parts}
        self._last: tuple[MapFile, F32] | None = None
        for map_file in dict.fromkeys(key for key, _ in together):
            self._vectors(map_file)  # an unreadable map fails before the long work

    def __len__(self) -> int:
        return len(self._maps)

    def __getitem__(self, number: int) -> BaseMap:  # type: ignore[override]  # nothing takes slices
        one, corner, triangles = self._maps[number]
        return BaseMap(self._vectors(one), self.shown, triangles, corner)

    def vectors_for(self, texture_set: TextureSet) -> F32 | None:
        """(H, W, 3) the vectors of a texture set's base map, None if it has none."""
        number = self._number.get(texture_set)
        return None if number is None else self._vectors(self._maps[number][0])

    def in_photos(self) -> Sequence[BaseMap]:
        """The maps whose relief the photos may show."""
        return () if self.shown == "no" else self

    def _vectors(self, map_file: MapFile) -> F32:
        if self._last is None or self._last[0] != map_file:
            self._last = None  # free it before the next is read: each may be large
            self._last = map_file, read_base_map(map_file.file, convention=map_file.convention)
        return self._last[1]


def _triangles(texture_sets: Sequence[TextureSet], meshes: Sequence[Mesh]) -> Bools | None:
    """(T,) which of the meshes' triangles belong to the texture sets; None for all."""
    if any(all(part is None for part in texture_set.parts) for texture_set in texture_sets):
        return None
    ends = np.cumsum([0] + [len(mesh.triangles) for mesh in meshes])
    applies = np.zeros(ends[-1], bool)
    for texture_set in texture_sets:
        for start, end, part in zip(ends[:-1], ends[1:], texture_set.parts, strict=True):
            applies[start:end][slice(None) if part is None else part] = True
    return applies

"""What shares a texture, what the textures' files are called, and the names that meshes' triangles have."""

from pathlib import Path

import numpy as np
import pytest
from mesh_file import write_mesh
from uv_squares import squares

from mpsnet_core import InputError, read_mesh
from mpsnet_core.scene.texture_names import split_by, texture_files
from mpsnet_core.scene.texture_sets import TextureSet, texture_sets


def told(found: list[TextureSet]) -> list[tuple]:
    parts = [[None if part is None else part.tolist() for part in texture_set.parts] for texture_set in found]
    return [(s.object, s.material, s.tile, *part) for s, part in zip(found, parts, strict=True)]


def test_without_tokens_all_share_one_texture() -> None:
    assert told(texture_sets([squares((0, 0)), squares((0.5, 0))])) == [(None, None, None, None, None)]


def test_each_triangle_is_in_the_tile_that_its_uvs_lie_in(caplog: pytest.LogCaptureFixture) -> None:
    mesh = squares((0.25, 0.25), (1.25, 0.25), (0.0, 1.5), (9.5, 2.0), (-0.75, 0.0))
    with caplog.at_level("INFO", "mpsnet_core"):
        found = texture_sets([mesh], tiles=True)
    expected = {1001: [0, 1], 1002: [2, 3], 1011: [4, 5], 1030: [6, 7]}
    assert told(found) == [(None, None, tile, part) for tile, part in expected.items()]
    assert [texture_set.corner for texture_set in found] == [(0, 0), (1, 0), (0, 1), (9, 2)]
    assert [record.getMessage() for record in caplog.records] == [
        "2 of 10 triangles have UVs outside the UDIM tiles, where no texture is"
    ]
    caplog.clear()
    with caplog.at_level("INFO", "mpsnet_core"):
        texture_sets([mesh])
    assert caplog.records[0].getMessage().startswith("8 of 10 triangles have UVs outside 0 to 1")
    assert caplog.records[0].getMessage().endswith("; bake UDIM tiles (<UDIM> in the file's name) to have them too")


def test_what_crosses_a_border_is_in_both_tiles_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", "mpsnet_core"):
        found = texture_sets([squares((0.75, 0.25), (2, 0))], tiles=True)
    assert told(found) == [(None, None, tile, part) for tile, part in ((1001, [0, 1]), (1002, [0, 1]), (1003, [2, 3]))]
    assert any("1 UV island lies across the border of two UDIM tiles" in r.getMessage() for r in caplog.records)


def test_materials_of_one_name_are_one_and_objects_of_one_name_are_not() -> None:
    first, second = squares((0, 0), (0, 0), materials="skin cloth"), squares((0, 0), materials="skin")
    assert told(texture_sets([first, second], materials=True)) == [
        (None, "skin", None, [0, 1], [0, 1]),
        (None, "cloth", None, [2, 3], []),
    ]
    first, second = squares((0, 0), (0, 0), objects="a b"), squares((0, 0), objects="a")
    assert told(texture_sets([first, second], objects=True)) == [
        ("a", None, None, [0, 1], []),
        ("b", None, None, [2, 3], []),
        ("a_2", None, None, [], [0, 1]),
    ]


def test_objects_materials_and_tiles_together() -> None:
    mesh = squares((0, 0), (1, 0), (0, 0), objects="a a b", materials="skin skin skin")
    assert told(texture_sets([mesh], tiles=True, materials=True, objects=True)) == [
        ("a", "skin", 1001, [0, 1]),
        ("a", "skin", 1002, [2, 3]),
        ("b", "skin", 1001, [4, 5]),
    ]


def test_triangles_without_a_material_are_reported_apart() -> None:
    mesh = squares((0, 0), (0, 0), materials="skin skin")
    bare = squares((0, 0))
    found = [texture_set.material for texture_set in texture_sets([mesh, bare], materials=True)]
    assert found == ["skin", "no_material"]


def names(pattern: str, **found: list) -> list[str]:
    """The files that a pattern gives for texture sets whose tile, material or object are as listed."""
    count = len(next(iter(found.values())))
    made = [TextureSet((None,), **{what: values[n] for what, values in found.items()}) for n in range(count)]
    return [path.as_posix() for path in texture_files(pattern, made)]


def test_tokens_become_numbers_and_names() -> None:
    assert split_by("out/<OBJECT>_normal.<UDIM>.png") == {"object", "tile"}
    assert split_by("plain.png") == set()
    assert names("out/s_normal.<UDIM>.png", tile=[1001, 1012]) == ["out/s_normal.1001.png", "out/s_normal.1012.png"]
    assert names("<OBJECT>-<MATERIAL>.exr", object=["a", "a"], material=["x", "y"]) == ["a-x.exr", "a-y.exr"]


def test_names_are_made_fit_for_files_and_stay_apart() -> None:
    given = ["Skin", "skin", "a/b:c*?", "..", "Grün 2.001", "x" * 300, "x" * 299, "Skin_2"]
    found = names("<MATERIAL>.png", material=given)
    assert found[:5] == ["Skin.png", "skin_2.png", "a_b_c.png", "unnamed.png", "Grün_2.001.png"]
    assert names("<MATERIAL>.png", material=["Aux", "com1.001", "Auxin"]) == ["Aux_.png", "com1.001_.png", "Auxin.png"]
    assert len({name.casefold() for name in found}) == len(given) and max(map(len, found)) < 100


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("a.<TILE>.png", "<TILE> stands for nothing; use <UDIM>, <MATERIAL> or <OBJECT>"),
        ("a.<udim>.png", "in capital letters"),
        ("<OBJECT>/a.png", "is in a folder's name; put it into the file's name"),
        ("a_<OBJECT>.png", "has <OBJECT>, but the textures are not split that way"),
    ],
)
def test_patterns_that_do_not_fit_are_refused(pattern: str, said: str) -> None:
    with pytest.raises(InputError) as error:
        names(pattern, tile=[1001, 1002])
    assert said in str(error.value)


def test_names_without_anything_between_may_meet() -> None:
    with pytest.raises(InputError, match=r"several textures would be called abc\.png"):
        names("<OBJECT><MATERIAL>.png", object=["a", "ab"], material=["bc", "c"])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"materials": np.array(["a", "a"])}, "two labels have the same name"),
        ({"triangle_material": np.array([0, 0, 0, 5])}, "numbered up to 5, of 2 names"),
        ({"triangle_material": None}, 'only one of "materials" and "triangle_material"'),
    ],
)
def test_names_that_do_not_fit_are_refused(tmp_path: Path, changes: dict, said: str) -> None:
    write_mesh(tmp_path / "a.npz", squares((0, 0), (0, 0), materials="skin cloth"))
    with np.load(tmp_path / "a.npz") as data:
        arrays = {**data, **changes}
    np.savez(tmp_path / "a.npz", **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(InputError, match=r"a\.npz: ") as error:
        read_mesh(tmp_path / "a.npz")
    assert said in str(error.value)

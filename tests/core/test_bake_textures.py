"""`mpsnet bake` and `mpsnet views` with several textures: files, what is told of them, and what is refused."""

import contextlib
import io
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bake_bench import TILTED, Bench
from mesh_file import write_mesh
from synthetic import degrees_between, listing, shaded_sphere, write_file
from uv_squares import squares

from mpsnet_core import Camera, published_rig, read_normals, write_camera, write_image, write_rig
from mpsnet_core.cli import main


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_a_texture_for_each_tile(bench: Bench) -> None:
    code, result, _ = bench.run(output="s.<UDIM>.png")
    assert code == 0 and [entry["tile"] for entry in result["outputs"]] == [1001, 1002]
    assert [Path(entry["output"]).name for entry in result["outputs"]] == ["s.1001.png", "s.1002.png"]
    assert result["seen"] == 1 and "s.1002.png: 32 x 32" in result["text"]
    for entry in result["outputs"]:
        found = read_normals(entry["output"]).vectors
        half = [found[16:, :16], found[:16, 16:]]
        assert all(degrees_between(part, TILTED).max() < 0.01 for part in half)
    assert not any("outside" in note for note in result["notes"])


def test_a_mesh_of_other_axes_and_unit_is_placed_by_options(bench: Bench) -> None:
    mesh = squares((0, 0), (0.5, 0.5), materials="skin bone")
    to_file = 100 * np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # centimetres, y up
    write_mesh(bench / "m.npz", mesh)
    normals = mesh.corner_normals @ to_file.T / 100
    write_mesh(
        bench / "f.npz", replace(mesh, vertices=mesh.vertices @ to_file.T, corner_normals=normals, given_tangents=None)
    )
    how = "--space", "tangent", "--size", "32x16", "--mesh"
    bench.run(*how, bench / "m.npz", output="m.png")
    bench.run(*how, bench / "f.npz", "--up", "y", "--unit", "cm", output="f.png")
    one, other = (read_normals(bench / name).vectors for name in ("m.png", "f.png"))
    assert one.shape == (16, 32, 3) and one.std() > 0.1
    assert one == pytest.approx(other, abs=1e-4)
    assert "--unit furlong is not a length" in bench.refused("--unit", "furlong", output="s.png")


def test_materials_whose_uvs_overlap_are_said_to_need_their_own_textures(bench: Bench) -> None:
    bench.squares("two.npz", (0, 0), (0, 0), materials="skin bone")
    _, result, _ = bench.run("--mesh", bench / "two.npz", output="s.png")
    assert any("put <MATERIAL> into" in note for note in result["notes"])
    _, result, _ = bench.run("--mesh", bench / "two.npz", output="s_<MATERIAL>.png")
    assert not any("overlap" in note for note in result["notes"])


@pytest.mark.parametrize(("output", "albedo"), [("s.<UDIM>.png", "s_albedo.{}.png"), ("<UDIM>.png", "{}_albedo.png")])
def test_the_tile_s_number_stays_where_programs_look_for_it(bench: Bench, output: str, albedo: str) -> None:
    """Blender's own pattern and others' want it last."""
    write_image(bench / "a.png", np.full((16, 96, 3), 0.5))
    _, result, _ = bench.run("--albedo", bench / "a.png", output=output)
    written = [str(bench / albedo.format(tile)) for tile in (1001, 1002)]
    assert [entry["albedo"] for entry in result["outputs"]] == written and all(map(os.path.isfile, written))
    assert {entry["albedo_tiles"] for entry in result["outputs"]} == {str(bench / albedo.format("<UDIM>"))}


def test_folders_may_have_equals_signs_in_their_names(bench: Bench) -> None:
    (bench / "a=b").mkdir()
    for name in ("camera.json", "n.png"):
        (bench / name).rename(bench / "a=b" / name)
    code, _, sentence = bench.run(output="s.png", view=f"{bench / 'a=b' / 'camera.json'}={bench / 'a=b' / 'n.png'}")
    assert code == 0, sentence


def test_a_texture_for_each_material_and_object(bench: Bench) -> None:
    _, result, _ = bench.run(output="<OBJECT>-<MATERIAL>.<UDIM>.png")
    told = [(Path(e["output"]).name, e["object"], e["material"], e["tile"]) for e in result["outputs"]]
    assert sorted(told) == [
        ("a-skin.1001.png", "a", "skin", 1001),
        ("b_c-Skin_2.1002.png", "b/c", "Skin", 1002),
        ("b_c-skin.1002.png", "b/c", "skin", 1002),
    ]
    assert all((bench / name).is_file() for name, *_ in told)


def test_several_meshes_take_their_files_names(bench: Bench) -> None:
    for name in ("left.npz", "right.npz"):
        write_mesh(bench / name, squares((0, 0)))
    meshes = ("--mesh", bench / "left.npz", "--mesh", bench / "right.npz")
    _, result, _ = bench.run(*meshes, output="<OBJECT>_normal.png")
    assert [Path(entry["output"]).name for entry in result["outputs"]] == ["left_normal.png", "right_normal.png"]
    _, result, _ = bench.run(*meshes, output="both.png")
    assert [entry["output"] for entry in result["outputs"]] == [str(bench / "both.png")]
    assert result["output"] == str(bench / "both.png") and any("UVs overlap" in note for note in result["notes"])


def uniform_map(file: Path, x: float, y: float, down: bool = False) -> Path:
    """A normal map that leans the same way everywhere."""
    vector = np.array([x, y, np.sqrt(1 - x * x - y * y)], np.float32)
    write_image(file, np.broadcast_to(0.5 + 0.5 * vector * [1, -1 if down else 1, 1], (8, 8, 3)).astype(np.float32))
    return file


def beneath(result: dict) -> dict[str, tuple[float, float]]:
    """The lean of each texture, by its file's name; with a strength of 0 that of the map beneath it."""
    found = {}
    for entry in result["outputs"]:
        vectors = read_normals(entry["output"]).vectors.reshape(-1, 3)
        assert np.ptp(vectors, axis=0).max() < 1e-3
        found[Path(entry["output"]).name] = tuple(np.round(vectors[0, :2].astype(float), 3) + 0)
    return found


FULL = ("--space", "tangent", "--strength", "0", "--padding", "push-pull")


def test_each_texture_goes_on_top_of_its_own_map(bench: Bench) -> None:
    """By tokens in the map's name; where an object has none, that is told."""
    two = ("--mesh", bench.squares("two.npz", (0, 0), (0.5, 0.5), objects="a b/c"))
    uniform_map(bench / "was_a.png", 0.3, 0.1)
    uniform_map(bench / "was_b_c.png", -0.2, 0.2)
    _, result, _ = bench.run(*two, "--onto", bench / "was_<OBJECT>.png", *FULL, output="o_<OBJECT>.png")
    assert beneath(result) == {"o_a.png": (0.3, 0.1), "o_b_c.png": (-0.2, 0.2)}
    (bench / "was_b_c.png").unlink()
    _, result, _ = bench.run(*two, "--onto", bench / "was_<OBJECT>.png", *FULL, output="o_<OBJECT>.png")
    assert beneath(result) == {"o_a.png": (0.3, 0.1), "o_b_c.png": (0, 0)}
    missing = bench / "was_b_c.png"
    assert f"object b/c: there is no existing map {missing}, so nothing lies beneath its texture" in result["notes"]
    uniform_map(bench / "t.1001.png", 0.1, 0.5)
    uniform_map(bench / "t.1002.png", -0.4, 0)
    _, result, _ = bench.run("--onto", bench / "t.<UDIM>.png", *FULL, output="n.<UDIM>.png")
    assert beneath(result) == {"n.1001.png": (0.1, 0.5), "n.1002.png": (-0.4, 0)}
    # One map for all, as engines repeat it.
    _, result, _ = bench.run("--onto", bench / "t.1001.png", *FULL, output="n.<UDIM>.png")
    assert set(beneath(result).values()) == {(0.1, 0.5)}


def test_maps_of_other_names_and_conventions_are_listed_in_a_file(bench: Bench) -> None:
    uniform_map(bench / "up.png", 0.3, 0.1)
    uniform_map(bench / "down.1002.png", -0.2, 0.2, down=True)
    maps = [
        {"file": "down.<UDIM>.png", "object": "b/c", "material": "Skin", "convention": "directx"},
        {"file": "up.png", "material": "skin"},
    ]
    listed = bench / "maps.json"
    listed.write_text(json.dumps({"format": "mpsnet-present-maps", "version": 1, "maps": maps}))
    _, result, _ = bench.run("--onto", listed, *FULL, output="<OBJECT>-<MATERIAL>.<UDIM>.png")
    assert beneath(result) == {
        "a-skin.1001.png": (0.3, 0.1),
        "b_c-skin.1002.png": (0.3, 0.1),
        "b_c-Skin_2.1002.png": (-0.2, 0.2),
    }
    # Of those for which the file says no convention, the option does.
    directx = ("--onto-convention", "directx")
    _, result, _ = bench.run("--onto", listed, *directx, *FULL, output="<OBJECT>-<MATERIAL>.<UDIM>.png")
    assert beneath(result) == {
        "a-skin.1001.png": (0.3, -0.1),
        "b_c-skin.1002.png": (0.3, -0.1),
        "b_c-Skin_2.1002.png": (-0.2, 0.2),
    }


def test_each_wrong_present_map_gets_one_sentence(bench: Bench) -> None:
    uniform_map(bench / "m.1001.png", 0.3, 0.1)
    (bench / "m.1002.png").write_bytes(b"no image")
    for number, text in enumerate(
        (
            '{"format": "mpsnet-present-maps", "version": 1, "maps": [{"object": "a"}]}',
            '{"format": "mpsnet-present-maps", "version": 1, "maps": [{"file": 3}]}',
            '{"format": "mpsnet-present-maps", "version": 1}',
            '{"format": "mpsnet-rig", "version": 1}',
            '{"format": "mpsnet-present-maps", "version": 1, "maps": [{"file": "x.png", "convention": "metal"}]}',
            '{"format": "mpsnet-present-maps", "version": 1, "maps": []}',
            '{"format": "mpsnet-present-maps", "version": 1, "maps": [{"file": "\\ud800.png"}]}',
        )
    ):
        (bench / f"{number}.json").write_text(text)
    needs = 'each of its "maps" has texts: "file"'
    for given, output, said in [
        ("m.<UDIM>.png", "s.png", "has <UDIM>, but the textures are not split that way"),
        ("x.<UDIM>.png", "s.<UDIM>.png", "there is no existing map for any of the textures; check the path"),
        ("m.<UDIM>.png", "s.<UDIM>.png", "m.1002.png"),
        ("m.1001.png", "m.<UDIM>.png", "would overwrite"),
        ("0.json", "s.png", needs),
        ("3.json", "s.png", "is not a mpsnet-present-maps file"),
        ("4.json", "s.png", "convention 'metal' is not known"),
        ("5.json", "s.png", "existing map for any of the textures; check the objects, materials and files in it"),
        ("6.json", "s.png", "\\ud800.png does not exist"),
    ]:
        assert said in bench.refused("--onto", bench / given, "--space", "tangent", output=output), given
    assert "is not a file name" in bench.refused("--onto", ".", "--space", "tangent", output="s.png")
    assert not (bench / "s.1001.png").exists()


def test_long_names_are_cut_and_names_that_are_too_long_are_reported_before_the_bake(bench: Bench) -> None:
    """Files count bytes, of which a letter may have several, and a file that is being written has a longer name."""
    bench.squares("long.npz", (0, 0), (0.5, 0.5), materials=f"m {'木' * 80}")
    _, result, _ = bench.run("--mesh", bench / "long.npz", output="<MATERIAL>.png")
    assert [Path(entry["output"]).name for entry in result["outputs"]] == ["m.png", f"{'木' * 26}.png"]
    before = listing(bench.folder)
    sentence = bench.refused("--mesh", bench / "long.npz", output=f"{'x' * 165}<MATERIAL>.png")
    assert "木.png: its name is too long; choose a shorter one" in sentence
    assert listing(bench.folder) == before


def test_each_wrong_name_gets_one_sentence(bench: Bench) -> None:
    write_mesh(bench / "bare.npz", squares((0, 0)))
    write_mesh(bench / "left.npz", squares((-1, 0)))
    write_mesh(bench / "wide.npz", squares((0, 0), side=30.0))
    (bench / "s.1001.npz").write_bytes((bench / "bare.npz").read_bytes())
    (bench / "s.1001.png").write_bytes((bench / "n.png").read_bytes())
    (bench / "d.1002.png").mkdir()
    view = f"{bench / 'camera.json'}={bench / 's.1001.png'}"
    for arguments, output, said in [
        ((), "a.<TILE>.png", "<TILE> stands for nothing; use <UDIM>, <MATERIAL> or <OBJECT>"),
        (("--mesh", bench / "bare.npz"), "<MATERIAL>.png", "bare.npz: there are no materials; leave <MATERIAL> out"),
        (("--mesh", bench / "left.npz"), "s.<UDIM>.png", "all UVs lie outside the UDIM tiles"),
        (("--mesh", bench / "left.npz"), "s.png", "lie outside the texture (0 to 1)"),
        (("--mesh", bench / "wide.npz"), "s.<UDIM>.png", "lie in 300 UDIM tiles, more than the 100"),
        (("--view", view), "s.<UDIM>.png", "would overwrite"),
        ((), "d.<UDIM>.png", "d.1002.png: it is a folder"),
        (("--samples", "3"), "s.png", "samples 3 is not known; choose 1, 2 or 4"),
    ]:
        assert said in bench.refused(*arguments, output=output), output


def test_sequences_are_refused_in_one_sentence(bench: Bench) -> None:
    for number in (1, 2):
        (bench / f"f_{number}.png").write_bytes((bench / "n.png").read_bytes())
    view = f"{bench / 'camera.json'}={bench / 'f_#.png'}"
    two = ("--mesh", bench / "mesh.npz", "--mesh", bench / "mesh.npz")
    for arguments, output in (((), "s.<UDIM>"), (two, "frames")):
        assert "a sequence is baked onto one mesh and into one texture per frame" in bench.refused(
            *arguments, output=output, view=view
        )
    said = bench.refused("--onto", "maps.json", "--space", "tangent", output="frames", view=view)
    assert "maps.json lists existing maps for several textures; name one image" in said


def test_samples_and_padding_reach_the_bake(bench: Bench) -> None:
    for padding, corner in (("none", False), ("push-pull", True), ("nearest", False)):
        margin = ["--margin", "2"] if padding == "nearest" else []
        bench.run("--padding", padding, *margin, "--samples", "2", output=f"{padding}.png")
        found = read_normals(bench / f"{padding}.png").vectors
        filled = degrees_between(found, TILTED) < 0.01
        assert filled[16:, :16].all() and filled[0, 0] == corner, padding
        assert filled[14, 0] == (padding != "none")


def test_views_bake_tiles_and_objects_too(bench: Bench) -> None:
    """A photo of a ball for each of two cameras; the report has the pictures of all textures."""
    sphere = shaded_sphere(64)
    (bench / "photos").mkdir()
    (bench / "cameras").mkdir()
    for number in (1, 2):
        write_file(bench / "photos" / f"p{number}.exr", sphere.image, "float")
        pose = np.eye(4)
        pose[:3, 3] = [2 * number - 1.5, 0.5, 5]
        write_camera(bench / "cameras" / f"p{number}.camera.json", Camera("orthographic", 64, 64, [30, 30], None, pose))
    write_rig(bench / "rig.json", published_rig())
    command = ["views", "--mesh", "mesh.npz", "--cameras", "cameras", "--photos", "photos", "--rig", "rig.json"]
    command += ["--model", "lambertian", "--size", "32", "--progress", "json", "--report", "r.html"]
    with contextlib.chdir(bench.folder), contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*command, "-o", "<OBJECT>.<UDIM>.png"]) == 0
    result = json.loads(out.getvalue().splitlines()[-1])["result"]
    names = [entry["output"] for entry in result["outputs"]]
    assert names == ["a.1001.png", "b_c.1002.png"] and all((bench / name).is_file() for name in names)
    page = (bench / "r.html").read_text()
    assert "object a, tile 1001" in page and page.count("<figure>") == 6

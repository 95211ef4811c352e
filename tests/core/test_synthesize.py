"""`mpsnet synthesize` and `make`: whole runs with the real thing, small."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bad_input import Bench, gets_one_clear_sentence
from progress_lines import events
from synthetic import listing

from mpsnet_core.synthesis.job import read_job, samples_there
from mpsnet_core.synthesis.sample import read_sample, read_sample_data

# A tetrahedron, closed and turned outwards.
SOLID = "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
SMALL = ("--size", "16", "--seed", "8", "--shapes", "reliefs,drapery", "--views", "2")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four samples by one process, as another program meets the command."""
    folder = tmp_path_factory.mktemp("made") / "four"
    command = ["synthesize", "--count", "4", *SMALL, "--processes", "1", "-o", str(folder), "--progress", "json"]
    done = subprocess.run([sys.executable, "-m", "mpsnet_core", *command], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    told, last = events(done.stdout)
    assert told == sorted(told) and (told[0], told[-1]) == (0, 1)
    assert last["result"]["made"] == 4 and last["result"]["there"] == 0
    assert last["result"]["contact_sheet"] == str(folder / "contact_sheet.png")
    names = [f"sample_{number:06d}.exr" for number in range(4)]
    assert listing(folder) == ["contact_sheet.png", "job.json", "job.lock", *names]
    return folder


def test_samples_are_what_their_recipes_say(made: Path) -> None:
    shapes = []
    for number in range(4):
        sample = read_sample(made / f"sample_{number:06d}.exr")
        assert (sample.recipe.seed, sample.recipe.number) == (8, number)
        assert sample.alpha.shape == (16, 16) and sample.mask.any()
        assert sample.renderer == "synthesis"
        shapes.append(json.dumps(sample.recipe.shape, sort_keys=True))
    assert shapes[0::2] == shapes[1::2] and len(set(shapes)) == 2
    assert not np.array_equal(*(read_sample(made / f"sample_{n:06d}.exr").normals for n in (0, 1)))


def test_the_same_seed_gives_the_same_bytes_with_more_workers(tmp_path: Path, mpsnet, made: Path) -> None:
    assert mpsnet("synthesize", "--count", "4", *SMALL, "--processes", "2", "-o", tmp_path).returncode == 0
    for number in range(4):
        name = f"sample_{number:06d}.exr"
        assert (tmp_path / name).read_bytes() == (made / name).read_bytes(), name


def test_make_goes_on_and_synthesize_extends(mpsnet, made: Path) -> None:
    lost = made / "sample_000003.exr"
    before = lost.read_bytes()
    lost.rename(made / "sample_0000003.exr")
    done = mpsnet("make", made)
    assert (done.returncode, done.stdout) == (0, f"{made}: 1 made, 3 there already\n")
    assert lost.read_bytes() == before
    done = mpsnet("synthesize", "--count", "5", *SMALL, "-o", made)
    assert (done.returncode, done.stdout) == (0, f"{made}: 1 made, 4 there already\n")
    (made / "sample_0000003.exr").unlink()
    assert read_job(made).count == 5 and samples_there(made) == set(range(5))


def test_samples_that_cannot_be_made_are_counted_and_the_rest_is_kept(tmp_path: Path, mpsnet) -> None:
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    (meshes / "solid.obj").write_text(SOLID)
    (meshes / "broken.obj").write_text("v 1 2\nf 1 2 3\n")
    out = tmp_path / "out"
    done = mpsnet("synthesize", "--count", "6", "--size", "16", "--meshes", meshes, "-o", out, "--processes", "1")
    there = samples_there(out)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"{out}: {6 - len(there)} of 6 samples failed, {len(there)} made, 0 there already; sample " in line
    assert "broken.obj" in line
    assert 0 < len(there) < 6
    for number in there:
        assert read_sample_data(out / f"sample_{number:06d}.exr")["recipe"]["shape"]["kind"] == "meshes"


def synthesize(b: Bench, *arguments: str | Path) -> None:
    """`mpsnet synthesize` with good values for what is not given."""
    b.run("synthesize", "--count", "2", "--size", "16", "--seed", "3", "-o", b / "s", *arguments)


test_a_bad_synthesis_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: synthesize(b, "-o", b / os.fsdecode(b"\xf6")), "\\udcf6: its name is not valid UTF-8"),
        ("unknown shape", lambda b: synthesize(b, "--shapes", "blobs,teapots"), "shape 'teapots' is not known"),
        ("meshes of no folder", lambda b: synthesize(b, "--shapes", "meshes"), "where it names their folder"),
        (lambda b: synthesize(b, "--shapes", "blobs", "--meshes", b.folder), "where it names their folder"),
        ("a scene without Blender", lambda b: synthesize(b, "--shapes", "scene"), "where it names their objects"),
        (lambda b: synthesize(b, "--shapes", "blobs,meshes", "--meshes", b / "nowhere"), "nowhere does not exist"),
        (lambda b: b.run("synthesize", "--count", "1", "-o", b / "no" / "where"), "cannot make folder"),
        (lambda b: ((b / "s").mkdir(), b.bytes("s/sample_000000.exr", b"x"), synthesize(b)), "holds samples but no"),
    ]
)

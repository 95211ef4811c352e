"""A folder holds one job, whose count may grow."""

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bad_input import Bench, gets_one_clear_sentence
from claim_holder import HOLD, has_it
from synthetic import listing

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.job import (
    FOLDER_CLAIM,
    JOB_FILE,
    SampleJob,
    place_job,
    read_job,
    sample_number,
    sample_path,
    samples_there,
    write_job,
)

JOB = SampleJob("cycles", 12, seed=3, shapes=("blobs", "scene"), objects=("Bear", "Cat"), views=2, denoise=False)


def test_a_job_comes_back(tmp_path: Path) -> None:
    write_job(tmp_path, JOB)
    assert read_job(tmp_path) == JOB


def test_a_job_that_was_written_before_a_setting_existed_has_its_default(tmp_path: Path) -> None:
    (tmp_path / JOB_FILE).write_text('{"format": "mpsnet-samples", "version": 1, "renderer": "synthesis", "count": 3}')
    assert read_job(tmp_path) == SampleJob("synthesis", 3)


@pytest.mark.parametrize(("asked", "kept"), [(20, 20), (5, 12), (12, 12)])
def test_a_count_grows_and_never_shrinks(tmp_path: Path, asked: int, kept: int) -> None:
    place_job(tmp_path, JOB)
    place_job(tmp_path, replace(JOB, count=asked))
    assert read_job(tmp_path) == replace(JOB, count=kept)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"seed": 4}, "its seed is 3, not 4"),
        ({"objects": ("Bear",)}, "its objects is Bear, Cat, not Bear"),
        ({"shapes": ("blobs",), "objects": ()}, "its shapes is blobs, scene, not blobs"),
        ({"denoise": True}, "its denoise is False, not True"),
    ],
)
def test_another_job_is_refused_and_what_differs_is_reported(tmp_path, changes: dict[str, object], words: str) -> None:
    place_job(tmp_path, JOB)
    with pytest.raises(InputError, match=f"holds another job: {words}; choose another folder or the same settings"):
        place_job(tmp_path, replace(JOB, **changes, count=50))  # type: ignore[arg-type]
    assert read_job(tmp_path) == JOB


def test_a_job_waits_while_another_process_writes_the_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path), str(FOLDER_CLAIM)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert has_it(other)
        placing = threading.Thread(target=place_job, args=(tmp_path, JOB))
        placing.start()
        placing.join(0.3)
        assert placing.is_alive() and listing(tmp_path) == ["job.lock"]
        other.kill()
        placing.join(20)
    assert read_job(tmp_path) == JOB
    assert listing(tmp_path) == [JOB_FILE, "job.lock"]


@pytest.mark.parametrize("number", [0, 12, 999_999, 9_999_999])
def test_samples_are_found_by_their_names(tmp_path: Path, number: int) -> None:
    path = sample_path(tmp_path, number)
    path.write_bytes(b"x")
    for other in ("sample_1.exr", ".sample_000007.1.unfinished.exr", "sample_000008.png", "sample_000009.x.exr"):
        (tmp_path / other).write_bytes(b"x")
    sample_path(tmp_path, 5).touch()
    assert samples_there(tmp_path) == {number}
    assert sample_number(path.name) == number
    assert sample_number(f".{path.stem}.4711.unfinished.layers.exr") == number
    assert sample_number(".contact_sheet.4711.unfinished.png") is None


def make(b: Bench, *arguments: str | Path, **changes: Any) -> None:
    """`mpsnet make` with something changed in the job; None takes a key out."""
    write_job(b.folder, SampleJob("synthesis", 2, seed=3, size=16))
    b.changed(b / "job.json", changes)
    b.run("make", b.folder, *arguments)


test_a_bad_job_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("job of a newer version", lambda b: make(b, version=9), "job.json is version 9…update it"),
        ("job with a misspelled key", lambda b: make(b, cuont=3), "may have renderer, count"),
        ("job without a count", lambda b: make(b, count=None), 'job.json lacks "count"; add it'),
        ("job of another renderer", lambda b: make(b, renderer="eevee"), "renderer 'eevee' is not known"),
        ("shapes as text", lambda b: make(b, shapes="blobs"), "job's shapes must be a list of names, not 'blobs'"),
        ("objects without Blender", lambda b: make(b, objects=["Bear"], shapes=["scene"]), "scene's objects are"),
        ("measured materials in Blender", lambda b: make(b, renderer="cycles", merl="m.npz"), "merl) are for"),
        ("the paper's, lights anywhere", lambda b: make(b, merl="m.npz", style="paper", rigs="any"), "paper's rigs"),
        ("Blender for a synthesis", lambda b: make(b, "--blender", "blender"), "made without Blender"),
        (lambda b: make(b, "--blender", b / "blender", renderer="cycles"), "cannot run…blender (No such file…)"),
    ]
)

"""The command line as another program meets it: exit codes, what stands on stdout and stderr, and being cancelled."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from bad_input import SPHERE, Bench, gets_one_clear_sentence
from networks import pass_through
from numpy.typing import NDArray
from progress_lines import events
from synthetic import Sphere, degrees_between, listing, named, write_file, write_parts

from mpsnet_core import Operation, estimate_normals, read_capture, read_mesh, read_normals, read_rig
from mpsnet_core.cli.command import EXAMPLES, OPERATIONS, argument_parser


@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell")
@pytest.mark.parametrize(("closed", "told"), [("2>&-", ""), ("<&- >&- 2>&-", ""), (">&-", "check the path")])
def test_closed_streams_are_nobody_s(closed: str, told: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m mpsnet_core models no.onnx {closed}"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "") and told in done.stderr, done


def test_estimate_writes_what_it_says(tmp_path, mpsnet_process, rig_file, photo_file, sphere) -> None:
    mask, out = write_file(tmp_path / "mask.png", sphere.mask, "uint8"), tmp_path / "normals.png"
    confidence = tmp_path / "confidence.tif"
    command = ["estimate", photo_file, "--rig", rig_file, "--mask", mask, "--confidence", confidence, "-o", out]
    done = mpsnet_process(*command, "--model", "lambertian", "--progress", "json")
    assert (done.returncode, done.stderr) == (0, "")
    told, last = events(done.stdout)
    assert told == sorted(told) and 0 <= told[0] < told[-1] == 1
    result = last["result"]
    assert result["outputs"] == [str(out)]
    assert result["pixels"] == sphere.mask.sum()
    assert any("linear" in note for note in result["notes"])
    normals = read_normals(out)
    assert degrees_between(normals.vectors, sphere.normals)[sphere.lit].mean() < 0.01
    shares = oiio.ImageBuf(str(confidence)).get_pixels(oiio.FLOAT)[..., 0]
    assert set(np.rint(3 * shares[sphere.mask])) >= {2, 3}
    assert not shares[~sphere.mask].any()
    assert listing(tmp_path) == ["confidence.tif", "mask.png", "normals.png", "photo.exr", "rig.json"]


def test_the_options_reach_the_estimate(tmp_path: Path, mpsnet, rig_file: Path, sphere: Sphere) -> None:
    """A network, a layer, a mask by threshold, the DirectX convention, and a file's values taken as sRGB."""
    layers = named("A.", "RGB", 0 * sphere.image) | named("B.", "RGB", sphere.image)
    photo, out = write_parts(tmp_path / "layers.exr", [(None, layers)]), tmp_path / "normals.exr"
    model = pass_through(tmp_path / "identity.onnx")
    command = ["estimate", photo, "--layer", "B", "--rig", rig_file, "--model", model, "--mask", "threshold:0.5"]
    done = mpsnet(*command, "--convention", "directx", "--encoding", "srgb", "--threads", "1", "-o", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert str(out) in done.stdout
    normals = read_normals(out, convention="directx")
    linear = np.where(sphere.image <= 0.04045, sphere.image / 12.92, ((sphere.image + 0.055) / 1.055) ** 2.4)
    expected = np.linalg.solve(sphere.rig.directions, linear[..., None].astype(float))[..., 0]
    assert degrees_between(normals.vectors, expected)[normals.mask].max() < 0.01
    np.testing.assert_array_equal(normals.mask, linear.max(axis=-1) > 0.5 * np.percentile(linear.max(axis=-1), 99.9))


@pytest.mark.parametrize(("level", "shown"), [("info", 3), ("warning", 1), ("ERROR", 0), ("loud", None)])
def test_the_environment_chooses_the_notes(
    tmp_path: Path,
    mpsnet,
    rig_file: Path,
    photo_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    level: str,
    shown: int | None,
) -> None:
    monkeypatch.setenv("MPSNET_LOG_LEVEL", level)
    done = mpsnet("estimate", photo_file, "--rig", rig_file, "--model", "lambertian", "-o", tmp_path / "n.png")
    print(done.stderr)
    if shown is None:
        assert done.returncode == 2 and "MPSNET_LOG_LEVEL" in done.stderr
    else:
        assert done.returncode == 0 and len(done.stderr.splitlines()) == shown


def test_one_photo_is_averaged_over_passes_and_frames_only_when_asked(tmp_path, mpsnet, rig_file, sphere) -> None:
    (tmp_path / "shots").mkdir()
    (tmp_path / "out").mkdir()
    photo = write_file(tmp_path / "shots" / "frame_0001.exr", sphere.image, "half")
    capture = read_capture(photo, read_rig(rig_file))
    once, thrice = (estimate_normals(capture, passes=passes).vectors for passes in (1, 3))

    def estimated(image: Path, *options: str) -> NDArray[np.float32]:
        normals = tmp_path / "out" / "frame_0001_normals.exr"
        output = normals if image == photo else normals.parent
        done = mpsnet("estimate", image, "--rig", rig_file, *options, "--format", "exr", "-o", output)
        assert done.returncode == 0, done.stderr
        return read_normals(normals).vectors

    np.testing.assert_allclose(estimated(photo), thrice, atol=1e-6)
    np.testing.assert_allclose(estimated(photo, "--passes", "1"), once, atol=1e-6)
    # One after the other into the same folder: what other passes made is made anew.
    np.testing.assert_allclose(estimated(photo.parent), once, atol=1e-6)
    np.testing.assert_allclose(estimated(photo.parent, "--passes", "3"), thrice, atol=1e-6)
    np.testing.assert_allclose(estimated(photo.parent, "--passes", "1"), once, atol=1e-6)


@pytest.mark.parametrize("style", ["none", "json", "bar", "auto"])
def test_bad_input_is_one_line_and_exit_code_2(tmp_path: Path, mpsnet, photo_file: Path, style: str) -> None:
    missing, out = tmp_path / "missing.json", tmp_path / "n.png"
    done = mpsnet("estimate", photo_file, "--rig", missing, "-o", out, "--progress", style)
    assert done.returncode == 2
    sentence = f"rig file {missing} does not exist; check the path"
    assert done.stderr == f"mpsnet: {sentence}\n"
    assert [json.loads(line)["error"] for line in done.stdout.splitlines()] == [sentence] * (style == "json")
    assert not out.exists()


def test_an_unknown_verb_gets_those_that_the_help_lists(mpsnet) -> None:
    listed = re.findall(r"^  (\w+)(?: |$)", mpsnet().stdout, re.MULTILINE)
    offered = mpsnet("paint").stderr.partition("(choose from ")[2].partition(")")[0].split(", ")
    assert offered == listed and "estimate" in listed and "job" not in listed


# Runs the command line where the library that photos are read with cannot be loaded, or stops the process meanwhile.
LOADING = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "OpenImageIO":
            {does}
sys.meta_path.insert(0, Finder())
signal.signal(signal.SIGINT, signal.default_int_handler)
from mpsnet_core.cli import main
sys.exit(main(sys.argv[1:]))
"""


def while_loading(does: str, *arguments: str | Path, temporary: Path) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))}
    command = [sys.executable, "-c", LOADING.format(does=does), *map(str, arguments), "--progress", "json"]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, cwd=temporary)


def test_what_nobody_foresaw_is_one_sentence_and_a_log(tmp_path: Path, rig_file: Path, photo_file: Path) -> None:
    (tmp_path / "tmp").mkdir()
    estimate = ("estimate", photo_file, "--rig", rig_file, "-o", tmp_path / "n.png")
    done = while_loading(r"raise KeyError('\x1b[2J' * 999)", *estimate, temporary=tmp_path / "tmp")
    assert done.returncode == 1
    (log,) = (tmp_path / "tmp").iterdir()
    assert "Traceback" in log.read_text() and "find_spec" in log.read_text()
    (line,) = done.stderr.splitlines()
    assert line.startswith("mpsnet: this is a fault of the program, not yours (KeyError: ")
    assert str(log) in line and line.isprintable() and len(line) < 600
    assert json.loads(done.stdout)["error"] == line.removeprefix("mpsnet: ")
    assert os.name == "nt" or log.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(sys.platform != "linux", reason="others do not hold to the limit")
@pytest.mark.parametrize("megabytes", [100, 150, 200])
def test_too_little_memory_is_one_sentence(tmp_path: Path, rig_file: Path, photo_file: Path, megabytes: int) -> None:
    """With 150 OpenBLAS would wait for more for ever, and with 100 some library cannot be loaded."""
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_AS, ({megabytes << 20},) * 2)\n"
    command = "import sys; from mpsnet_core.cli import main; sys.exit(main(sys.argv[1:]))"
    estimate = ("estimate", photo_file, "--rig", rig_file, "--model", "lambertian", "-o", tmp_path / "n.png")
    words = [sys.executable, "-c", limit + command, *map(str, estimate)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "mpsnet: there is not enough memory; use a smaller size, or smaller photos\n"


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM"])
def test_a_run_that_is_stopped_while_libraries_load_is_cancelled(tmp_path, rig_file, photo_file, how: str) -> None:
    estimate = ("estimate", photo_file, "--rig", rig_file, "-o", tmp_path / "n.png")
    done = while_loading(f"os.kill(os.getpid(), signal.{how})", *estimate, temporary=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "mpsnet: stopped\n")


@pytest.mark.parametrize("kind", EXAMPLES)
def test_help_ends_with_an_example_that_fits_the_command(kind: type[Operation], capsys) -> None:
    assert argument_parser().parse_args(shlex.split(EXAMPLES[kind])[1:]).verb
    with pytest.raises(SystemExit):
        argument_parser().parse_args([*kind.command.split(), "--help"])
    assert " ".join(capsys.readouterr().out.split()).endswith(f"example: {EXAMPLES[kind]}")


def test_the_help_lists_each_command_below_one_heading() -> None:
    assert set(EXAMPLES) == {kind for kind in OPERATIONS if kind.listed}
    shown = argument_parser().format_help()
    for verb in {kind.command.split()[0] for kind in EXAMPLES}:
        assert len(re.findall(rf"^  {verb}\b", shown, re.MULTILINE)) == 1


@pytest.mark.parametrize(
    "line, meant",
    [("estmate photo.png", "estimate"), ("calibrate light", "lights"), ("models --overwitre", "--overwrite")],
)
def test_a_misspelt_word_is_told_what_was_probably_meant(mpsnet, line: str, meant: str) -> None:
    done = mpsnet(*line.split())
    assert done.returncode == 2 and f"did you mean {meant}?" in done.stderr


def test_a_missing_rig_says_how_to_get_one(mpsnet) -> None:
    assert "mpsnet calibrate photo" in mpsnet("material", "cloth.exr", "-o", "cloth").stderr


def test_files_that_the_answer_does_not_name_are_named(mpsnet, photo_file: Path, rig_file: Path) -> None:
    sure = photo_file.with_name("sure.png")
    estimate = ("estimate", photo_file, "--rig", rig_file, "--model", "lambertian")
    done = mpsnet(*estimate, "--confidence", sure, "-o", photo_file.with_name("n.png"))
    assert done.stdout.count("sure.png") == 1 and done.stdout.count("n.png") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="there is no /dev/full")
def test_an_answer_that_cannot_be_written_is_reported_once() -> None:
    command = f"{sys.executable} -m mpsnet_core models --progress json > /dev/full"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.long
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_a_stopped_estimate_of_many_frames_leaves_whole_files_only(tmp_path, rig_file, sphere, how):
    shots, out, count = tmp_path / "shots", tmp_path / "out", 400
    shots.mkdir()
    large = write_file(shots / "frame_0000.tif", np.tile(sphere.image, (4, 4, 1)), "uint16")
    for number in range(1, count):
        os.link(large, shots / f"frame_{number:04d}.tif")
    estimate = ["estimate", shots, "--rig", rig_file, "--mask", "none", "-o", out, "--progress", "json"]
    command = [sys.executable, "-m", "mpsnet_core", *map(str, estimate)]
    # A shell's background jobs ignore SIGINT and pass that on; the child must start with the usual disposition.
    usual = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **usual)
    assert child.stdout is not None and all("progress" in json.loads(child.stdout.readline()) for _ in range(10))
    child.send_signal(how)
    rest, words = child.communicate(timeout=30)
    assert (child.returncode, words) == (130, "mpsnet: stopped\n")
    assert all("progress" in json.loads(line) for line in rest.splitlines())
    written = listing(out)
    assert 0 < len(written) < count
    assert written == [f"frame_{number:04d}_normals.png" for number in range(len(written))]
    assert read_normals(out / written[-1]).mask.all()


def test_an_empty_argument_is_not_this_folder(mpsnet, rig_file: Path, tmp_path: Path) -> None:
    done = mpsnet("estimate", "", "--rig", rig_file, "-o", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr == "mpsnet: an argument is empty; check that the shell variable that it comes from is set\n"


test_a_bad_command_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("two hyphens for a value", lambda b: b.run("integrate", "n.png", "--open=--"), "--open: expected a value"),
        ("unknown verb", lambda b: b.run("paint"), "'paint'…see mpsnet --help"),
        ("no rig", lambda b: b.run("estimate", b.photo(), "-o", b / "n.png"), "give the rig"),
        ("unknown option", lambda b: b.estimate(colour="red"), "--colour…see mpsnet estimate --help"),
        (lambda b: b.run("evaluate", "diligent", "pmsData", "--colour"), "--colour; see mpsnet evaluate diligent"),
        (lambda b: b.run("estimate", "p.png", "--rig", "r.json", "--passes", "2", "-o", "n.png"), "passes 2 is not"),
        (lambda b: estimate_normals(SPHERE.capture(), "psfcn", passes=3), 'psfcn.onnx…needs the "frame" "canonical"'),
    ]
)


@pytest.mark.usefixtures("process_settings_restored")
def test_what_the_cases_of_bad_input_spoil_is_good_before(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    assert read_capture(b.photo(), read_rig(b.rig()), mask=b.mask()).image.shape == (16, 16, 3)
    assert read_mesh(b.mesh()).triangles.shape == (2, 3)
    for good in (b.estimate, b.bake, *([b.evaluate] if find_spec("scipy") else [])):
        with pytest.raises(AssertionError, match=r"^exit code 0: "):
            good()

"""What Windows and macOS do otherwise than Linux, imitated here."""

import sys
from pathlib import Path

import pytest

from mpsnet_core.cli.command import _is_closed_pipe
from mpsnet_core.errors import FileError
from mpsnet_core.io import files
from mpsnet_core.io.crash_log import describe_unexpected_error
from mpsnet_core.io.files import atomic_write, check_no_overwrite, write_json, write_transaction
from mpsnet_core.io.frames import output_files
from mpsnet_core.synthesis.reflectance import material_names
from mpsnet_core.synthesis.shapes.meshes import mesh_files


def denied(monkeypatch: pytest.MonkeyPatch, method: str, times: int) -> None:
    """Another program has files open for the next so many calls."""
    real, left = getattr(Path, method), [times]

    def tried(path: Path, *arguments: object, **options: object) -> object:
        left[0] -= 1
        if left[0] >= 0:
            raise PermissionError(13, "Permission denied")
        return real(path, *arguments, **options)

    monkeypatch.setattr(Path, method, tried)


def test_a_file_that_is_held_for_a_moment_is_replaced_all_the_same(tmp_path, monkeypatch) -> None:
    (tmp_path / "a.json").touch()
    denied(monkeypatch, "replace", 2)
    write_json(tmp_path / "a.json", {"new": True})
    assert "new" in (tmp_path / "a.json").read_text(encoding="utf-8")


def test_a_file_that_stays_open_elsewhere_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "DENIED_SECONDS", (0.0,))
    (tmp_path / "a.json").touch()
    denied(monkeypatch, "replace", 9)
    with pytest.raises(FileError, match=r"a\.json: Permission denied; close the program that has it open"):
        write_json(tmp_path / "a.json", {})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_what_cannot_be_removed_does_not_hide_why_it_was_to_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    denied(monkeypatch, "unlink", 9)
    with pytest.raises(KeyboardInterrupt), atomic_write(tmp_path / "a.txt"):
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt), write_transaction():
        write_json(tmp_path / "b.json", {})
        raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform == "win32", reason="its paths ignore case by themselves")
@pytest.mark.parametrize(("system", "same"), [("darwin", True), ("linux", False)])
def test_names_that_macos_takes_for_one_would_be_overwritten(tmp_path, monkeypatch, system: str, same: bool) -> None:
    monkeypatch.setattr(sys, "platform", system)
    for taken, output in (("Photo.png", "photo.png"), ("Sta\u0308r.png", "st\u00e4r.png")):
        refused = False
        try:
            check_no_overwrite([tmp_path / taken], [tmp_path / output])
        except FileError:
            refused = True
        assert refused == same


def test_photos_whose_results_differ_by_case_alone_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="two photos would both be written to"):
        output_files([tmp_path / "a" / "IMG_1.png", tmp_path / "b" / "img_1.png"], tmp_path / "out")


def test_the_halves_of_files_that_macos_leaves_on_other_disks_are_no_data(tmp_path: Path) -> None:
    for name in ("bunny.obj", "._bunny.obj", "alum.binary", "._alum.binary"):
        (tmp_path / name).touch()
    assert mesh_files(tmp_path) == ["bunny.obj"]
    assert material_names(tmp_path) == [("merl", "alum.binary")]


@pytest.mark.parametrize(("system", "gone"), [("win32", True), ("linux", False)])
def test_windows_calls_a_closed_pipe_an_invalid_argument(monkeypatch, system: str, gone: bool) -> None:
    monkeypatch.setattr(sys, "platform", system)
    assert _is_closed_pipe(OSError(22, "Invalid argument")) == gone
    assert not _is_closed_pipe(OSError(22, "Invalid argument", "photo.png"))
    assert _is_closed_pipe(BrokenPipeError(32, "Broken pipe"))


def test_a_library_without_its_runtime_says_what_to_install() -> None:
    said = describe_unexpected_error(
        ImportError("DLL load failed while importing onnxruntime_pybind11_state: The specified module")
    )
    assert "install Microsoft's Visual C++ runtime from https://" in said and "fault" not in said

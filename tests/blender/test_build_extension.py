"""The build script's judgement about wheels, where it has to be the same as Blender's own."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from blender_addon.build_extension import (
    ADDON,
    PROJECT,
    BuildError,
    Target,
    check_unambiguous,
    find_blender_ext,
    missing_requirements,
)

LINUX_311, LINUX_313 = Target("3.11", "linux-x64"), Target("3.13", "linux-x64")


def test_blender_s_own_validator_accepts_the_manifest():
    command = [sys.executable, find_blender_ext(), "validate", ADDON]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_manifest_and_distribution_agree():
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert manifest["version"] == project["version"]
    assert manifest["license"] == [f"SPDX:{project['license']}"]


def test_requirements_of_another_platform_are_found_missing():
    tqdm = {
        "name": "tqdm",
        "requires_dist": [
            'colorama; platform_system == "Windows"',
            'pytest>=6; extra == "dev"',
            "numpy; python_version < '3'",
        ],
    }
    assert missing_requirements([tqdm], Target("3.11", "windows-x64")) == ["colorama"]
    assert missing_requirements([tqdm], LINUX_311) == []
    assert missing_requirements([tqdm, {"name": "Colorama"}], Target("3.11", "windows-x64")) == []


@pytest.mark.parametrize(
    ("for_311", "for_313"),
    [
        ("packaging-26.3-py3-none-any.whl", "packaging-27.0-py3-none-any.whl"),
        ("protobuf-6.1-cp311-cp311-manylinux2014_x86_64.whl", "protobuf-7.0-cp310-abi3-manylinux2014_x86_64.whl"),
    ],
)
def test_a_newer_wheel_that_both_pythons_take_is_refused(for_311, for_313):
    chosen = {LINUX_311: [Path(for_311)], LINUX_313: [Path(for_313)]}
    with pytest.raises(BuildError, match=rf"Python 3\.11 .* was to have {for_311} but would take {for_313}"):
        check_unambiguous(chosen)


@pytest.mark.parametrize(
    ("for_311", "for_313"),
    [
        ("packaging-26.3-py3-none-any.whl", "packaging-26.3-py3-none-any.whl"),
        ("oiio-3.0-cp311-cp311-manylinux_2_28_x86_64.whl", "oiio-3.2-cp313-cp313-manylinux_2_28_x86_64.whl"),
        # The older one serves both, but Blender takes the newer where it can.
        ("protobuf-6.1-cp310-abi3-manylinux2014_x86_64.whl", "protobuf-7.0-cp313-cp313-manylinux2014_x86_64.whl"),
    ],
)
def test_wheels_that_blender_tells_apart_are_accepted(for_311, for_313):
    check_unambiguous({LINUX_311: [Path(for_311)], LINUX_313: [Path(for_313)]})

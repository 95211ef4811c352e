"""The build script: what it makes of wheels, and where it has to judge as Blender does."""

import gettext
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from build_extension import (
    ADDON,
    PROJECT,
    Target,
    compile_catalogs,
    find_blender_ext,
    missing_requirements,
    notices,
)


def test_blender_s_own_validator_accepts_the_manifest():
    command = [sys.executable, find_blender_ext(), "validate", ADDON]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_manifest_and_distribution_agree():
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
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
    assert missing_requirements([tqdm], Target("3.11", "linux-x64")) == []
    assert missing_requirements([tqdm, {"name": "Colorama"}], Target("3.11", "windows-x64")) == []


def wheel(folder: Path, name: str, files: dict[str, str]) -> Path:
    path = folder / f"{name}-1.0-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for inside, text in files.items():
            archive.writestr(inside, text)
    return path


def test_notices_hold_each_wheels_licence_by_name_and_its_files(tmp_path):
    plain = wheel(
        tmp_path,
        "plain",
        {
            "plain-1.0.dist-info/METADATA": "Name: plain\nLicense: Copyright (c) Ann\n\nLICENSE",
            "plain-1.0.dist-info/licenses/LICENCE": "Ann's words",
            "plain-1.0.dist-info/licenses/vendored/COPYING.zlib": "of zlib",
            "plain/ThirdPartyNotices.txt": "of others",
            "plain/licenses.py": "code",
            "plain/__init__.py": "more code",
        },
    )
    bare = wheel(tmp_path, "bare", {"bare-1.0.dist-info/METADATA": "Name: bare\nLicense-Expression: Apache-2.0\n"})
    found = notices([plain, bare])
    assert "plain 1.0: its own\n" in found and "bare 1.0: Apache-2.0\n" in found
    assert all(words in found for words in ("Ann's words", "of zlib", "of others"))
    assert "code" not in found


def test_the_extension_holds_compiled_catalogs(tmp_path):
    shutil.copytree(ADDON / "locale", tmp_path / "locale")
    compile_catalogs(tmp_path)
    assert sorted(path.name for path in (tmp_path / "locale").iterdir()) == ["de_DE.mo", "zh_HANS.mo"]
    with (tmp_path / "locale" / "de_DE.mo").open("rb") as file:
        assert gettext.GNUTranslations(file).gettext("Bake Texture") == "Textur backen"

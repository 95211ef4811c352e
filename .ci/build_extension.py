"""Build the extension's zips, one for each platform and Python, and the index of a repository of them.

    python .ci/build_extension.py [--python 3.11 3.13] [--platform linux-x64 windows-x64 macos-arm64]

A zip has all dependencies except Python and NumPy, which are Blender's own. Each wheel is the unmodified one from PyPI,
so its RECORD is valid; only the project's own wheel is built here. Videos need no library: Blender decodes them.
"""

import argparse
import email
import importlib.metadata
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from packaging.requirements import Requirement
from packaging.tags import mac_platforms
from packaging.utils import canonicalize_name, parse_wheel_filename

from mpsnet_core import __version__

PROJECT = Path(__file__).resolve().parent.parent
ADDON = PROJECT / "blender_addon"
CORE = PROJECT / "mpsnet_core"
WORK = PROJECT / "build" / "extension"

# The oldest NumPy that a Blender with this Python ships; bundled wheels must work with it. 4.5 and 5.0 have Python
# 3.11, 5.1 and 5.2 have 3.13; Debian builds its Blender with its own 3.14.
BLENDER_NUMPY = {"3.11": "1.26.*", "3.13": "2.2.*", "3.14": "2.3.*"}


# For each of Blender's platforms, the compatible tags of wheels, and its values of these environment markers. Blender
# itself needs glibc 2.28; onnxruntime's wheels need macOS 14.
MARKERS = ("sys_platform", "platform_system", "os_name", "platform_machine")
MANYLINUX = [*(f"manylinux_2_{minor}_x86_64" for minor in range(28, 16, -1)), "manylinux2014_x86_64"]
PLATFORMS: dict[str, tuple[list[str], str, str, str, str]] = {
    "linux-x64": (MANYLINUX, "linux", "Linux", "posix", "x86_64"),
    "windows-x64": (["win_amd64"], "win32", "Windows", "nt", "AMD64"),
    "macos-arm64": (list(mac_platforms((14, 0), "arm64")), "darwin", "Darwin", "posix", "arm64"),
}

# Optional dependencies of the core that Blender's users cannot install themselves: camera raw.
EXTRAS = ("raw",)

NOTICES = "THIRD_PARTY_NOTICES.txt"

# Well below the limit of extensions.blender.org.
MAX_ZIP_BYTES = 80 * 1000 * 1000

# Programs that run at the same time.
AT_ONCE = 4


def fail(sentence: str) -> NoReturn:
    """End the build with a sentence: what is wrong and how to mend it."""
    sys.exit(f"build_extension: {sentence}")


@dataclass(frozen=True)
class Target:
    """One Python on one platform."""

    python: str
    """Its version, such as 3.13."""
    platform: str
    """Its key in PLATFORMS."""

    def __str__(self) -> str:
        return f"Python {self.python} on {self.platform}"

    @property
    def folder(self) -> str:
        return f"{self.python}-{self.platform}"

    @property
    def pip_options(self) -> list[str]:
        options = ["--only-binary=:all:", "--implementation=cp", f"--python-version={self.python}"]
        return [*options, *(f"--platform={tag}" for tag in PLATFORMS[self.platform][0])]

    @property
    def markers(self) -> dict[str, str]:
        """The environment in which markers such as `sys_platform == "win32"` are evaluated."""
        _, *values = PLATFORMS[self.platform]
        names = dict(zip(MARKERS, values, strict=True))
        return {**names, "python_version": self.python, "python_full_version": f"{self.python}.0", "extra": ""}


def run(command: Sequence[str | Path], failure: str) -> None:
    """Run `command` quietly. If it fails, end the build with `failure` and the end of its output."""
    done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", cwd=PROJECT)
    if done.returncode:
        lines = [line.strip() for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        errors = [line for line in lines if line.lower().startswith(("error", "fatal"))] or lines[-1:]
        fail(f"{failure}: {errors[0] if errors else f'exit code {done.returncode}'}")


def find_blender_ext() -> Path:
    """Blender's own command-line packager inside the installed bpy."""
    spec = importlib.util.find_spec("bpy")
    for folder in (spec.submodule_search_locations if spec else None) or ():
        for found in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"):
            return found
    fail("bpy is not installed here; install it or name a Blender's blender_ext.py with --blender-ext")


def build_core_wheel(folder: Path) -> Path:
    """Build the wheel of mpsnet_core in `folder`, without training and evaluation, which nobody does inside Blender."""
    shutil.rmtree(folder, ignore_errors=True)
    with tempfile.TemporaryDirectory() as temporary:  # outside of the checkout, whose .gitignore the build obeys
        source = Path(temporary)
        shutil.copytree(CORE, source / CORE.name, ignore=shutil.ignore_patterns("__pycache__", "learning"))
        for name in ("pyproject.toml", "LICENSE", "README.md"):
            shutil.copy2(PROJECT / name, source)
        options = ["--no-deps", f"--wheel-dir={folder}"]
        run([sys.executable, "-m", "pip", "wheel", *options, source], "no wheel of mpsnet_core")
    print("the wheel of mpsnet_core is built", flush=True)
    return next(folder.glob("*.whl"))


def resolve(requirements: Sequence[str], target: Target) -> list[str]:
    """All dependencies of `requirements` on `target`, as "name==version", without numpy, which is Blender's own.

    The build ends if there is no such set of wheels, or none that works with Blender's NumPy.
    """
    folder = WORK / "wheels" / target.folder
    folder.mkdir(parents=True, exist_ok=True)
    report, constraints = folder / "report.json", folder / "constraints.txt"
    constraints.write_text(f"numpy=={BLENDER_NUMPY[target.python]}\n", encoding="utf-8")
    wanted = list(requirements)
    while True:
        # `install --dry-run` only resolves; --target allows wheels of another Python.
        options = ["--dry-run", "--ignore-installed", f"--target={WORK}", f"--report={report}", "--quiet"]
        command = [sys.executable, "-m", "pip", "install", *options, *target.pip_options, f"--constraint={constraints}"]
        run([*command, *wanted], f"the dependencies for {target} cannot be resolved")
        found = [item["metadata"] for item in json.loads(report.read_text(encoding="utf-8"))["install"]]
        # pip evaluates markers for its own Python and platform, so dependencies that only `target` has are missing.
        missing = missing_requirements(found, target)
        if not missing:
            return sorted(
                f"{canonicalize_name(item['name'])}=={item['version']}" for item in found if item["name"] != "numpy"
            )
        wanted += missing


def missing_requirements(found: Sequence[dict[str, Any]], target: Target) -> list[str]:
    """The requirements of `found` (wheels' metadata) that apply to `target` and that nothing in `found` satisfies."""
    names = {canonicalize_name(item["name"]) for item in found}
    needed = (Requirement(line) for item in found for line in item.get("requires_dist", []))
    return sorted(
        {
            f"{one.name}{one.specifier}"
            for one in needed
            if canonicalize_name(one.name) not in names and (one.marker is None or one.marker.evaluate(target.markers))
        }
    )


def download(pins: Sequence[str], target: Target) -> list[Path]:
    """Download the wheels of `pins` to the build folder, where the next build finds them."""
    folder = WORK / "wheels" / target.folder
    command = [sys.executable, "-m", "pip", "download", "--no-deps", f"--dest={folder}", *target.pip_options]
    run([*command, *pins], f"the wheels for {target} cannot be downloaded")
    wheels = [wheel for wheel in sorted(folder.glob("*.whl")) if "==".join(identity(wheel)) in pins]
    if len(wheels) != len(pins):
        fail(f"{folder} holds {len(wheels)} wheels of {len(pins)} packages; empty it and build again")
    return wheels


def find_wheels(requirements: Sequence[str], target: Target) -> list[Path]:
    """The wheels of all dependencies of `requirements` on `target`."""
    pins = resolve(requirements, target)
    wheels = download(pins, target)
    print(f"{target}: {', '.join(pins)}", flush=True)
    return wheels


def identity(wheel: Path) -> tuple[str, str]:
    """A wheel's normalised name and version."""
    name, version, _, _ = parse_wheel_filename(wheel.name)
    return str(name), str(version)


def notices(wheels: Iterable[Path]) -> str:
    """The licence notices of `wheels`: the name of each licence, and its files."""
    parts = ["What this extension brings along, and on what terms. MPS-Net's own are in LICENSE.\n"]
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as archive:
            names = archive.namelist()
            metadata = next(name for name in names if re.fullmatch(r"[^/]+\.dist-info/METADATA", name))
            licence = _licence(archive.read(metadata).decode())
            parts.append(f"{'=' * 100}\n{' '.join(identity(wheel))}: {licence}\n")
            for name in filter(_is_notice, names):
                text = archive.read(name).decode("utf-8", errors="replace").replace("\r\n", "\n").strip()
                parts.append(f"--- {name}\n\n{text}\n")
    return "\n".join(parts)


def _licence(metadata: str) -> str:
    """The name of a licence from a wheel's metadata, which may hold its full text."""
    fields = email.message_from_string(metadata)
    classified = [line for line in fields.get_all("Classifier", []) if line.startswith("License ::")]
    stated = [fields["License-Expression"], *(line.split("::")[-1] for line in classified), fields["License"]]
    names = (line.strip().splitlines()[0] for line in stated if line and line.strip())
    return next((name for name in names if not name.lower().startswith("copyright")), "its own")


def _is_notice(name: str) -> bool:
    """Whether a file in a wheel is about its licence."""
    path = Path(name)
    inside = name.endswith("/") or path.suffix == ".py"
    named = re.match(r"(licen[cs]e|copying|notice|third-?party)", path.name, re.IGNORECASE)
    return not inside and bool(named or ".dist-info/licenses/" in name)


def build_manual(folder: Path) -> bool:
    """Build the documentation in `folder` for Blender's Online Manual. Returns False if Sphinx is not installed."""
    if importlib.util.find_spec("sphinx") is None:
        print("without the manual: pip install -e '.[docs]', and the zips have it")
        return False
    shutil.rmtree(folder, ignore_errors=True)
    options = ["-q", "-b", "html", f"-d{WORK / 'doctrees'}"]
    run([sys.executable, "-m", "sphinx", *options, PROJECT / "docs", folder], "the manual cannot be built")
    print("the manual is built", flush=True)
    return True


def manual_notices() -> str:
    """The licences of the theme and scripts in the manual's pages."""
    parts = []
    for package in map(importlib.metadata.distribution, ("sphinx", "furo")):
        name = f"{package.metadata['Name']} {package.version}: {_licence(str(package.metadata))}"
        parts.append(f"{'=' * 100}\n{name}\n")
        for file in filter(lambda file: _is_notice(str(file)), package.files or ()):
            parts.append(f"--- {file}\n\n{file.read_text(encoding='utf-8').strip()}\n")
    return "\n".join(parts)


def compile_catalogs(source: Path) -> None:
    """Replace the translators' catalogs in the staged extension by compiled ones."""
    for catalog in sorted(source.glob("locale/*.po")):
        options = [f"--input-file={catalog}", f"--output-file={catalog.with_suffix('.mo')}"]
        run([sys.executable, "-m", "babel.messages.frontend", "compile", *options], f"{catalog.name} is no catalog")
        catalog.unlink()


def warn_of_missing_translations() -> None:
    """Say what the catalogs lack, if bpy is there to look. That is a warning: what they lack stays English."""
    check = [sys.executable, ".ci/update_translations.py", "--check"]
    if importlib.util.find_spec("bpy") is not None and subprocess.run(check, cwd=PROJECT).returncode:
        print("the translations could not be checked; see above")


def stage(core: Path, wheels: Sequence[Path], platform: str, manual: Path | None) -> Path:
    """Lay out the extension's source with its wheels and their notices, and name the wheels in its manifest.

    manual: the folder of the documentation's pages, None for none.
    """
    source = WORK / "source"
    if source.exists():
        shutil.rmtree(source)
    shutil.copytree(ADDON, source, ignore=shutil.ignore_patterns("__pycache__"))
    compile_catalogs(source)
    shutil.copy2(PROJECT / "LICENSE", source)
    words = notices(wheels)
    if manual is not None:
        left_out = shutil.ignore_patterns(".*", "*.map", "objects.inv", "_sources")
        shutil.copytree(manual, source / "manual", ignore=left_out)
        words = f"{words}\n{manual_notices()}"
    (source / NOTICES).write_text(words, encoding="utf-8")
    (source / "wheels").mkdir()
    names = sorted(Path(shutil.copy2(wheel, source / "wheels")).name for wheel in (core, *wheels))
    manifest = source / "blender_manifest.toml"
    # JSON lists of strings are valid TOML. At the top of the file, they belong to no table.
    head = f"platforms = {json.dumps([platform])}\nwheels = {json.dumps([f'./wheels/{name}' for name in names])}\n"
    manifest.write_text(head + manifest.read_text(encoding="utf-8"), encoding="utf-8")
    return source


def check_zip(path: Path, blender_ext: Path) -> None:
    """End the build if Blender or extensions.blender.org would not accept the zip."""
    run([sys.executable, blender_ext, "validate", path], f"Blender refuses {path.name}")
    with zipfile.ZipFile(path) as archive:
        if any(Path(name).name.startswith("numpy-") for name in archive.namelist()):
            fail(f"{path.name} holds a numpy wheel, which would replace Blender's own; leave it out")
        parts = sorted((info.compress_size / 1e6, Path(info.filename).name) for info in archive.infolist())[::-1]
    size = path.stat().st_size
    print(f"{path.name}  {size / 1e6:.1f} MB: " + ", ".join(f"{name.split('-')[0]} {mb:.1f}" for mb, name in parts[:6]))
    if size > MAX_ZIP_BYTES:
        fail(f"{path.name} is above {MAX_ZIP_BYTES / 1e6:.0f} MB; see above what takes the room")


def build(pythons: Sequence[str], platforms: Sequence[str], output: Path, blender_ext: Path) -> None:
    """Build one zip for each platform and Python into `output`, and the index of a repository of all zips there."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    manifest = tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))
    if manifest["version"] != __version__:
        fail(f"blender_manifest.toml has version {manifest['version']}, mpsnet_core {__version__}; match them")
    extras = project["optional-dependencies"]
    requirements = [*project["dependencies"], *(line for extra in EXTRAS for line in extras[extra])]
    output.mkdir(parents=True, exist_ok=True)
    packager = [sys.executable, str(blender_ext)]
    targets = [Target(python, platform) for platform in platforms for python in pythons]
    print("building the manual and the wheel of mpsnet_core, finding all other wheels", flush=True)
    with ThreadPoolExecutor(AT_ONCE) as pool:  # pip mostly waits for the network
        made = pool.submit(build_manual, WORK / "manual")
        found = [pool.submit(find_wheels, requirements, target) for target in targets]
        translations = pool.submit(warn_of_missing_translations)
        core = build_core_wheel(WORK / "core")
        manual = WORK / "manual" if made.result() else None
        for target, wheels in zip(targets, found, strict=True):
            source = stage(core, wheels.result(), target.platform, manual)
            path = output / f"{manifest['id']}-{manifest['version']}-{target.platform}-python{target.python}.zip"
            build_options = ["build", f"--source-dir={source}", f"--output-filepath={path}"]
            run([*packager, *build_options], "Blender cannot pack the extension")
            check_zip(path, blender_ext)
        translations.result()
    run([*packager, "server-generate", f"--repo-dir={output}", "--html"], f"Blender cannot list the zips in {output}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the Blender extension's zips, one per platform and Python.")
    pythons, default = list(BLENDER_NUMPY), ["3.11", "3.13"]
    parser.add_argument(
        "--python", nargs="+", choices=pythons, default=default, help="Blenders' Pythons (default: 3.11 3.13)"
    )
    parser.add_argument("--platform", nargs="+", choices=PLATFORMS, default=list(PLATFORMS), help="(default: all)")
    parser.add_argument("--output", type=Path, default=PROJECT / "dist", help="folder of the zips (default: dist)")
    parser.add_argument(
        "--blender-ext", type=Path, help="Blender's blender_ext.py (default: that of the installed bpy)"
    )
    options = parser.parse_args()
    blender_ext = options.blender_ext or find_blender_ext()
    if not blender_ext.is_file():
        fail(f"{blender_ext} does not exist; Blender has it under scripts/addons_core/bl_pkg/cli")
    build(options.python, options.platform, options.output.resolve(), blender_ext.resolve())


if __name__ == "__main__":
    main()

"""The documentation says what is so: its commands and code fit the program, its links lead somewhere."""

import ast
import importlib
import importlib.util
import re
import runpy
import subprocess
import sys

import pytest
from documentation import GENERATED, PROJECT, WRITTEN, blocks, commands

from mpsnet_core.cli.command import argument_parser

PARSER = argument_parser()


def page_name(page):
    return str(page.relative_to(PROJECT))


@pytest.mark.parametrize("page", WRITTEN, ids=page_name)
def test_commands_are_ones_that_there_are(page):
    for arguments in commands(page, "mpsnet"):
        PARSER.parse_args(arguments)


@pytest.mark.parametrize("page", WRITTEN, ids=page_name)
def test_python_compiles_and_imports_what_there_is(page):
    for block in blocks(page, "python"):
        compile(block, page.name, "exec")
        for module, names in re.findall(r"^from ([\w.]+) import \(?([^)]+?)\)?$", block, re.MULTILINE):
            if importlib.util.find_spec("torch") is None and ".training" in module:
                continue
            for name in re.findall(r"\w+", names):
                assert hasattr(importlib.import_module(module), name), f"{module} has no {name}"


@pytest.mark.parametrize("page", WRITTEN, ids=page_name)
def test_links_and_pictures_lead_to_files(page):
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))
    places = [(page.parent / link).resolve() for link in links if "://" not in link]
    assert not [place for place in places if place not in GENERATED and not place.exists()]


@pytest.mark.parametrize("page", WRITTEN, ids=page_name)
def test_files_of_the_project_that_a_page_names_are_there(page):
    """But for what a run leaves, and for NAMES that stand for others."""
    named = re.findall(
        r"(?<![\w/.])(?:tests|examples|mpsnet_core|docs|blender_addon)/[\w./-]+", page.read_text(encoding="utf-8")
    )
    made = [name for name in named if name.startswith(("examples/output", "docs/_build")) or "NAME" in name]
    assert not [name for name in named if name not in made and not (PROJECT / name.rstrip(".")).exists()]


def test_every_code_at_the_end_of_a_message_has_its_entry_under_symptoms():
    """A code is two words or more in brackets, such as [no-mask], and the anchor of its entry."""
    sources = [path for package in ("mpsnet_core", "blender_addon") for path in (PROJECT / package).rglob("*.py")]
    texts = [
        node.value
        for path in sources
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    codes = {code for text in texts for code in re.findall(r"(?:^| )\[([a-z]+(?:-[a-z]+)+)\]$", text)}
    page = (PROJECT / "docs" / "how_to" / "symptoms.md").read_text(encoding="utf-8")
    entries = re.findall(r"^\(([a-z-]+)\)=\n### .+\n\n(?:!\[.*\n\n)?`\[([a-z-]+)\]` ", page, re.MULTILINE)
    assert all(anchor == code for anchor, code in entries)
    assert sorted(code for _, code in entries) == sorted(codes)
    assert len(codes) >= 10


def test_the_reference_has_the_options_below_the_headings_of_help(capsys):
    page = "\n".join(runpy.run_path(str(PROJECT / "docs" / "generated_pages.py"))["command_line"]())
    for section in page.split("\n## mpsnet ")[1:]:
        with pytest.raises(SystemExit):
            PARSER.parse_args([*section.partition("\n")[0].split(), "--help"])
        options = capsys.readouterr().out.partition("\noptions:\n")[2]
        helped = re.findall(r"^(\w.+):$|^  (?:-\w(?: [^,]+)?, )?(--[a-z-]+)", options, re.MULTILINE)
        own = [(heading.lower(), flag) for heading, flag in helped if flag not in {"--help", "--progress"}]
        shown = re.findall(r"^\*\*(.+)\*\*$|^(?:`-\w [^`]+`, )?`(--[a-z-]+)", section, re.MULTILINE)
        assert [(heading.lower(), flag) for heading, flag in shown] == own


def test_the_reference_shows_placeholders_of_names():
    """Markdown takes a bare <UDIM> for a tag, and a browser shows nothing there."""
    pages = runpy.run_path(str(PROJECT / "docs" / "generated_pages.py"))
    page = "\n".join(pages["command_line"]())
    assert "`<UDIM>`" in page
    assert not re.search(r"(?<!`)<[A-Z]+>", page)


@pytest.mark.long
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("furo", reason="needs the extra docs")
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "docs", tmp_path]
    done = subprocess.run(build, cwd=PROJECT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr


LIBRARIES = re.compile(r"\blib[a-z]+\d+\b")


@pytest.mark.parametrize(
    "page", [page for page in WRITTEN if "[blender" in page.read_text(encoding="utf-8")], ids=page_name
)
def test_pages_that_install_bpy_name_the_libraries_that_it_needs(page):
    """A bare Debian lacks them; the pages include one list, and README and the farm's image have the same."""
    text = page.read_text(encoding="utf-8")
    listed = set(LIBRARIES.findall((PROJECT / "docs" / "start" / "_bpy.md").read_text(encoding="utf-8")))
    assert "{include} ../start/_bpy.md" in text or set(LIBRARIES.findall(text)) == listed

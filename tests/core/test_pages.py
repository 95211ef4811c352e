"""Every page's commands and Python run as they stand, from top to bottom, where the files that they name are.

What needs Blender runs in tests/addon; documentation.py names what does not run, and why.
"""

import re
import shutil
from pathlib import Path

import pytest
from documentation import INSTEAD, LEFT_OUT, PROJECT, WRITTEN, needs_blender, run_page, script
from page_inputs import make_inputs

PAGES = [page for page in WRITTEN if script(page) and not needs_blender(page)]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    return folder


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_the_page_runs_from_top_to_bottom(page: Path, inputs: Path, tmp_path: Path) -> None:
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    run_page(page, tmp_path)


@pytest.mark.parametrize("pattern", [*LEFT_OUT, *INSTEAD])
def test_an_exception_is_of_a_line_that_there_is(pattern: str) -> None:
    blocks = re.findall(r"^```(?:bash|python)\n.*?^```$", "\n".join(map(read, WRITTEN)), re.MULTILINE | re.DOTALL)
    assert re.search(pattern, "\n".join(blocks), re.MULTILINE)


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")

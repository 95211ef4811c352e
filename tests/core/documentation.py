"""What tests read of the documentation: its pages, and the code in them."""

import re
import shlex
from pathlib import Path

PROJECT = Path(__file__).parents[2]
# The pages that docs/generated_pages.py writes.
GENERATED = {PROJECT / "docs" / "reference" / name for name in ("command_line.md", "python.md", "blender.md")}
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *sorted((PROJECT / "docs").rglob("*.md"))]
WRITTEN = [page for page in PAGES if page not in GENERATED and "_build" not in page.parts]


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(page: Path, program: str) -> list[list[str]]:
    """The arguments of each call of a program in the page's shell blocks, without the program's name."""
    found = []
    for block in blocks(page, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(re.sub(r"(^|\s)#\s.*", "", line))
            if words and words[0] == program:
                found.append(words[1:])
    return found

"""How Sphinx builds these pages: ``python -m sphinx -W -b html docs docs/_build``."""

import runpy
from pathlib import Path

import mpsnet_core

HERE = Path(__file__).parent

project = "MPS-Net for Blender"
author = "The MPS-Net contributors"
copyright = "GPL-3.0-or-later"
version = release = mpsnet_core.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
# A link that leads nowhere fails the build.
nitpicky = False

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "MPS-Net"
html_static_path: list[str] = []
html_copy_source = False


def setup(app: object) -> None:
    """Write the pages that follow from the code before Sphinx looks which pages there are."""
    runpy.run_path(str(HERE / "generated_pages.py"))["write"](HERE / "reference")

"""How Sphinx builds these pages: ``python -m sphinx -W -b html docs docs/_build``."""

import runpy
from pathlib import Path

from sphinx.application import Sphinx

import mpsnet_core

HERE = Path(__file__).parent

project = "MPS-Net for Blender"
author = "The MPS-Net contributors"
copyright = f"{author}, GPL-3.0-or-later"
version = release = mpsnet_core.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build", "start/_bpy.md"]  # pages include the latter
# Options stay as one types them: a dash is two of "--mask", and JSON has straight quotes.
smartquotes = False

autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "MPS-Net"
html_static_path = ["style.css"]
html_css_files = ["style.css"]
html_copy_source = False


def setup(app: Sphinx) -> None:
    """Write the pages that follow from the code before Sphinx looks which pages there are, and after it what leads to
    them from Blender."""
    generated = runpy.run_path(str(HERE / "generated_pages.py"))
    generated["write"](HERE / "reference")
    app.connect("build-finished", lambda app, error: generated["write_redirects"](Path(app.outdir, "reference")))

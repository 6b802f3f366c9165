"""How the documentation is built: `make docs`. Nothing is fetched; a warning is an error."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from reference_pages import write_reference

from vinefab.core import __version__

project = "vinefab"
author = "the vinefab developers"
release = version = __version__
# llms-full.txt: the whole documentation as one text, for programs that read.
extensions = ["myst_parser", "sphinx_llms_txt"]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4
exclude_patterns = ["_build", "pictures"]
html_theme = "furo"
html_show_copyright = False
html_title = f"vinefab {release}"
html_static_path: list[str] = []
html_extra_path: list[str] = []
# Links out of docs/ lead to files of the repository, which the site does not hold.
suppress_warnings = ["myst.xref_missing"]


def setup(app):  # noqa: ANN001, ANN201  as Sphinx asks
    """Write the pages that are made from the code before Sphinx reads them."""
    app.connect("builder-inited", lambda built: write_reference(Path(built.srcdir) / "reference"))

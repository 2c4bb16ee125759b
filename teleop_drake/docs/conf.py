"""The site's configuration for Sphinx, which builds it from the root of a checkout:

    sphinx-build -c teleop_drake/docs -t live -t api -t thesis -t notebooks . site

Each tag includes a part: living diagrams, the Python API, the executable thesis, and
the outputs of the notebooks. `teleop-drake docs --out site` does it from an installed
package, too. The site needs no server and no network.
"""

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.addnodes import download_reference
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger

import teleop_drake
from teleop_drake.cli.commands.docs import PAGES, PARTS

# Sphinx provides the tags.
tags: Any
_PARTS = [part for part in PARTS if tags.has(part)]  # noqa: F821

_LOGGER = getLogger(__name__)

_PACKAGE = Path(teleop_drake.__file__).parent
_ROOT = _PACKAGE.parent
_DOCS = "teleop_drake/docs"

# An installed package has no notebooks, and what stands beside it belongs to others.
_IS_CHECKOUT = (_ROOT / "notebooks/league").is_dir()
_SOURCES = {"teleop_drake"}
if _IS_CHECKOUT:
    _SOURCES |= {"README.md", "CHANGELOG.md", "CONTRIBUTING.md"}
    _SOURCES |= {"diagrams", "notebooks"}

# Files of the site that Sphinx does not write, with their titles.
_LIVE = {
    "live/one_dof": "Tissue, then bone",
    "live/two_dof_combined": "The same with an arm",
    "live/two_dof_collision": "Drive an arm on to bone",
}
_THESIS = {"thesis/report": "The executable thesis"}

project = "teleop-drake"
author = "the authors of teleop-drake"
release = teleop_drake.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = f"{_DOCS}/index"
language = "en"

# A part that the site does not have leaves a list of its contents empty.
suppress_warnings = ["toc.empty_glob"]
include_patterns = [f"{_DOCS}/*.md", "teleop_drake/thesis/errata.md"]
exclude_patterns = [x.name for x in _ROOT.iterdir() if x.name not in _SOURCES]
if _IS_CHECKOUT:
    include_patterns += ["*.md", "diagrams/*.md"]
    include_patterns += ["notebooks/**.md", "notebooks/*.ipynb"]
else:
    suppress_warnings += ["myst.xref_missing"]
if "api" in _PARTS:
    include_patterns += [f"{_DOCS}/api/*.rst"]

# Markdown. A link to a file of the repository that is no page offers the file.
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_links_external_new_tab = False

# A notebook runs again only when its code changes. What it writes is deleted.
nb_execution_mode = "cache" if "notebooks" in _PARTS else "off"
nb_execution_timeout = 600
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_merge_streams = True

# Docstrings.
default_role = "literal"
add_module_names = False
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "pydata_sphinx_theme"
html_title = "teleop-drake"
html_math_renderer = "mathml"
html_sourcelink_suffix = ""
html_static_path = ["static"]
html_css_files = ["site.css"]
templates_path = ["templates"]
html_additional_pages = {"index": "start.html"}
html_sidebars = {"**": ["contents.html"], "index": []}
html_theme_options = {
    "navbar_start": ["home.html"],
    "navbar_center": [],
    "navbar_persistent": ["search-button"],
    "secondary_sidebar_items": ["notebook.html", "page-toc"],
    "footer_start": ["version.html"],
    "footer_end": [],
    "show_prev_next": False,
}
html_context = {
    "live": _LIVE if "live" in _PARTS else {},
    "thesis": _THESIS if "thesis" in _PARTS else {},
    "has_api": "api" in _PARTS,
    "has_notebooks": _IS_CHECKOUT,
}


# The table of contents. The index has a better one for readers, without the groups.
_CONTENTS = """
```{toctree}
:hidden:
:caption: Pages

PAGES
```

```{toctree}
:hidden:
:glob:
:caption: In the repository

/README*
/CONTRIBUTING*
/CHANGELOG*
/diagrams/*
```

```{toctree}
:hidden:
:glob:
:caption: Notebooks

/notebooks/*
/notebooks/league/*
```

```{toctree}
:hidden:
:glob:
:caption: Python API

/teleop_drake/docs/api/index*
```
"""


def _AddContents(_: Sphinx, name: str, source: list[str]) -> None:
    """Adds the table of contents to the index."""
    if name == root_doc:
        pages = [page.relative_to(_ROOT).with_suffix("") for page in PAGES[1:]]
        links = "\n".join(f"/{page.as_posix()}" for page in pages)
        source[0] += _CONTENTS.replace("PAGES", links)


# Code, or a bullet; or characters that only reStructuredText takes for markup.
_MARKUP = re.compile(r"(?m)(`[^`]*`|^ *\*+)|(?<=\w)_(?!\w)|^-$|[|*]")


def _Escaped(text: str) -> str:
    """Returns Markdown as reStructuredText."""
    return _MARKUP.sub(lambda found: found[1] or f"\\{found[0]}", text)


def _AsRst(paragraph: str) -> str:
    """Returns a paragraph, a block of code or a table as reStructuredText."""
    if paragraph.startswith("    "):
        return f"::\n\n{paragraph}"
    if not paragraph.startswith("| "):
        return _Escaped(paragraph)
    table = [".. list-table::", "   :header-rows: 1", ""]
    for row in paragraph.splitlines():
        if row.startswith("|-"):
            continue
        first, *others = (_Escaped(x.strip()) for x in row.strip("|").split("|"))
        table += [f"   * - {first}", *(f"     - {cell}" for cell in others)]
    return "\n".join(table)


def _ReadMarkdown(*arguments: Any) -> None:
    """Rewrites a docstring, whose tables and blocks of code are those of Markdown."""
    lines: list[str] = arguments[-1]
    paragraphs = "\n".join(lines).split("\n\n")
    lines[:] = "\n\n".join(map(_AsRst, paragraphs)).splitlines()


def _WriteMath(writer: Any, node: nodes.Element) -> None:
    """Writes a formula as MathML, which browsers show without a script."""
    display = "block" if isinstance(node, nodes.math_block) else "inline"
    writer.body.append(convert(node.astext(), display=display))
    raise nodes.SkipNode


def _UnlinkTitles(_: Sphinx, document: nodes.document) -> None:
    """Moves links to files out of titles, in which Sphinx allows none."""
    for link in list(document.findall(download_reference)):
        title = link.parent
        if isinstance(title, nodes.title):
            title.replace(link, link.children)
            title.parent.insert(1, nodes.paragraph("", "", link.deepcopy()))


def _WriteParts(app: Sphinx, error: Exception | None) -> None:
    """Writes the living diagrams and the executable thesis."""
    if error is not None:
        return
    out = Path(app.outdir)
    if "live" in _PARTS:
        from teleop_drake.study.page.page import MakePage, WritePage

        (out / "live").mkdir(exist_ok=True)
        for name in _LIVE:
            task = name.partition("/")[2]
            has_hand = task == "two_dof_collision"
            WritePage(task, out / f"{name}.html", has_hand=has_hand)
        start = MakePage("one_dof", signals=["tool_velocity"])
        style = (_PACKAGE / "docs/templates/start.css").read_text(encoding="utf-8")
        start.html = start.html.replace("</style>", f"{style}</style>", 1)
        start.Save(out / "live/start.html")
    if "thesis" in _PARTS:
        from teleop_drake.thesis.report import Reproduce

        (out / "thesis").mkdir(exist_ok=True)
        Reproduce(out / "thesis", formats=["svg"], progress=_LOGGER.info)


def setup(app: Sphinx) -> None:
    """Registers what the site adds to Sphinx."""
    if "notebooks" in _PARTS:
        # They import what is beside them.
        paths = [str(_ROOT / "notebooks"), os.environ.get("PYTHONPATH", "")]
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    app.add_html_math_renderer("mathml", (_WriteMath, None), (_WriteMath, None))
    app.connect("source-read", _AddContents)
    # Before the titles are collected.
    app.connect("doctree-read", _UnlinkTitles, priority=100)
    # Before napoleon, which reads the sections.
    app.connect("autodoc-process-docstring", _ReadMarkdown, priority=400)
    app.connect("build-finished", _WriteParts)

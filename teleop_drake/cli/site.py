"""The documentation as a static site: pages, reference, living diagrams and notebooks.

All links are relative, so that the site works from the disk and under any path.
"""

import html
import os
import pkgutil
import re
import shutil
import warnings
from collections.abc import Callable, Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).parents[1]
_DOCS = _PACKAGE / "docs"
_TEMPLATES = _DOCS / "site"

# The notebooks are in the repository; an installed package has none.
_NOTEBOOKS = _PACKAGE.parent / "notebooks"

_INDEX = _DOCS / "index.md"

# The pages: the index, then the pages in its order. The list of the thesis's misprints
# is in the folder of its claims.
PAGES = [
    _INDEX,
    *(_DOCS / name for name in re.findall(r"\((\w+\.md)\)", _INDEX.read_text("utf-8"))),
    _PACKAGE / "thesis" / "errata.md",
]

# Living diagrams by the names of their files: title, scenario, and whether the user
# drives.
_LIVE = {
    "one_dof": ("Tissue, then bone", "one_dof", False),
    "two_dof_combined": ("The same with an arm", "two_dof_combined", False),
    "drive": ("Drive an arm on to bone", "two_dof_collision", True),
}

PARTS = ("live", "api", "thesis", "notebooks")
"""The optional parts of a site, in addition to its pages."""

_NO_NOTEBOOKS = (
    "notebooks: left out, because an installed package has none; run "
    "`teleop-drake docs --out DIR` in a checkout of the repository"
)

Progress = Callable[[str], None]


def Title(page: Path) -> str:
    """Returns the heading of a page."""
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


class Site:
    """The documentation as a site that needs no server and no network.

    Attributes:
        notes: Sentences on parts that are left out.

    Args:
        out: An existing folder; `index.html` in it is the first page.
        parts: The members of PARTS to include. The notebooks are left out where the
            package is not in its repository.
        progress: Called with a line of text before each part and each notebook.

    Raises:
        ModuleNotFoundError: If pdoc is not installed, or in Write() nbclient for
            notebooks.
    """

    def __init__(self, out: Path, parts: Iterable[str], progress: Progress):
        import jinja2
        import pdoc

        self._pdoc = pdoc
        self._out = out
        self._parts = set(parts)
        self._progress = progress
        self._notebooks: list[Path] = []
        self.notes: list[str] = []
        if "notebooks" in self._parts:
            self._notebooks = sorted(_NOTEBOOKS.glob("[0-9]*.ipynb"))
            if not self._notebooks:
                self.notes.append(_NO_NOTEBOOKS)
        loader = jinja2.FileSystemLoader(_TEMPLATES)
        self._templates = jinja2.Environment(loader=loader)

    def Write(self) -> None:
        """Writes all pages and parts; the slowest parts come last."""
        for file in (_TEMPLATES / "site.css", *_DOCS.glob("*.png")):
            shutil.copy(file, self._out)
        for page in PAGES[1:]:
            body = _Markdown(self.WithLinks(page.read_text("utf-8"), page.parent))
            self._Save(f"{page.stem}.html", Title(page), body)
        start = self._templates.get_template("start.html").render(
            parts=self._parts, has_notebooks=bool(self._notebooks)
        )
        _, _, index = _INDEX.read_text("utf-8").partition("\n")
        contents = _Markdown(self.WithLinks(index, _DOCS))
        self._Save("index.html", "Teleoperation under delay", start + contents)
        writers = {
            "live": self._WriteLive,
            "api": self._WriteReference,
            "thesis": self._WriteThesis,
            "notebooks": self._WriteNotebooks,
        }
        for part, write in writers.items():
            if part == "notebooks" and not self._notebooks:
                continue
            if part in self._parts:
                self._progress(part)
                write()

    def WithLinks(self, text: str, folder: Path, up: str = "") -> str:
        """Returns a text whose links to files are replaced by links to the site.

        A link to a file of the repository that the site does not have becomes plain
        text.

        Args:
            folder: The folder of the file that contains the text.
            up: The relative path from the text's page to the site's top folder, either
                empty or with a final slash.
        """

        def Link(match: re.Match[str]) -> str:
            name, file, anchor = match.groups()
            path = Path(os.path.normpath(folder / file))
            if path in PAGES:
                return f"{name}({up}{path.stem}.html{anchor})"
            is_module = path.is_relative_to(_PACKAGE) and path.suffix in ("", ".py")
            if is_module and "api" in self._parts:
                module = path.relative_to(_PACKAGE.parent).with_suffix("")
                return f"{name}({up}api/{module.as_posix()}.html{anchor})"
            return name[1:-1]

        return re.sub(r"(?<!!)(\[[^]]+\])\(([^):#]+)(#[^)]*|)\)", Link, text)

    def _Save(self, name: str, title: str, body: str) -> None:
        """Writes a page with the side bar, which marks this page as the current one."""
        path = self._out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        text = self._templates.get_template("page.html").render(
            title=title,
            body=body,
            here=name,
            up="../" * name.count("/"),
            groups=self._Groups(),
            version=metadata.version("teleop-drake"),
        )
        path.write_text(text, encoding="utf-8")

    def _Groups(self) -> Mapping[str, Mapping[str, str]]:
        """Returns the groups of the side bar, each a map from files to their titles."""
        groups = {"": {"index.html": "Start"}}
        if "thesis" in self._parts:
            groups[""]["thesis/report.html"] = "The executable thesis"
        if "live" in self._parts:
            groups["Live"] = {f"live/{x}.html": live[0] for x, live in _LIVE.items()}
        groups["Pages"] = {f"{page.stem}.html": Title(page) for page in PAGES[1:]}
        if self._notebooks:
            groups["Notebooks"] = {"notebooks/index.html": "Gallery"} | {
                f"notebooks/{path.stem}.html": _NotebookTitle(path)
                for path in self._notebooks
            }
        if "api" in self._parts:
            groups["Reference"] = {"api/teleop_drake.html": "Python API"}
        return groups

    def _WriteLive(self) -> None:
        from teleop_drake.study.page.page import WritePage

        folder = self._out / "live"
        folder.mkdir(exist_ok=True)
        for name, (_, scenario, has_hand) in _LIVE.items():
            WritePage(scenario, folder / f"{name}.html", has_hand=has_hand)

    def _WriteReference(self) -> None:
        """Writes the reference of every module of the package."""
        self._pdoc.render.configure(
            docformat="google", show_source=False, template_directory=_TEMPLATES
        )
        # pdoc warns about names of the package that are imported on demand. As it does
        # not find modules outside of __all__, all modules are listed here, so that it
        # finds some twice and warns again.
        twice = "The module specification"
        warnings.filterwarnings("ignore", f"Found .* in teleop_drake.__all__|{twice}")
        found = pkgutil.walk_packages([str(_PACKAGE)], "teleop_drake.")
        modules = ["teleop_drake", *(module.name for module in found)]
        self._pdoc.pdoc(*modules, "!.*__main__", output_directory=self._out / "api")

    def _WriteThesis(self) -> None:
        from teleop_drake.thesis.report import Reproduce

        folder = self._out / "thesis"
        folder.mkdir(exist_ok=True)
        Reproduce(folder, formats=["svg"], progress=self._progress)

    def _WriteNotebooks(self) -> None:
        """Runs the notebooks; writes them with their outputs, and a gallery of them."""
        import nbformat
        from nbclient import NotebookClient

        cards = []
        for path in self._notebooks:
            self._progress(path.name)
            notebook = nbformat.read(path, as_version=4)
            where = {"metadata": {"path": str(path.parent)}}
            NotebookClient(notebook, timeout=600, resources=where).execute()
            for cell in notebook.cells:
                if cell.cell_type == "markdown":
                    cell.source = self.WithLinks(cell.source, _NOTEBOOKS, "../")
            body = "\n".join(map(_CellHtml, notebook.cells))
            title = _NotebookTitle(path)
            self._Save(f"notebooks/{path.stem}.html", title, body)
            picture = path.parent / "gallery" / f"{path.stem}.png"
            image = ""
            if picture.exists():
                shutil.copy(picture, self._out / "notebooks")
                image = f'<img src="{picture.name}" alt="">'
            cards.append(f'<a class="card" href="{path.stem}.html">{image}{title}</a>')
        body = f'<h1>Notebooks</h1><div class="cards">{"".join(cards)}</div>'
        self._Save("notebooks/index.html", "Notebooks", body)


def _Markdown(text: str, *extras: str) -> str:
    """Returns Markdown as HTML."""
    import markdown2

    usual = ["fenced-code-blocks", "header-ids", "tables", "cuddled-lists"]
    return str(markdown2.markdown(text, extras=[*usual, *extras]))


def _NotebookTitle(path: Path) -> str:
    """Returns the first heading of a notebook."""
    import nbformat

    first = nbformat.read(path, as_version=4).cells[0].source
    return str(first).splitlines()[0].removeprefix("# ")


def _CellHtml(cell: Any) -> str:
    """Returns a cell of an executed notebook, followed by its outputs, as HTML."""
    if cell.cell_type != "code":
        return _Markdown(cell.source, "latex")  # Formulas become MathML.
    source = _Markdown(f"```python\n{cell.source}\n```")
    return source + "".join(map(_OutputHtml, cell.outputs))


def _OutputHtml(output: Any) -> str:
    """Returns an output as HTML, in the richest format available."""
    data = output.get("data", {})
    rich = data.get("text/html") or data.get("image/svg+xml")
    if rich is None and "image/png" in data:
        rich = f'<img src="data:image/png;base64,{data["image/png"]}" alt="">'
    if rich is None and "text/markdown" in data:
        rich = _Markdown(data["text/markdown"], "latex")
    if rich is None:
        text = output.get("text") or data.get("text/plain", "")
        rich = f"<pre>{html.escape(text)}</pre>"
    return f'<div class="output">{rich}</div>'

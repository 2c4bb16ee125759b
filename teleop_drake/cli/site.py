"""The documentation as HTML: the pages, and the API reference from the docstrings."""

import html
import os
import re
import shutil
import warnings
from pathlib import Path

import teleop_drake

_PACKAGE = Path(teleop_drake.__file__).parent
_DOCS = _PACKAGE / "docs"

# The pages, the index first. The misprints of the thesis stand beside its claims.
PAGES = [
    _DOCS / "index.md",
    *sorted(path for path in _DOCS.glob("*.md") if path.stem != "index"),
    _PACKAGE / "thesis" / "errata.md",
]

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 52rem; margin: 2rem auto; padding: 0 1rem }}
table {{ border-collapse: collapse; display: block; overflow-x: auto }}
td, th {{ border: 1px solid #bbb; padding: 0.2rem 0.6rem; text-align: left }}
pre {{ background: #f4f4f4; padding: 0.6rem; overflow-x: auto }}
img {{ max-width: 100% }}
</style>
</head>
<body>
<nav><a href="index.html">Documentation</a> · <a href="api/index.html">API reference</a></nav>
{body}
</body>
</html>
"""  # noqa: E501


def Title(page: Path) -> str:
    """Returns the heading of a page."""
    return page.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def WriteSite(out: Path) -> None:
    """Writes every page, and the reference of every module of the package.

    Args:
        out: The folder; `index.html` in it is the first page.

    Raises:
        ModuleNotFoundError: If pdoc or markdown2 is not installed.
    """
    import markdown2
    import pdoc

    for page in PAGES:
        body = markdown2.markdown(
            page.read_text(encoding="utf-8"),
            extras=["tables", "fenced-code-blocks", "header-ids", "cuddled-lists"],
        )
        text = _PAGE.format(
            title=html.escape(Title(page)), body=_WithLinksOfSite(body, page, out)
        )
        (out / f"{page.stem}.html").write_text(text, encoding="utf-8")
    pdoc.render.configure(docformat="google", show_source=False, math=True)
    with warnings.catch_warnings():
        # pdoc finds the files of a folder by itself unless its `__all__` hides them,
        # and warns of those that it has found and is told of.
        warnings.filterwarnings("ignore", "The module specification")
        pdoc.pdoc(*_Modules(), output_directory=out / "api")


def _Modules() -> list[str]:
    """Returns the name of every module of the package."""
    names = []
    for path in sorted(_PACKAGE.rglob("*.py")):
        parts = path.relative_to(_PACKAGE.parent).with_suffix("").parts
        if parts[-1] != "__main__":
            names.append(".".join(parts).removesuffix(".__init__"))
    return names


def _WithLinksOfSite(body: str, page: Path, out: Path) -> str:
    """Makes the links of a page those of the site, and copies its pictures.

    A page links to files of the repository, as a reader of the repository wants it. Of
    these the site has the other pages, and a file of the package as its reference. A
    link to anything else becomes plain text.
    """

    def Link(match: re.Match[str]) -> str:
        target, text = match[1], match[2]
        if "://" in target or target.startswith("#"):
            return match[0]
        path, _, anchor = target.partition("#")
        of_site = _PathOnSite(Path(os.path.normpath(page.parent / path)))
        if of_site is None:
            return text
        anchor = anchor and f"#{anchor}"
        return f'<a href="{of_site}{anchor}">{text}</a>'

    def Picture(match: re.Match[str]) -> str:
        source = page.parent / match[1]
        shutil.copy(source, out / source.name)
        return f'src="{source.name}"'

    body = re.sub(r'<a href="([^"]+)">(.*?)</a>', Link, body, flags=re.DOTALL)
    return re.sub(r'src="([^":]+)"', Picture, body)


def _PathOnSite(path: Path) -> str | None:
    """Returns where the site has a file of the repository, or None."""
    if path in PAGES:
        return f"{path.stem}.html"
    if not path.is_relative_to(_PACKAGE) or not path.exists():
        return None
    module = path.relative_to(_PACKAGE.parent).with_suffix("")
    return f"api/{module.as_posix()}.html" if path.suffix in ("", ".py") else None

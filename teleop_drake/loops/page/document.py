"""A page as one HTML file: the parts of the web page, and its data."""

import base64
import gzip
import html
import json
import os
import re
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from teleop_drake.loops.framework.files import WriteText
from teleop_drake.loops.page.script import JoinModules, ReadPart


class Page:
    """A living diagram as one HTML file; a notebook shows it as the result of a cell.

    Attributes:
        html: The content of the file.
        data: The data in the file; see DataOfRuns() of sliders.py.
        notes: Sentences on missing parts of the page, with reasons.
    """

    def __init__(self, title: str, story: str, data: dict[str, Any], notes: list[str]):
        self.html = _Html(title, story, data)
        self.data = data
        self.notes = notes

    def Save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file; it appears complete or not at all."""
        WriteText(Path(path), self.html)

    def _repr_html_(self) -> str:
        """Returns a frame with the page, which needs no kernel."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" width="100%" height="800" '
            'title="Living diagram" style="border: 0"></iframe>'
        )


def _Html(title: str, story: str, data: dict[str, Any]) -> str:
    """Returns the page: its parts, and the data as text that needs no escapes."""
    texts = {
        "title": html.escape(title),
        "story": html.escape(story),
        "version": html.escape(metadata.version("teleop-drake")),
        "style": ReadPart("base.css") + ReadPart("page.css"),
        "script": JoinModules("main.js"),
        "model": PackedData(data),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda m: texts[m[1]], ReadPart("page.html"))


def PackedData(data: Mapping[str, Any]) -> str:
    """Returns data as compressed base64 text, which the page's script unpacks."""
    # Without a time stamp, so that equal data give equal text.
    return base64.b64encode(gzip.compress(_Bytes(data), mtime=0)).decode()


def _Bytes(data: Mapping[str, Any]) -> bytes:
    """Returns data as the size of its JSON (8 bytes), the JSON, and a pool of bytes.

    In the JSON, {"$b": [begin, size]} stands for bytes in the pool, and {"$f": [begin,
    count]} for an array of doubles; begin and size are in bytes. Equal objects are
    stored once. Each part begins at a multiple of 8 bytes.
    """
    places: dict[bytes, int] = {}
    rest = bytearray()

    def Place(part: bytes) -> int:
        if part not in places:
            places[part] = len(rest)
            rest.extend(part + bytes(-len(part) % 8))
        return places[part]

    def Default(value: Any) -> Any:
        if isinstance(value, bytes):
            return {"$b": [Place(value), len(value)]}
        array = np.asarray(value, np.float64)
        return {"$f": [Place(array.tobytes()), array.size]}

    text = json.dumps(data, default=Default, allow_nan=False).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + bytes(rest)

"""The replay page: an episode as a self-contained HTML file.

The parts of the page are in the folder `page`; this module combines them with the picture of the
tree and the data of the episode.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any, Final

from islandgp.bt.export.render import drawing, lay_out
from islandgp.viewer.encode import encode
from islandgp.viewer.recording import Recording

_PARTS: Final = Path(__file__).parent / "page"
_PLACE: Final = re.compile(r"\{\{(\w+)\}\}")
_SCRIPTS: Final = ("data", "scene", "tree", "board", "chart", "timeline", "player")


def page(recording: Recording, *, title: str) -> str:
    """A recorded episode as the text of an HTML page."""
    boxes, width, height = lay_out(recording.tree)
    parts = {
        "title": escape(title),
        "style": part("palette.css") + part("page.css"),
        "tree": f'<svg id="tree" role="img" aria-label="Behaviour tree" data-width="{width:g}"'
        f' data-height="{height:g}">'
        f'<g id="nodes">{drawing(boxes)}</g></svg>',
        "data": script_data(encode(recording, title=title)),
        "script": "\n".join(part(f"{name}.js") for name in _SCRIPTS),
    }
    return filled("page.html", parts)


def script_data(value: Any) -> str:
    """A value as JSON, escaped for a script element."""
    data = json.dumps(value, separators=(",", ":"), allow_nan=False)
    # Only these could end a script element or begin a comment in it.
    return data.replace("</", "<\\/").replace("<!--", "<\\u0021--")


def part(name: str) -> str:
    """The text of a file in the folder `page`."""
    return (_PARTS / name).read_text(encoding="utf-8")


def filled(name: str, parts: Mapping[str, str]) -> str:
    """A template in the folder `page` with its placeholders replaced.

    All are replaced in one pass, so text in a title or in data is never taken for a placeholder.
    """
    page = _PLACE.sub(lambda place: parts[place[1]], part(name))
    return page.encode("utf-8", "replace").decode()  # lone surrogates, as in names of files

"""The replay page: an episode as one HTML file that needs nothing else.

The parts of the page stand in the folder `page`; here they are put together
with the tree's picture and the episode's data.
"""

from __future__ import annotations

import json
import re
from html import escape
from pathlib import Path
from typing import Final

from islandgp.bt.render import drawing, lay_out
from islandgp.viewer.encode import encode
from islandgp.viewer.recording import Recording

_PARTS: Final = Path(__file__).parent / "page"
_PLACE: Final = re.compile(r"\{\{(\w+)\}\}")
_SCRIPTS: Final = ("data", "scene", "tree", "board", "chart", "timeline", "player")


def page(recording: Recording, *, title: str) -> str:
    """A recorded episode as the text of an HTML page."""
    boxes, width, height = lay_out(recording.tree)
    data = json.dumps(encode(recording, title=title), separators=(",", ":"), allow_nan=False)
    parts = {
        "title": escape(title),
        "style": _part("page.css"),
        "tree": f'<svg id="tree" role="img" aria-label="Behaviour tree" data-width="{width:g}"'
        f' data-height="{height:g}">'
        f'<g id="nodes">{drawing(boxes)}</g></svg>',
        # Inside a script element only this could end it, or begin a comment.
        "data": data.replace("</", "<\\/").replace("<!--", "<\\u0021--"),
        "script": "\n".join(_part(f"{name}.js") for name in _SCRIPTS),
    }
    # In one go, so that nothing in a title or in the data is taken for a place to fill.
    whole = _PLACE.sub(lambda place: parts[place[1]], _part("page.html"))
    return whole.encode("utf-8", "replace").decode()  # halves of characters, as in file names


def _part(name: str) -> str:
    return (_PARTS / name).read_text(encoding="utf-8")

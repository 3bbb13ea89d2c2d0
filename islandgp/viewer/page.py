"""The replay page: an episode as a self-contained HTML file.

The parts of the page are in the folder `page`; this module combines them with the picture of the
tree and the data of the episode.
"""

from __future__ import annotations

import json
import re
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.export.render import drawing, label, lay_out
from islandgp.text import in_interval, in_points
from islandgp.viewer.encode import encode
from islandgp.viewer.recording import Recording

_PARTS: Final = Path(__file__).parent / "page"
_SCRIPTS: Final = ("data", "scene", "tree", "board", "chart", "timeline", "player")


def page(recording: Recording, *, title: str) -> str:
    """A recorded episode as the text of an HTML page."""
    boxes, width, height = lay_out(recording.tree)
    return filled(
        "page.html",
        title=title,
        styles=("palette.css", "page.css"),
        width=f"{width:g}",
        height=f"{height:g}",
        drawing=drawing(boxes),
        data=script_data(encode(recording, title=title)),
        scripts=[f"{name}.js" for name in _SCRIPTS],
    )


def _loss(loss: Mapping[str, Any]) -> str:
    """The change of points without a node, with its interval."""
    mean, low, high = (None if loss[k] is None else -loss[k] for k in ("mean", "high", "low"))
    return in_interval(mean or 0.0, low, high)


def script_data(value: Any) -> str:
    """A value as JSON, escaped for a script element."""
    data = json.dumps(value, separators=(",", ":"), allow_nan=False, default=float)  # of NumPy
    # Only these could end a script element or begin a comment in it.
    return data.replace("</", "<\\/").replace("<!--", "<\\u0021--")


def filled(name: str, *, folder: Path = _PARTS, **values: Any) -> str:
    """A template in a folder, filled with values, which are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined
    )
    environment.filters |= {
        "base64": lambda text: b64encode(text.encode()).decode(),
        "file": lambda part: (_PARTS / part).read_text(encoding="utf-8"),
        "label": label,
        "loss": _loss,
        "meaning": lambda node: kind_of(node).meaning,
        "points": in_points,
        "unbroken": lambda text: re.sub(
            r" (±|%|:) ?", lambda m: m[0].replace(" ", "\N{NO-BREAK SPACE}"), str(text)
        ),
    }
    page = environment.get_template(name).render(values)
    return page.encode("utf-8", "replace").decode()  # lone surrogates, as in names of files

"""The best robot on a run's page: its tree, where its points come from, and its replay."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import drawing, lay_out
from islandgp.records.folder import Status
from islandgp.resources import program
from islandgp.viewer.champion import first_episode
from islandgp.viewer.run_view import RunView, path_from_home, world_flags


def champion_section(view: RunView, *, has_replay: bool) -> Iterator[str]:
    """The best robot's tree, where its points come from, and its replay."""
    best = view.champion
    if best is None:
        yield "<p>None yet.</p>"
        return
    boxes, width, height = lay_out(parse(best["tree"]))
    if view.status is Status.FINISHED:
        yield f"<p>Individual {escape(best['id'])}, the best robot of the run.</p>"
    else:
        yield f"<p>Individual {escape(best['id'])}, the fittest of the present stage so far.</p>"
    yield (
        '<div class="picture" tabindex="0" role="region" aria-label="Picture of the tree">'
        f'<svg class="bt" role="img" aria-label="Behaviour tree of {len(boxes)} nodes"'
        f' width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}">'
        f"{drawing(boxes)}</svg></div>"
        f"<details><summary>As text ({best['nodes']} nodes)</summary>"
        f"<pre>{escape(best['tree'])}</pre></details>"
    )
    yield '<div class="tables">'
    yield _table("Points in training", _points(view, best))
    yield _table("Counters", ((name, f"{value:,.4g}") for name, value in best["counters"].items()))
    yield "</div>"
    if has_replay:
        yield (
            '<p><button id="show-replay" type="button">Show its replay</button></p>'
            '<div id="replay-place"></div>'
        )
    place = first_episode(view.folder, best["id"])
    file = shlex.quote(str(path_from_home(view) / "best.bt"))
    flags = f" {flags}" if (flags := world_flags(view)) else ""
    yield _command(
        "A replay as a file" if has_replay else "Its replay",
        f"{shlex.quote(program())} replay {file} --seed {place.seed}"
        f" --stage {place.stage + 1}{flags}",
    )


def _points(view: RunView, best: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    yield from ((name, view.points(value, "+")) for name, value in parts if value)
    yield "fitness", view.points(best["fitness"])


def _table(caption: str, rows: Iterator[tuple[str, str]]) -> str:
    body = "".join(
        f'<tr><th scope="row">{escape(name.replace("_", " "))}</th><td>{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f"<table><caption>{escape(caption)}</caption><tbody>{body}</tbody></table>"


def _command(label: str, text: str) -> str:
    return (
        f'<p class="command"><span>{escape(label)}:</span> <code>{escape(text)}</code>'
        ' <button type="button" class="copy">copy</button></p>'
    )

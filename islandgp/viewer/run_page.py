"""A run's page, `run.html`: result, curves, archive, best robot and lineage in one file.

It is created from the run's folder, at any time. The page of an active run reloads itself every few
seconds.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from html import escape
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import drawing, lay_out
from islandgp.errors import RunError
from islandgp.gp.archive import ArchiveSettings, Elite
from islandgp.records.archive_file import NAME, read_archive
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.folder import RunFolder, Status
from islandgp.resources import program
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import in_words
from islandgp.text import title
from islandgp.viewer.champion import first_episode
from islandgp.viewer.history import RunCurves, read_history, thinned
from islandgp.viewer.lineage_section import lineage_section
from islandgp.viewer.page import filled, part, script_data
from islandgp.viewer.recording import digits
from islandgp.viewer.run_view import RunView, path_from_home, world_flags

NAME_OF_PAGE: Final = "run.html"
RELOAD: Final = 5  # s between two reloads of an active run's page
REPLAY_BYTES: Final = 700_000  # largest replay that is embedded in the page


def run_page(
    folder: RunFolder,
    status: Status,
    curves: RunCurves | None = None,
    *,
    replay: str = "",
    now: int = 0,
) -> str:
    """The page of a run, from the present content of its folder.

    Args:
        folder: of the run; it must have a configuration.
        status: of the run; the page of a RUNNING one reloads itself.
        curves: of the generations in the folder; None: they are read from it.
        replay: a replay page of the best robot; "" for none.
        now: ms since 1970.

    Raises:
        RunError: a file of the folder is damaged.
    """
    history = read_history(folder) if curves is None else curves
    champion, validation = history.fittest, None
    if status is Status.FINISHED:
        best = folder.summary()["champion"]
        champion, validation = {**best["record"], "tree": best["tree"]}, best["validation"]
    values = [] if champion is None else [champion["fitness"], *champion["components"].values()]
    config = folder.configuration()
    view = RunView(folder, status, config, history, champion, validation, digits(values))
    about = folder.about()
    name = folder.path.name if about is None else about.title
    replay = replay if len(replay.encode()) <= REPLAY_BYTES else ""
    data = {
        "status": status.value,
        "updated": now,
        "reload": RELOAD,
        "digits": view.digits,
        "curves": thinned(history),
        "archive": archive_map(view),
    }
    reload = f'<noscript><meta http-equiv="refresh" content="{RELOAD}"></noscript>'
    return filled(
        "run.html",
        {
            "title": escape(name),
            "style": part("palette.css") + part("run.css"),
            "reload": reload if status is Status.RUNNING else "",
            "status": status.value,
            "state": status.value.lower(),
            "result": escape(_result(view)),
            "facts": "".join(_facts(view)),
            "champion": "".join(champion_section(view, has_replay=bool(replay))),
            "lineage": "".join(lineage_section(view)),
            "data": script_data(data),
            "replay": script_data(replay),
            "script": part("run.js"),
        },
    )


def _result(view: RunView) -> str:
    """One or two sentences on the result of the run."""
    done, history = view.history.generations, view.history
    if view.champion is None:
        return "The run has begun; its first generation is not evaluated yet."
    spent = f"{done:,} generation{'s' * (done != 1)} and {history.episodes[-1]:,.0f} episodes"
    if view.status is Status.FINISHED:
        return f"{_best_robot(view)} after {spent}.{_milestones(view)}{_constrained(view)}"
    points = view.points(view.champion["fitness"])
    best = f"the fittest individual of this stage, {view.champion['id']}, has {points} points"
    total = int(view.config["gp"]["generations"])
    if view.status is Status.RUNNING:
        return f"After {done:,} of {total:,} generations, {spent.partition(' and ')[2]}, {best}."
    if view.status is Status.FAILED:
        return f"The run failed after {spent}: {view.folder.reason()} Until then {best}."
    return f"The run was stopped after {spent}; the same command continues it. Until then {best}."


def _best_robot(view: RunView) -> str:
    assert view.champion is not None
    v, name = view.validation, f"The best robot, individual {view.champion['id']},"
    if v is None:
        fitness = view.points(view.champion["fitness"])
        return f"{name} has {fitness} points in training, not validated in other worlds,"
    n = len(v["worlds"])
    between = _interval(view, v, "")
    worlds = f"{n} unseen world{'s' * (n != 1)}"
    text = f"{name} earns {view.points(v['mean'])} points in {worlds}{between}"
    for other in v["comparisons"]:
        gain = view.points(other["mean"], "+") + _interval(view, other, "+")
        text += f", {gain} against the {other['name']},"
    return text


def _interval(view: RunView, estimate: Mapping[str, Any], sign: str) -> str:
    """A 95 % interval in brackets; "" for a single world."""
    if estimate["low"] is None:
        return ""
    ends = (view.points(estimate[end], sign) for end in ("low", "high"))
    return f" (95\N{NO-BREAK SPACE}%: {' to '.join(ends)})"


def _milestones(view: RunView) -> str:
    """The tiers that the best robot reaches in validation worlds."""
    if view.validation is None:
        return ""
    reached = view.validation["reached"]
    shares = [f"{title(tier)} in {share:.0%}" for tier, share in reached.items() if share]
    if not shares:
        return " It reaches no tier in these worlds."
    return f" In these worlds it is {', '.join(shares)}."


def _constrained(view: RunView) -> str:
    """A text on the feasibility of the best robot in these worlds; "" without constraints."""
    if view.validation is None or view.validation.get("feasible") is None:
        return ""
    verdict = "breaks" if view.validation["violation"] else "keeps"
    share = f"{view.validation['feasible']:.0%}"
    return (
        f" On average it {verdict} the constraints, and it keeps them in {share} of these worlds."
    )


def _facts(view: RunView) -> Iterator[str]:
    about, config = view.folder.about(), view.config
    facts = {
        "domain": "" if about is None else about.tags.get("domain", ""),
        "search": str(config.get("search", {}).get("name", "paper")),
        "supervisor": str(config["supervisor"]["name"]),
        "constraints": in_words(view.history.constraints),
        "seed": str(config["seed"]),
        "version": "" if about is None else about.tags.get("code", ""),
        "in generations": _duration(view.history.seconds),
        "command": "" if about is None else about.command,
    }
    for name, value in facts.items():
        if value:
            value_html = f"<code>{escape(value)}</code>" if name == "command" else escape(value)
            yield f"<div><dt>{name}</dt><dd>{value_html}</dd></div>"


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {rest} s"


TREE_BYTES: Final = 500_000  # most bytes of embedded trees of the archive, the best first


def archive_map(view: RunView) -> dict[str, Any] | None:
    """The map of the archive; None before the first generation."""
    if not view.history.generations:
        return None
    settings = ArchiveSettings.model_validate(view.config["archive"])
    axes = settings.axes(Classes.model_validate(view.config["classes"]))
    cells = _elites(view)
    elites = sorted(cells or (), key=lambda e: (-e.stage, -e.mean, e.cell))
    room, entries = TREE_BYTES, []
    for e in elites:
        room -= len(e.tree.encode())
        entries.append({**asdict(e), "stage": e.stage + 1, "tree": e.tree if room >= 0 else None})
    about = view.folder.about()
    return {
        "axes": [{"name": name, "edges": edges} for name, edges in axes.items()],
        "floor": settings.floor,
        "domain": "" if about is None else about.tags.get("domain", ""),
        "command": " ".join([shlex.quote(program()), "replay", "-"]),
        "flags": world_flags(view),
        "file": NAME,
        "readable": cells is not None,
        "elites": entries,
    }


def _elites(view: RunView) -> tuple[Elite, ...] | None:
    """The present archive; None if it cannot be read."""
    path = view.folder.path
    try:
        if view.status is Status.FINISHED:
            return read_archive(path)[0].elites
        for name in ("checkpoint.json", "checkpoint.previous.json"):
            if (path / name).exists():
                return read_checkpoint(path / name)[0].archive
    except RunError:  # the file is missing, damaged, or being written
        return None
    return ()


def embedded_replay(text: str) -> str:
    """The replay that the text of a run's page holds; "" for none."""
    match = re.search(r'<script type="application/json" id="replay">(.*)</script>', text)
    return str(json.loads(match[1])) if match else ""


def champion_section(view: RunView, *, has_replay: bool) -> Iterator[str]:
    """The HTML of the best robot: its tree, points by component, and replay."""
    best = view.champion
    if best is None:
        yield "<p>None yet.</p>"
        return
    boxes, width, height = lay_out(parse(best["tree"]))
    is_best = view.status is Status.FINISHED
    rank = "the best robot of the run" if is_best else "the fittest of the present stage so far"
    yield (
        f"<p>Individual {escape(best['id'])}, {rank}.</p>"
        '<div class="picture" tabindex="0" role="region" aria-label="Picture of the tree">'
        f'<svg class="bt" role="img" aria-label="Behaviour tree of {len(boxes)} nodes"'
        f' width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}">'
        f"{drawing(boxes)}</svg></div>"
        f"<details><summary>As text ({len(boxes)} nodes)</summary>"
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

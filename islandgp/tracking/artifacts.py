"""The artifacts of a run in MLflow, in formats that its UI displays."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import to_svg
from islandgp.records.files import FITNESS_KEYS, RunMetadata, fallback_words, validation_mean
from islandgp.records.folder import RunFolder, Status
from islandgp.text import in_points, title
from islandgp.viewer.champion import champion_replay
from islandgp.viewer.run_page import NAME_OF_PAGE, embedded_replay

FILES: Final = (
    "best.bt",
    "lineage.csv",
    "generations.jsonl",
    "costs.jsonl",
    "summary.json",
    "archive.json",
    "manifest.json",
    "run.html",
    "transcript.jsonl",
)
"""Files of the folder that are sent unchanged. Without error.txt, whose content is in the note:
MLflow cannot delete a file, and a failed run may be resumed."""

TABLE: Final = "generations.json"  # in the form of MLflow's log_table
DECIMALS: Final = {**dict.fromkeys(FITNESS_KEYS, 1), "diversity": 3, "working": 3}
"""Its rounded columns."""


@dataclass(frozen=True, slots=True)
class Artifact:
    """One file in MLflow."""

    name: str
    content: Path | Callable[[], str]  # the path of a file, or a function that returns its text


def artifacts(folder: RunFolder) -> Iterator[Artifact]:
    """The files of a run that has ended, as far as they exist."""
    for name in FILES:
        if (file := folder.path / name).exists():
            yield Artifact(name, file)
    # Without individuals, which take most of the memory of a long run.
    records = [{key: r[key] for key in ("snapshot", "guidance")} for r in folder.records()]
    if records:
        yield Artifact(TABLE, lambda: json.dumps(table(records)))
    if (best := folder.path / "best.bt").exists():
        text = best.read_text(encoding="utf-8")
        yield Artifact("best.bt.txt", lambda: text)  # MLflow shows .txt, not .bt
        yield Artifact("best.svg", lambda: to_svg(parse(text)))
    if folder.finished():
        yield Artifact("replay.html", lambda: replay(folder))


def replay(folder: RunFolder) -> str:
    """The replay page of a finished run's best robot: that of the run's page, or a new one."""
    file = folder.path / NAME_OF_PAGE
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    return embedded_replay(text) or champion_replay(folder)


def table(records: list[dict[str, Any]]) -> dict[str, Any]:
    """The table of the run in MLflow: one row per generation."""
    rows = []
    for record in records:
        s, guidance = record["snapshot"], record["guidance"] or {}
        texts = ("crisis", "source", "phase", "pattern", "target")
        rows.append(
            {
                "generation": s["generation"],
                **{name: round(s[FITNESS_KEYS.get(name, name)], n) for name, n in DECIMALS.items()},
                **s["tiers"],
                **s["specialists"],
                "rate": round(s["rate"], 3),
                **{name: guidance.get(name) or "" for name in texts},
                "injected": guidance.get("injected", False),
            }
        )
    return {"columns": list(rows[0]), "data": [list(row.values()) for row in rows]}


def _points(summary: Mapping[str, Any]) -> str:
    """The best robot's points in validation worlds and in training."""
    trained, mean = summary["champion"]["record"]["fitness"], validation_mean(summary)
    if mean is None:
        return f"{in_points(trained)} points in training, not validated"
    return f"**{in_points(mean)}** points in validation worlds, {in_points(trained)} in training"


def note(folder: RunFolder, about: RunMetadata, status: Status) -> str:
    """The run's description in MLflow, in Markdown."""
    lines = [f"**{about.title}** ({status.value.lower()})", ""]
    if folder.finished():
        s, agent = folder.summary(), folder.agent
        best = s["champion"]["record"]
        fallback = fallback_words([s])
        lines += [
            f"- best robot, of generation {s['champion']['generation']}: {_points(s)}",
            *(
                f"- first {title(tier)} {agent}: {'never' if g is None else f'generation {g}'}"
                for tier, g in s["first"].items()
            ),
            f"- mean diversity {s['mean_diversity']:.3f}",
            *([f"- the fallback's answers: {fallback}"] if fallback else []),
            "",
            "```",
            best["tree"].rstrip(),
            "```",
        ]
    elif error := folder.error():
        lines += ["```", error.strip()[-3000:], "```"]
    lines += ["", f"`{about.command}`", "", f"Records: `{folder.path}`"]
    return "\n".join(lines)

"""The artifacts of a run in MLflow, in formats that its UI displays."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import to_svg
from islandgp.gate import check_folder, read_text
from islandgp.records.files import LONG, PAGE, RunMetadata
from islandgp.records.folder import RunFolder, Status
from islandgp.records.values import fallback_words, validation_mean
from islandgp.text import in_points, title
from islandgp.viewer.run_page import embedded_replay

FILES: Final = (
    "best.bt",
    LONG,
    "lineage.csv",
    "generations.jsonl",
    "costs.jsonl",
    "summary.json",
    "archive.json",
    "manifest.json",
    PAGE,
    "transcript.jsonl",
)
"""Files of the folder that are sent unchanged. Without error.txt, whose content is in the note:
MLflow cannot delete a file, and a failed run may be resumed."""


@dataclass(frozen=True, slots=True)
class Artifact:
    """One file in MLflow."""

    name: str
    content: Path | Callable[[], str]  # the path of a file, or a function that returns its text


def artifacts(folder: RunFolder, *, has_page: bool = True) -> Iterator[Artifact]:
    """The files of a run that has ended, as far as they exist.

    `has_page`: this process has written the page; a page of others, which may hold any script, is
    left out.
    """
    check_folder(folder.path)
    for name in FILES:
        if (file := folder.path / name).exists() and (has_page or name != PAGE):
            yield Artifact(name, file)
    if (best := folder.path / "best.bt").exists():
        text = read_text(best)
        yield Artifact("best.bt.txt", lambda: text)  # MLflow shows .txt, not .bt
        yield Artifact("best.svg", lambda: to_svg(parse(text)))
    page = folder.path / PAGE
    if has_page and page.exists() and (replay := embedded_replay(page.read_text("utf-8"))):
        yield Artifact("replay.html", lambda: replay)


def _points(summary: Mapping[str, Any]) -> str:
    """The best robot's points in validation worlds and in training."""
    trained, mean = summary["champion"]["record"]["fitness"], validation_mean(summary)
    if mean is None:
        return f"{in_points(trained)} points in training, not validated"
    return f"**{in_points(mean)}** points in unseen worlds, {in_points(trained)} in training"


def note(folder: RunFolder, about: RunMetadata, status: Status) -> str:
    """The run's description in MLflow, in Markdown."""
    lines = [f"**{about.title}** ({status.value.lower()})", ""]
    if folder.finished():
        s, agent = folder.summary(), folder.agent
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
            s["champion"]["text"].rstrip(),
            "```",
        ]
    elif error := folder.error():
        lines += ["```", error.strip()[-3000:], "```"]
    lines += ["", f"`{about.command}`", "", f"Records: `{folder.path}`"]
    return "\n".join(lines)

"""The artifacts of a run in MLflow, in formats that its UI displays."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import to_svg
from islandgp.gate import check_folder, read_text
from islandgp.records.files import LONG, PAGE, RunMetadata
from islandgp.records.folder import RunFolder, Status
from islandgp.records.sentences import best_robot_in_a_sentence, constrained, reached

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


def note(folder: RunFolder, about: RunMetadata, status: Status) -> str:
    """The run's description in MLflow, in Markdown."""
    lines = [f"**{about.title}** ({status.value.lower()})", ""]
    if folder.finished():
        summary = folder.summary()
        champion = summary["champion"]
        sentences = [best_robot_in_a_sentence(champion), *reached(champion), *constrained(summary)]
        lines += [*(f"- {line}" for line in sentences), "", "```", champion["text"].rstrip(), "```"]
    elif error := folder.error():
        lines += ["```", error.strip()[-3000:], "```"]
    lines += ["", f"`{about.command}`", "", f"Records: `{folder.path}`"]
    return "\n".join(lines)

"""`islandgp transcript`: the questions to a language model, its answers, and their results."""

from __future__ import annotations

from pathlib import Path

import click

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.message import clean
from islandgp.supervision.llm.transcript import Transcript, describe, find_transcript


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--generation",
    type=click.IntRange(-1),
    help="Show the whole prompts and replies of this generation; -1: of the probe.",
)
def command(run: Path, generation: int | None) -> None:
    """Show the transcript of a language model in the folder RUN.

    In order: each attempt with its tokens, dollars, seconds and answer, and the result of each
    question. RUN can also be a transcript file.
    """
    path = find_transcript(run)
    transcript = Transcript(path, fixed=True)
    texts = list(describe(transcript, generation))
    if not texts:
        raise SupervisionError(
            f"Expected questions to a model in {path} that fit the options, found none;"
            " `islandgp transcript RUN` without options shows all."
        )
    attempts = transcript.attempts
    usd = sum(a.usd or 0 for a in attempts)
    click.echo("\n".join([*map(clean, texts), f"{len(attempts)} attempts, {usd:.4f} dollars"]))

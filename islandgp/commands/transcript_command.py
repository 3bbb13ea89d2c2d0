"""`islandgp transcript`: the questions to a language model, its answers, and their results."""

from __future__ import annotations

import textwrap
from pathlib import Path

import click

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.message import Failure, clean
from islandgp.supervision.llm.transcript import (
    Attempt,
    Conclusion,
    Transcript,
    find_transcript,
    read_lines,
)

MAX_SHOWN = 500  # most characters of an answer without --generation


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
    question. RUN can also be a transcript file. Exit code 2 if lines of the file are damaged; the
    other lines are shown.
    """
    path = find_transcript(run)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SupervisionError(
            f"Expected to read a transcript in {path}, found: {error.strerror}; check the"
            " permissions."
        ) from None
    transcript, faults, texts = Transcript(None), list[str](), list[str]()
    # An incomplete last line is of a run in progress or of a killed one.
    for line in read_lines(content[: content.rfind(b"\n") + 1].splitlines()):
        entry = line.entry
        if line.fault:
            faults.append(f"line {line.number}, {' '.join(clean(line.fault).split())}")
        if entry is not None:
            transcript.add(entry)
        if isinstance(entry, Attempt) and generation in (None, entry.call.generation):
            texts.append(_attempt(entry, whole=generation is not None))
        if isinstance(entry, Conclusion) and generation in (None, entry.generation):
            texts.append(f"  {entry.part}: {entry.source}" + f": {entry.why}" * bool(entry.why))
    for request in transcript.requests()[1]:
        texts.append(f"{request.call}: sent, no answer is recorded")
    if texts:
        spent = [a.usd or 0 for a in transcript.attempts]
        texts.append(f"{len(spent)} attempts, {sum(spent):.4f} dollars")
        click.echo("\n".join(map(clean, texts)))
    if faults:
        raise SupervisionError(
            f"Expected {path} as it was written, found {len(faults)} damaged or changed lines,"
            f" which are not shown (the first: {faults[0]}); restore a copy."
        )
    if not texts:
        raise SupervisionError(
            f"Expected questions to a model in {path} that fit the options, found none;"
            " `islandgp transcript RUN` without options shows all."
        )


def _attempt(a: Attempt, *, whole: bool) -> str:
    """An attempt: model, tokens, dollars, seconds, and its answer; `whole`: with the prompts."""
    usage, usd = a.usage, a.usd
    tokens = f"{usage.read:,} tokens in, {usage.output:,} out" if usage else "unknown tokens"
    dollars = "unknown dollars" if usd is None else f"{usd:.4f} dollars"
    head = (
        f"{a.call}, attempt {a.number}: {a.request.model}, {tokens}, {dollars}, {a.seconds:.1f} s"
    )
    if isinstance(a.answer, Failure):
        answer = f"failed: {a.answer.kind}: {a.answer.message}"
    else:
        answer = a.answer.text if whole else a.answer.text[:MAX_SHOWN]
        answer += "..." * (len(a.answer.text) > len(answer))
        if a.answer.stop_reason != "end_turn":
            answer = f"stop reason: {a.answer.stop_reason or 'unknown'}\n{answer}"
        if whole and a.answer.thinking:
            answer = f"thinking:\n{a.answer.thinking}\n{answer}"
    prompts = (a.request.system, *a.request.turns) if whole else ()
    parts = [clean(part).strip() for part in (*prompts, answer)]
    return head + "".join(f"\n{textwrap.indent(part, '  ')}" for part in parts if part)

"""`islandgp transcript`: the questions to a language model, its answers, and their results."""

from __future__ import annotations

import json
import shutil
import sys
import textwrap
from collections.abc import Collection, Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

import click

from islandgp.errors import SupervisionError
from islandgp.supervision.llm.answers import DecisionAnswer, EditsAnswer, find_object
from islandgp.supervision.llm.message import Failure, Reply, clean
from islandgp.supervision.llm.transcript import (
    Attempt,
    Conclusion,
    Sent,
    Transcript,
    TranscriptLine,
    find_transcript,
    read_lines,
)

FIELDS: Final[Mapping[str, Collection[str]]] = {
    "probe": (),
    "rate": tuple(DecisionAnswer.model_fields),
    "tree": ("target", "rationale"),
    "edits": tuple(EditsAnswer.model_fields),
}
"""Fields of the answers by part, in the order in which the parts are shown."""

MAX_SHOWN: Final = 500  # most characters of an unreadable answer without --generation
STEP: Final = "  "  # indentation by level


class ModelQuestion(NamedTuple):
    """A question with its repair turns."""

    generation: int  # -1: the probe
    part: str


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--generation",
    type=click.IntRange(-1),
    help="Show the whole prompts and replies of this generation; -1: of the probe.",
)
@click.option("--part", type=click.Choice([*FIELDS]), help="Show this part only.")
def command(run: Path, generation: int | None, part: str | None) -> None:
    """Show the transcript of a language model in the folder RUN.

    For each generation and part: the result of the question, then each attempt with its tokens,
    dollars, seconds and answer. RUN can also be a transcript file. Exit code 2 if lines of the
    file are damaged; the other lines are shown.
    """
    path, transcript, wrong = _read(run)
    every = _questions(transcript)
    selected = [q for q in every if generation in (None, q.generation)]
    selected = [q for q in selected if part in (None, q.part)]
    for number, (g, questions) in enumerate(groupby(selected, lambda q: q.generation)):
        blank = "\n" * bool(number)
        _echo(f"{blank}{'Before the first generation' if g < 0 else f'After generation {g}'}", 0)
        for played in transcript.played if part is None else ():
            if played.generation == g:
                _echo(f"{played.episodes} episodes simulated: traces", 1)
        for question in questions:
            _print_question(transcript, question, whole=generation is not None)
    if selected:
        _echo(f"\n{_totals([a for a in transcript.attempts if _question(a) in selected])}", 0)
    if wrong:
        reason = " ".join(clean(wrong[0].fault).split())
        raise SupervisionError(
            f"Expected {path} as it was written, found {len(wrong)} damaged or changed lines, which"
            f" are not shown (the first: line {wrong[0].number}, {reason}); restore a copy."
        )
    if not selected:
        generations = (
            f"generations {every[0].generation} to {every[-1].generation}" if every else "none"
        )
        raise SupervisionError(
            f"Expected questions to a model in {path} that fit the options, found {generations};"
            " `islandgp transcript RUN` without options shows all."
        )


def _read(run: Path) -> tuple[Path, Transcript, list[TranscriptLine]]:
    """A run's transcript file, its readable entries, and its damaged or changed lines.

    An incomplete last line, of a run in progress or a killed one, is dropped.

    Raises:
        SupervisionError: there is no transcript, or it cannot be read.
    """
    try:
        path = find_transcript(run)
        content = path.read_bytes()
    except OSError as error:
        raise SupervisionError(
            f"Expected to read a transcript in {run}, found: {error.strerror}; check the"
            " permissions."
        ) from None
    transcript, wrong = Transcript(None), []
    for line in read_lines(content[: content.rfind(b"\n") + 1].splitlines()):
        if line.fault:
            wrong.append(line)
        elif line.entry is not None:
            transcript.add(line.entry)
    return path, transcript, wrong


def _question(entry: Attempt | Conclusion | Sent) -> ModelQuestion:
    place = entry if isinstance(entry, Conclusion) else entry.call
    return ModelQuestion(place.generation, place.part)


def _questions(transcript: Transcript) -> list[ModelQuestion]:
    """All questions by generation and part."""
    entries: list[Attempt | Conclusion | Sent] = [*transcript.of_kind(Sent), *transcript.attempts]
    order = [*FIELDS]

    def place(question: ModelQuestion) -> tuple[int, int, str]:
        part = question.part
        return question[0], order.index(part) if part in order else len(order), part

    return sorted({_question(entry) for entry in [*entries, *transcript.parts]}, key=place)


def _print_question(transcript: Transcript, question: ModelQuestion, *, whole: bool) -> None:
    """Prints the result of a question, and its attempts and repair turns."""
    end = next((end for end in reversed(transcript.parts) if _question(end) == question), None)
    unknown = "" if question.part == "probe" else ": no result is recorded"
    _echo(question.part + (unknown if end is None else f": {_result(end)}"), 1)
    last_turn = -1  # the last turn whose prompt is shown
    for attempt in [a for a in transcript.attempts if _question(a) == question]:
        turn, prompt = attempt.call.turn, "".join(attempt.request.turns[-1:])
        if whole and last_turn < 0:
            _echo(f"system prompt:\n{textwrap.indent(attempt.request.system, STEP)}", 2)
        if turn > last_turn and (whole or turn):
            title = f"repair {turn}" if turn else "prompt"
            _echo(f"{title}:\n{textwrap.indent(prompt.strip(), STEP)}", 2)
        last_turn = max(last_turn, turn)
        _echo(f"attempt {attempt.number}: {_cost(attempt)}", 2)
        for line in _answer(attempt.answer, FIELDS.get(question.part, ()), whole=whole):
            _echo(line, 3)
        if end and isinstance(attempt.answer, Reply) and 0 <= turn < len(end.rejected):
            _echo(f"rejected: {end.rejected[turn]}", 3)
    for request in transcript.requests()[1]:
        if _question(request) == question:
            _echo(f"attempt {request.number}: sent, no answer is recorded", 2)


def _result(end: Conclusion) -> str:
    """The result of a question: `taken, repaired`, or `fallback` and the reason."""
    source, comma, change = end.source.partition(", ")
    taken = "taken" if source == "llm" else source
    return f"{taken}{comma}{change}" + (f": {end.why}" if end.why else "")


def _cost(attempt: Attempt) -> str:
    """Model, tokens, dollars and seconds of an attempt."""
    usage, usd, waited = attempt.usage, attempt.usd, attempt.waited
    tokens = f"{usage.read:,} tokens in, {usage.output:,} out" if usage else "unknown tokens"
    dollars = "unknown dollars" if usd is None else f"{usd:.4f} dollars"
    after = f" after waiting for {waited:,.1f} s" if waited else ""
    return f"{attempt.request.model}, {tokens}, {dollars}, {attempt.seconds:,.1f} s{after}"


def _totals(attempts: Collection[Attempt]) -> str:
    """The sums over attempts."""
    usages = [attempt.usage for attempt in attempts if attempt.usage is not None]
    count, known = len(attempts), len(usages)
    unknown = f", {count - known} of them with unknown tokens" if known < count else ""
    return (
        f"{count} attempt{'s' * (count != 1)}{unknown}:"
        f" {sum(u.read for u in usages):,} tokens in, {sum(u.output for u in usages):,} out,"
        f" {sum(a.usd or 0 for a in attempts):.4f} dollars,"
        f" {sum(a.seconds for a in attempts):,.1f} s"
    )


def _answer(answer: Reply | Failure, fields: Collection[str], *, whole: bool) -> Iterator[str]:
    """The lines of an answer: its fields in words; its text if it is unreadable, or if `whole`."""
    if isinstance(answer, Failure):
        yield f"failed: {answer.kind}: {answer.message}"
        return
    if answer.stop_reason != "end_turn":
        yield f"stop reason: {answer.stop_reason or 'unknown'}"
    if whole and answer.thinking:
        yield f"thinking:\n{textwrap.indent(answer.thinking, STEP)}"
    values = None if whole else find_object(answer.text, fields)
    if values is None:
        is_cut = not whole and len(answer.text) > MAX_SHOWN
        yield f"{answer.text[:MAX_SHOWN]}..." if is_cut else answer.text
    for name, value in (values or {}).items():
        is_list = isinstance(value, list)
        for number, item in enumerate(value if is_list else [value], 1):
            yield _field(f"{name} {number}" if is_list else name, item)


def _field(name: str, value: Any) -> str:
    """A field of an answer, or an item of a list; an edit in one line."""
    if isinstance(value, dict):
        fields = ", ".join(f"{key} {_json(v)}" for key, v in value.items() if key != "reason")
        return f"{name}: {fields}" + (f"; {_text(value['reason'])}" if "reason" in value else "")
    text = _text(value)
    return f"{name}:\n{textwrap.indent(text, STEP)}" if "\n" in text else f"{name}: {text}"


def _text(value: Any) -> str:
    return value.strip() if isinstance(value, str) else _json(value)


def _json(value: Any) -> str:
    """A value as JSON in one line; a deeply nested one is left out."""
    try:
        line = " ".join(value.split()) if isinstance(value, str) else value
        return json.dumps(line, ensure_ascii=False)
    except RecursionError:
        return "..."


def _width() -> int | None:
    """Characters of a line of the terminal, or None for a file or a pipe."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def _echo(text: str, level: int) -> None:
    """Prints a text without control characters, indented; wrapped on a terminal."""
    width = _width()
    for line in clean(text).split("\n"):
        indented = STEP * level + line.expandtabs().rstrip()
        if width is None or len(indented) <= width:
            click.echo(indented.rstrip())
            continue
        indent = " " * min(len(indented) - len(indented.lstrip()) + 2, width // 2)
        wrap = textwrap.TextWrapper(width, subsequent_indent=indent, break_on_hyphens=False)
        click.echo(wrap.fill(indented))

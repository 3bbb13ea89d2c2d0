"""The `islandgp` command: each subcommand is one file of `islandgp.commands`."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from decimal import Decimal
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Final, NamedTuple

import click

from islandgp.errors import IslandError, in_the_way
from islandgp.gate import cleaned
from islandgp.installed import COMMANDS as ADDED
from islandgp.installed import added, load_command, summary
from islandgp.running.console import as_ctrl_c, checked_stdout, tolerant_stderr


class CommandInfo(NamedTuple):
    """Summary and example of a command, for the list of commands and its help."""

    help: str  # one line
    example: str  # arguments of the example in its help


COMMANDS: Final = {
    "run": CommandInfo("evolve trees: the same as python -m islandgp", "experiment=smoke"),
    "check": CommandInfo("report errors and warnings for tree files", "tree.bt"),
    "fmt": CommandInfo("format tree files", "tree.bt"),
    "show": CommandInfo("draw a tree", "tree.bt"),
    "simplify": CommandInfo("shorten a tree without changing its behaviour", "tree.bt"),
    "prune": CommandInfo("shorten a tree as far as its fitness allows", "tree.bt -o short.bt"),
    "explain": CommandInfo("show what each branch of a tree does and is worth", "tree.bt"),
    "diff": CommandInfo("compare two trees", "tree.bt other.bt"),
    "domain": CommandInfo("show what a domain declares, or check its contract", "island --check"),
    "play": CommandInfo("run a tree in worlds of its domain", "tree.bt --seeds 20"),
    "trace": CommandInfo("run a tree in one world and show the ticks of each node", "tree.bt"),
    "replay": CommandInfo(
        "write an episode as a page to watch in a browser", "tree.bt -o tree.html"
    ),
    "export": CommandInfo(
        "turn a tree into JSON, BehaviorTree.CPP XML or py_trees", "tree.bt -o tree.xml"
    ),
    "grammar": CommandInfo(
        "print the language of a domain for constrained decoding", "--format gbnf -o island.gbnf"
    ),
    "import": CommandInfo("turn JSON or BehaviorTree.CPP XML into a tree", "tree.xml"),
    "watch": CommandInfo(
        "open the page of a run, which is updated during the run", "runs/default/expert-seed0"
    ),
    "best": CommandInfo(
        "select the best tree of a run again and evaluate it in unseen worlds",
        "runs/default/expert-seed0 -o best.bt",
    ),
    "compare": CommandInfo(
        "compare arms of runs: tables, figures, statistics",
        "--arm expert=supervisor=expert --arm baseline=supervisor=baseline",
    ),
    "estimate": CommandInfo(
        "estimate the costs of supervision by a language model", "supervisor=llm"
    ),
    "transcript": CommandInfo(
        "show the questions to a language model and its answers",
        "runs/default/llm-seed0 --generation 3",
    ),
    "verify": CommandInfo("compare runs with the checksums of their records", "runs/default"),
    "delete": CommandInfo("delete a run on disk and in MLflow", "runs/default/expert-seed0"),
    "sync": CommandInfo("send missing records to the tracking server", "runs/default"),
    "new": CommandInfo("make a folder with a robot of your own that runs at once", "my_robot"),
    "examples": CommandInfo("list the example trees, or print one", "all_rounder"),
    "completion": CommandInfo(
        "print the shell code for completion of commands and overrides", "bash"
    ),
    "ui": CommandInfo("start the MLflow UI and print the address of the right page", "--open"),
}
"""Commands by name; the code of `a-b` is `islandgp.commands.a_b_command:command`."""


def of_distributions() -> dict[str, str]:
    """The commands that installed distributions add, with the summary of each."""
    return {e.name: summary(e) for e in added(ADDED) if e.name not in COMMANDS}


def _added_command(name: str) -> click.Command | None:
    """The command of a distribution; one that says what is wrong if it cannot be loaded."""
    try:
        command = load_command(name)
        if command is None or isinstance(command, click.Command):
            return command
        reason = f"{name}: expected a command of Click, found a {type(command).__name__}"
    except IslandError as error:
        reason = str(error)

    def refuse() -> None:
        raise IslandError(reason)

    any_words = {"ignore_unknown_options": True, "allow_extra_args": True}
    return click.Command(
        name, context_settings=any_words, callback=refuse, help=reason, add_help_option=False
    )


MEANT: Final = {
    "run": ("evolve", "train", "optimize", "optimise", "resume", "start", "sweep"),
    "compare": ("plot", "report", "stats", "analyze", "analyse"),
    "best": ("results", "result", "winner", "champion"),
    "play": ("evaluate", "eval", "simulate", "test"),
    "replay": ("view", "visualize", "visualise", "video", "animate"),
    "show": ("draw", "print", "cat"),
    "check": ("lint", "validate"),
    "fmt": ("format",),
    "new": ("init", "create"),
    "export": ("convert", "save"),
    "ui": ("mlflow", "dashboard"),
}
"""Words for which there is a command of another name."""


class Lazy(click.Group):
    """Imports a subcommand when it is used, so `--help` is fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 -- click's signature
        """The names of the commands: those of the table, then those of distributions."""
        return [*COMMANDS, *of_distributions()]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:  # noqa: ARG002
        """Import a subcommand."""
        if name not in COMMANDS:
            return _added_command(name)
        command: click.Command = import_module(
            f"islandgp.commands.{name.replace('-', '_')}_command"
        ).command
        example = f"\b\nExample:\n  islandgp {name} {COMMANDS[name].example}".rstrip()
        if example not in (command.epilog or ""):
            command.epilog = f"{command.epilog or ''}\n\n{example}"
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The subcommand in `args`. Raises click.UsageError with the nearest name."""
        word = args[0]
        if word not in COMMANDS and not word.startswith("-") and word not in of_distributions():
            near = [name for name, words in MEANT.items() if word in words]
            near = near or get_close_matches(word, self.list_commands(ctx), 1, 0.5)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise click.UsageError(f"expected a command, found {word!r}{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the table of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, info.help) for name, info in COMMANDS.items()])
        if others := of_distributions():
            with formatter.section("Commands of other distributions"):
                formatter.write_dl(list(others.items()))


@click.group(
    cls=Lazy, context_settings={"help_option_names": ["-h", "--help"], "show_default": True}
)
@click.version_option(package_name="islandgp")
def islandgp() -> None:
    """Evolve robot Behaviour Trees under a supervisor, and work with trees and runs."""
    context = click.get_current_context()
    if context.invoked_subcommand != "run":  # it does so itself, after its imports
        context.with_resource(as_ctrl_c("SIGTERM", "SIGHUP"))


def main() -> None:
    """The console script: exit code 2 with one message for a user's error, 130 for Ctrl-C."""
    with tolerant_stderr():
        _main()


ERRORS: Final = (
    (r"Missing \w+ '([^']+)'.*", r"expected \1, found none"),
    (r"Got unexpected extra arguments? \((.+)\)", r"expected no more words, found \1"),
    (r"Option '([^']+)' requires an? .*", r"expected a value after \1, found none"),
    (r"Invalid value for (.+?): (.+) is not a valid (\w+).*", r"\1: expected a valid \3, found \2"),
    (r"Invalid value for (.+?): (.+) is not (an? .+)", r"\1: expected \3, found \2"),
    (r"Invalid value for (.+?): (.+) is not in the range (.+)", r"\1: expected \3, found \2"),
    (r"Invalid value for (.+?): (.+) is not one of (.+)", r"\1: expected one of \3, found \2"),
    (
        r"Invalid value for (.+?): File ['\"](.+)['\"] is a directory",
        r"\1: expected a File, found the folder \2",
    ),
    (
        r"Invalid value for (.+?): Directory ['\"](.+)['\"] is a file",
        r"\1: expected a Directory, found the file \2",
    ),
    (
        r"Invalid value for (.+?): (File|Directory|Path) ['\"](.+)['\"] is not (readable|writable)",
        r"\1: expected a \2 that is \4, found \3, which is not",
    ),
    (
        r"Invalid value for (.+?): \w+ '' does not exist",
        r"\1: expected a path, found an empty text",
    ),
    (r"Invalid value for (.+?): File ['\"](.+)['\"] .+", r"\1: there is no file \2"),
    (r"Invalid value for (.+?): Directory ['\"](.+)['\"] .+", r"\1: there is no folder \2"),
    (r"Invalid value for (.+?): Path ['\"](.+)['\"] .+", r"\1: there is no file or folder \2"),
)
"""Patterns of Click's messages, with their replacements. It quotes a path as `repr` does."""


def one_line(error: click.ClickException) -> str:
    """Click's message in one line: expected, found; remedy."""
    text = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "islandgp"
    _, _, command = path.partition(" ")
    remedy = f"`{path} -h` shows what it takes"
    if isinstance(error, click.NoSuchOption):
        near = get_close_matches(error.option_name, error.possibilities or (), 1, 0)
        text = f"expected another option, found {error.option_name}"
        remedy = f"did you mean {near[0]}?" if near else remedy
        if not command and error.option_name.startswith("--"):
            name = error.option_name.lstrip("-")
            remedy = f"settings are written as KEY=VALUE: islandgp run {name}=..."
    text = re.sub(r"[^\s']{300,}", lambda word: f"{word[0][:100]}...", text)
    text = re.sub("(?<= is not in the range ).+", lambda match: range_in_words(match[0]), text)
    for pattern, form in ERRORS:
        if match := re.fullmatch(pattern, text):
            text = match.expand(form)
            break
    line = f"{text[:1].lower()}{text[1:]}{'' if text.endswith('?') else f'; {remedy}'}"
    return f"{command}: {line}" if command else line


def range_in_words(text: str) -> str:
    """A range as Click writes it, such as 1e-06<=x<=86400, in words."""
    words = {"<": "below", "<=": "at most", ">": "above", ">=": "at least"}
    number = r"-?[0-9][0-9.e+-]*"
    if match := re.fullmatch(rf"({number})<=x<=({number})", text):
        return f"a number from {Decimal(match[1]):,f} to {Decimal(match[2]):,f}"
    if match := re.fullmatch(rf"x([<>]=?)({number})", text):
        return f"a number that is {words[match[1]]} {Decimal(match[2]):,f}"
    return text


def import_from_here() -> None:
    """Puts the current folder first on the import path, as `python -m islandgp` does.

    A user's domains and other classes are found there. Worker processes, also those of launchers,
    inherit this path.
    """
    with suppress(FileNotFoundError):  # the folder was deleted; commands report that
        folder = str(Path.cwd())
        if not sys.flags.safe_path and sys.path[0] not in ("", folder):
            sys.path.insert(0, folder)


def _main() -> None:
    import_from_here()
    if "_ISLANDGP_COMPLETE" in os.environ:
        from islandgp.commands import completion_command  # noqa: F401 -- it makes bash's known
    try:
        with checked_stdout():
            sys.exit(islandgp.main(prog_name="islandgp", standalone_mode=False) or 0)
    except IslandError as error:
        print(cleaned(f"islandgp: {error}"), file=sys.stderr)
        sys.exit(2)
    except click.ClickException as error:
        print(f"islandgp: {one_line(error)}", file=sys.stderr)
        sys.exit(2)
    except click.Abort:
        print("islandgp: stopped", file=sys.stderr)
        sys.exit(130)
    except (ImportError, AttributeError):
        if not (reason := in_the_way(Path.cwd())):
            raise
        print(f"islandgp: {reason}", file=sys.stderr)
        sys.exit(2)

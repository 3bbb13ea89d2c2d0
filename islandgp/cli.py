"""The `islandgp` command: the subcommands are in `islandgp.commands`, by what they work on."""

from __future__ import annotations

import sys
from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Final

import click

from islandgp.errors import IslandError
from islandgp.installed import COMMANDS as ADDED
from islandgp.installed import added, load_command, summary
from islandgp.running.console import as_ctrl_c, exit_code

COMMANDS: Final = {
    "run": ("runs", "evolve trees: the same as python -m islandgp", "experiment=smoke"),
    "check": ("check", "report errors and warnings for tree files", "tree.bt"),
    "fmt": ("trees", "format tree files", "tree.bt"),
    "show": ("trees", "draw a tree", "tree.bt"),
    "simplify": ("trees", "shorten a tree without changing its behaviour", "tree.bt"),
    "prune": ("episodes", "shorten a tree as far as its fitness allows", "tree.bt -o short.bt"),
    "explain": ("episodes", "show what each branch of a tree does and is worth", "tree.bt"),
    "diff": ("trees", "compare two trees", "tree.bt other.bt"),
    "domain": ("domain", "show what a domain declares, or check its contract", "island --check"),
    "play": ("episodes", "run a tree in worlds of its domain", "tree.bt --seeds 20"),
    "replay": ("episodes", "write an episode as a page for a browser", "tree.bt -o tree.html"),
    "export": (
        "trees",
        "write a tree as JSON, BehaviorTree.CPP XML or py_trees",
        "tree.bt -o a.xml",
    ),
    "grammar": ("trees", "print a domain's language for constrained decoding", "-o tree.lark"),
    "import": ("trees", "turn JSON or BehaviorTree.CPP XML into a tree", "tree.xml"),
    "watch": ("runs", "open the page of a run, also during the run", "runs/default/a-run"),
    "best": ("comparisons", "test the best tree of a run in unseen worlds", "runs/default/a-run"),
    "compare": ("comparisons", "compare arms: tables, figures, tests", "--arm a=search=racing"),
    "estimate": ("runs", "estimate the costs of supervision by a language model", "supervisor=llm"),
    "transcript": ("runs", "show the questions to a language model", "runs/default/a-run"),
    "verify": ("runs", "compare runs with the checksums of their records", "runs/default"),
    "delete": ("runs", "delete a run on disk and in MLflow", "runs/default/a-run"),
    "sync": ("stores", "send missing records to the tracking server", "runs/default"),
    "new": ("new", "make a folder with a robot of your own that runs at once", "my_robot"),
    "examples": ("trees", "list the example trees, or print one", "all_rounder"),
    "ui": ("stores", "start the MLflow UI and print the address of the right page", "--port 5001"),
}
"""For each command: its module of `islandgp.commands`, where the function of `a` is `a_command`, a
line on it, and the arguments of an example."""


def of_distributions() -> dict[str, str]:
    """The commands that installed distributions add, with the summary of each."""
    return {e.name: summary(e) for e in added(ADDED) if e.name not in COMMANDS}


class Lazy(click.Group):
    """Imports a subcommand when it is used, so `--help` is fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 -- click's signature
        """The names of the commands: those of the table, then those of distributions."""
        return [*COMMANDS, *of_distributions()]

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:  # noqa: ARG002
        """Import a subcommand."""
        if name not in COMMANDS:
            added_command = load_command(name)
            if added_command is None or isinstance(added_command, click.Command):
                return added_command
            kind = type(added_command).__name__
            raise IslandError(f"{name}: expected a command of Click, found a {kind}")
        module, _, example = COMMANDS[name]
        home = import_module(f"islandgp.commands.{module}")
        command: click.Command = getattr(home, f"{name}_command")
        command.epilog = f"\b\nExample:\n  islandgp {name} {example}"
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The subcommand in `args`. Raises click.UsageError with the nearest name."""
        word, names = args[0], self.list_commands(ctx)
        if word not in names and not word.startswith("-"):
            near = get_close_matches(word, names, 1, 0.5)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise click.UsageError(f"expected a command, found {word!r}{hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Write the table of commands without importing them."""
        ours = [(name, line) for name, (_, line, _) in COMMANDS.items()]
        with formatter.section("Commands"):
            formatter.write_dl([*ours, *of_distributions().items()])


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
    import_from_here()
    sys.exit(exit_code(_main))


def _main() -> int:
    try:
        words = sys.argv[1:] or ["--help"]
        return islandgp.main(words, prog_name="islandgp", standalone_mode=False) or 0
    except click.ClickException as error:
        raise IslandError(one_line(error)) from None
    except click.Abort:
        raise KeyboardInterrupt from None


def one_line(error: click.ClickException) -> str:
    """Click's message in one line, with the command that shows what is right."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "islandgp"
    text = " ".join(error.format_message().split()).rstrip(".")
    if path == "islandgp" and isinstance(error, click.NoSuchOption):
        text += f"; settings are written as islandgp run {error.option_name.lstrip('-')}=VALUE"
    name = path.partition(" ")[2].replace(" ", ": ")
    line = f"{name}{': ' * bool(name)}{text[:1].lower()}{text[1:400]}"
    return f"{line}; `{path} -h` shows what it takes"


def import_from_here() -> None:
    """Puts the current folder first on the import path, as `python -m islandgp` does.

    A user's domains and other classes are found there. Worker processes, also those of launchers,
    inherit this path.
    """
    with suppress(FileNotFoundError):  # the folder was deleted; commands report that
        folder = str(Path.cwd())
        if not sys.flags.safe_path and sys.path[0] not in ("", folder):
            sys.path.insert(0, folder)

"""`islandgp completion`: prints the shell code for completion of commands and overrides."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import click
from click.shell_completion import BashComplete, CompletionItem, add_completion_class

LINES: Final = {
    "bash": ("~/.bashrc", 'eval "$(_ISLANDGP_COMPLETE=bash_source islandgp)"'),
    "zsh": (
        "~/.zshrc",
        "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }; "
        'eval "$(_ISLANDGP_COMPLETE=zsh_source islandgp)"',
    ),
    "fish": (
        "~/.config/fish/completions/islandgp.fish",
        "_ISLANDGP_COMPLETE=fish_source islandgp | source",
    ),
}
"""The startup file of each shell, and the line for it."""


class Bash(BashComplete):
    """Click's completion, without a space after words that end in `.`, `=` or `/`."""

    source_template = BashComplete.source_template.replace(
        "    return 0\n",
        "    [[ ${#COMPREPLY[@]} -gt 0 && ${COMPREPLY[0]} == *[./=] ]] && compopt -o nospace"
        " 2>/dev/null\n    return 0\n",
    )


add_completion_class(Bash)


@click.command()
@click.argument("shell", required=False, type=click.Choice(list(LINES)))
def command(shell: str | None) -> None:
    """Print the code for completion of commands and overrides in SHELL.

    The default is the shell in $SHELL. Run the printed line once, or add it to the shell's
    startup file.
    """
    name = shell or Path(os.environ.get("SHELL", "bash")).name
    if name not in LINES:
        raise click.UsageError(f"expected a shell of {', '.join(LINES)}, found {name}")
    file, line = LINES[name]
    click.echo(line)
    click.echo(f"islandgp: put this line into {file}, or give it now", err=True)


def overrides(arguments: Sequence[str], incomplete: str) -> list[CompletionItem]:
    """Completions of an override, after the `words` before it; [] if Hydra has none.

    Bash splits `key=value` into three words; then only the value is completed.
    """
    before = [*arguments]
    prefix = ""
    if not incomplete and before and "=" not in before[-1] and not before[-1].startswith("-"):
        prefix = f"{before.pop()}="  # click removes the =
    elif len(before) > 1 and before[-1] == "=":
        prefix = f"{before[-2]}="
        before = before[:-2]
    completions = _query(_joined(before), prefix + incomplete)
    return [CompletionItem(word.removeprefix(prefix)) for word in completions]


def _joined(arguments: Sequence[str]) -> list[str]:
    """The words, with those joined again that bash has split at `=`."""
    joined_words: list[str] = []
    for word in arguments:
        if joined_words and (word == "=" or joined_words[-1].endswith("=")):
            joined_words[-1] += word
        else:
            joined_words.append(word)
    return joined_words


def _query(arguments: Sequence[str], word: str) -> list[str]:
    from hydra._internal.core_plugins.bash_completion import BashCompletion
    from hydra._internal.utils import get_args_parser
    from hydra.core.global_hydra import GlobalHydra

    from islandgp.config.errors import USER_ERRORS
    from islandgp.config.sources import ConfigSource
    from islandgp.errors import ConfigError

    try:
        args, _ = get_args_parser().parse_known_args(arguments)
        source = ConfigSource.of(args)
        GlobalHydra.instance().clear()
        plugin = BashCompletion(source.loader())
        return plugin._query(config_name=source.name, line=" ".join([*arguments, word]))
    except (*USER_ERRORS, ConfigError, SystemExit):  # of incomplete words
        return []

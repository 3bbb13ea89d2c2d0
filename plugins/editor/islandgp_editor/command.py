"""`islandgp language-server`: the Language Server Protocol over standard input and output."""

from __future__ import annotations

import logging
import sys
from functools import partial

import click

from islandgp.commands.options import DomainOptions, with_vocabulary_options
from islandgp.commands.setting import configured_domains, vocabulary_of
from islandgp.errors import ConfigError


@click.command(epilog="\b\nExample:\n  islandgp language-server")
@with_vocabulary_options
def command(options: DomainOptions) -> None:
    """Serve an editor over standard input and output (Language Server Protocol).

    It supports diagnostics, quick fixes, completion, hover, formatting, definitions, references and
    renaming, for the domain that a file names.
    """
    if sys.stdin is None or sys.stdout is None:
        raise ConfigError(
            "Expected an editor at the standard input and output, found them closed; let the editor"
            " start this command"
        )

    from islandgp_editor.server import Server

    vocabulary_for = partial(vocabulary_of, options=options, in_world=True)
    server = Server(vocabulary_for, configured_domains(options.config_dir))
    stream = sys.stdout.buffer
    sys.stdout = sys.stderr  # output of a domain's code must not mix with the protocol
    # The editor shows errors of a request; pygls would log them with a traceback.
    logging.getLogger("pygls").setLevel(logging.CRITICAL)
    server.start_io(stdout=stream)

"""`islandgp compile`: compiles the modules in which episodes spend their time."""

from __future__ import annotations

from importlib import import_module
from time import perf_counter

import click

from islandgp import extension_modules
from islandgp.extension_build import build_extensions


@click.command()
def command() -> None:
    """Compile the modules in which episodes spend their time, for faster runs.

    It needs mypy (pip install 'islandgp[fast]'), a C compiler and Python's headers, and takes about
    half a minute. Records stay equal to the last bit. Later commands use the compiled modules until
    islandgp is changed; with ISLANDGP_EXTENSIONS=0 in the environment they do not.
    """
    # Those that this machine cannot import, as of one with a later C library, are compiled again.
    usable = not extension_modules.is_enabled() or _can_import(extension_modules.LIBRARY)
    if usable and (folder := extension_modules.compiled_folder()):
        click.echo(f"The modules are already compiled, in {folder}.")
        return
    click.echo("Compiling takes about half a minute.", err=True)
    start = perf_counter()
    folder = build_extensions()
    count = len(extension_modules.module_files())
    click.echo(f"Compiled {count} modules in {perf_counter() - start:.0f} s, in {folder}.")


def _can_import(module: str) -> bool:
    try:
        import_module(module)
    except ImportError:
        return False
    return True

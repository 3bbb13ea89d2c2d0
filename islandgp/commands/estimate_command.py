"""`islandgp estimate`: estimates the costs of supervision by a language model before a run."""

from __future__ import annotations

from pathlib import Path

import click

from islandgp.supervision.llm.estimate import costs


@click.command(
    context_settings={"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
)
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED)
def command(overrides: tuple[str, ...]) -> None:
    """Estimate the costs of a command's runs, e.g. supervisor=llm 'seed=range(5)' -m.

    Nothing is sent and no key is needed. A sweep prints the same before its first run.
    """
    from islandgp.config.compose import planned
    from islandgp.running.app import parsed_argv
    from islandgp.running.parts import supervised_runs

    args, argv = parsed_argv(overrides)
    settings = [job.settings for job in planned(args, argv, Path.cwd())]
    jobs = supervised_runs(settings)
    free = len(settings) - sum(job.number for job in jobs)
    if not jobs:
        click.echo(f"Nothing: none of the {free} runs asks a language model.")
        return
    click.echo(costs(jobs))
    if free:
        click.echo(f"{free} other runs ask no language model.")

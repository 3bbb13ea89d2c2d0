"""`python -m islandgp`, and the console script `islandgp`."""

import sys

from islandgp.startup import Imports, leave, stop_before_work


def script() -> None:
    """The console script: reads the command's words from sys.argv, and exits."""
    stop_before_work("SIGTERM", "SIGHUP")
    with Imports():
        from islandgp.cli import main
    try:
        main()
    except SystemExit as end:
        leave(end.code)


def start_workers() -> None:
    """Starts the server of workers before the imports, which it does at the same time.

    `main` tries it again, and reports errors.
    """
    from contextlib import suppress

    with suppress(Exception):
        from islandgp.evaluation.forkserver import start_for_command

        start_for_command(sys.argv[1:])


if __name__ == "__main__":
    stop_before_work("SIGTERM", "SIGHUP")
    try:
        with Imports():
            start_workers()
            from islandgp.running.app import main
    except (ImportError, AttributeError):
        from pathlib import Path

        from islandgp.errors import in_the_way

        if not (reason := in_the_way(Path.cwd())):
            raise
        print(f"islandgp: {reason}", file=sys.stderr)
        sys.exit(2)
    leave(main())

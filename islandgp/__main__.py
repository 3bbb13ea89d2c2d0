"""`python -m islandgp`, and the console script `islandgp`."""

import sys

from islandgp.startup import leave, prepare


def script() -> None:
    """The console script: reads the command's words from sys.argv, and exits."""
    prepare()
    from islandgp.cli import main

    try:
        main()
    except SystemExit as end:
        leave(end.code)


if __name__ == "__main__":
    prepare()
    try:
        from islandgp.running.app import main
    except (ImportError, AttributeError):
        from pathlib import Path

        from islandgp.errors import in_the_way

        if not (reason := in_the_way(Path.cwd())):
            raise
        print(f"islandgp: {reason}", file=sys.stderr)
        sys.exit(2)
    leave(main())

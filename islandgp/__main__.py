"""`python -m islandgp`."""

import sys

if __name__ == "__main__":
    try:
        from islandgp.running.stopping import stop_before_work

        stop_before_work("SIGTERM", "SIGHUP")

        from islandgp.running.app import main
    except (ImportError, AttributeError):
        from pathlib import Path

        from islandgp.errors import in_the_way

        if not (why := in_the_way(Path.cwd())):
            raise
        print(f"islandgp: {why}", file=sys.stderr)
        sys.exit(2)
    sys.exit(main())

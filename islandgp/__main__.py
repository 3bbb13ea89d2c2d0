"""`python -m islandgp`."""

import sys
from pathlib import Path

from islandgp.errors import in_the_way

if __name__ == "__main__":
    try:
        from islandgp.running.stopping import nothing_begun

        with nothing_begun():
            from islandgp.running.app import main
    except (ImportError, AttributeError):
        if not (why := in_the_way(Path.cwd())):
            raise
        print(f"islandgp: {why}", file=sys.stderr)
        sys.exit(2)
    sys.exit(main())

"""Start of the sync process: `python -m islandgp.tracking NICENESS`.

The process gets its priority before it imports anything that takes time.
"""

import os
import sys


def main() -> None:
    """Set the niceness, a number from 0 to 19, and start to read requests."""
    if hasattr(os, "nice"):  # not on Windows
        os.nice(int(sys.argv[1]))
    from islandgp.tracking.follow import serve

    serve()


if __name__ == "__main__":
    main()

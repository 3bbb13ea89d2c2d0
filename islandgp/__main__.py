"""`python -m islandgp`."""

import sys

from islandgp.running.stopping import nothing_begun

if __name__ == "__main__":
    with nothing_begun():
        from islandgp.running.app import main
    sys.exit(main())

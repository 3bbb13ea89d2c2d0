"""`python -m islandgp`."""

import sys

from islandgp.stopping import nothing_begun

if __name__ == "__main__":
    with nothing_begun():
        from islandgp.app import main
    sys.exit(main())

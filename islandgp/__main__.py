"""`python -m islandgp`."""

import sys

from islandgp.app import main

if __name__ == "__main__":
    sys.exit(main())

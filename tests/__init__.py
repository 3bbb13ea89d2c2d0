"""The tests of islandgp. They run its sources, and compare compiled modules with them."""

import os

os.environ.setdefault("ISLANDGP_EXTENSIONS", "0")  # before the package is imported

"""``python -m wormopt``."""

import sys

from wormopt.cli import main

if __name__ == "__main__":
    sys.exit(main())

"""``python -m yarnscale``."""

import sys

from yarnscale.cli import main

if __name__ == "__main__":
    sys.exit(main())

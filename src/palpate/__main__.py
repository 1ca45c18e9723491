"""`python -m palpate`, the same as `palpate`."""

import sys

from palpate.cli.main import main

if __name__ == "__main__":
    sys.exit(main())

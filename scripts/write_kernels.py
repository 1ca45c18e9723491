"""Write the compiled code of the model of pushing, `src/palpate/models/generated.py`: `make kernels`.

python scripts/write_kernels.py [--check]    # exit 1 if the file is out of date, in place of writing it
"""

import argparse
import sys
from pathlib import Path

from palpate.errors import PalpateError
from palpate.estimation.generate import generate
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.settings import SETTINGS

FILE = Path(__file__).parents[1] / "src/palpate/models/generated.py"
SOURCE = "palpate.models.pushing"


def main() -> int:
    """Write the file, or check it."""
    parser = argparse.ArgumentParser(description="Write src/palpate/models/generated.py from palpate.models.pushing.")
    parser.add_argument("--check", action="store_true", help="exit 1 if the file is out of date")
    is_check = parser.parse_args().check
    try:
        text = generate(MODEL, SETTINGS, SOURCE)
    except PalpateError as error:
        print(f"write_kernels: {error}", file=sys.stderr)
        return 2
    if FILE.exists() and FILE.read_text(encoding="utf-8") == text:
        return 0
    if is_check:
        print(f"{FILE.name} is out of date: {SOURCE} has changed; run make kernels", file=sys.stderr)
        return 1
    FILE.write_text(text, encoding="utf-8")
    print(f"written: {FILE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

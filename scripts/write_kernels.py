"""Write the compiled code of the models of pushing, `src/palpate/models/generated*.py`: `make kernels`.

python scripts/write_kernels.py [--check]    # exit 1 if a file is out of date, in place of writing it
"""

import argparse
import sys
from pathlib import Path

from palpate.errors import PalpateError
from palpate.estimation.generate import generate
from palpate.estimation.model import Model
from palpate.models.pushing.hand import hand_model
from palpate.models.pushing.model import MODEL
from palpate.models.pushing.settings import SETTINGS

FOLDER = Path(__file__).parents[1] / "src/palpate/models"
SOURCE = "palpate.models.pushing"
MODELS = {
    "generated.py": MODEL,
    "generated_two_fingers.py": hand_model(2),
    "generated_three_fingers.py": hand_model(3),
}


def main() -> int:
    """Write the files, or check them."""
    parser = argparse.ArgumentParser(description="Write src/palpate/models/generated*.py from palpate.models.pushing.")
    parser.add_argument("--check", action="store_true", help="exit 1 if a file is out of date")
    is_check = parser.parse_args().check
    return max(_write(FOLDER / name, model, is_check) for name, model in MODELS.items())


def _write(file: Path, model: Model, is_check: bool) -> int:
    """Write the code of a model to a file, or check that it is there; return the status to exit with."""
    try:
        text = generate(model, SETTINGS, SOURCE)
    except PalpateError as error:
        print(f"write_kernels: {error}", file=sys.stderr)
        return 2
    if file.exists() and file.read_text(encoding="utf-8") == text:
        return 0
    if is_check:
        print(f"{file.name} is out of date: {SOURCE} has changed; run make kernels", file=sys.stderr)
        return 1
    file.write_text(text, encoding="utf-8")
    print(f"written: {file}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

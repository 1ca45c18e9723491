"""Make the pages of the reported studies from their `results.json` and `sequences.csv`: `make study-report`.

A page has all tables, and the figures of final errors; those that show each frame need the trials, which
`palpate evaluate` leaves where a study is repeated (docs/study.md says how).
"""

from pathlib import Path

from palpate.lab.study.report import write_report
from palpate.lab.study.reported import read_reported

ROOT = Path(__file__).parents[1]
STUDIES = ROOT / "docs/study"
PAGES = ROOT / "docs/_build/study"


def main() -> None:
    """Write a page for each reported study."""
    for folder in sorted(path.parent for path in STUDIES.glob("*/results.json")):
        out = PAGES / folder.name
        out.mkdir(parents=True, exist_ok=True)
        results, trials = read_reported(folder)
        write_report(out, results, trials)
        print(out / "report.html")


if __name__ == "__main__":
    main()

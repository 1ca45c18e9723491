"""`python -m palpate`, the same as `palpate`."""

import sys


def main() -> int:
    """Run the command line of the process, and return its exit code; Ctrl-C ends it in one line from the start on."""
    try:
        from palpate.cli.main import main as run

        return run()
    except KeyboardInterrupt:  # while modules are loaded
        sys.stderr.write("palpate: stopped\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())

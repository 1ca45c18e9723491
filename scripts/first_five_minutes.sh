#!/bin/sh
# Does what the README says up to the first picture of one's own data, in an empty environment from the built wheel, and
# prints how long each step took.
#
#   scripts/first_five_minutes.sh           # installs everything anew from the package index
#   scripts/first_five_minutes.sh --fast    # takes what palpate needs from the environment of $PYTHON; a short simulation
#
# PYTHON is the interpreter that makes the environment, python3 unless set.
set -eu
repository=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 MPLBACKEND=Agg
begin=$(date +%s)

"$python" -m venv "$work/environment"
new=$work/environment/bin/python
short=
if [ "${1:-}" = --fast ]; then
    short=--short
    "$python" -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$work" "$repository"
    "$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))' \
        >"$("$new" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/of_the_other.pth"
    "$new" -m pip install --quiet --no-deps --no-index --ignore-installed "$work"/palpate-*.whl
else
    "$python" -m pip wheel --quiet --no-deps --wheel-dir "$work" "$repository"
    "$new" -m pip install --quiet --constraint "$repository/constraints.txt" "$(echo "$work"/palpate-*.whl)[sim]"
fi
echo "installed the wheel: $(($(date +%s) - begin)) s"

mkdir "$work/here"
cd "$work/here"
PATH=$work/environment/bin:$PATH "$new" "$repository/scripts/readme_steps.py" "$repository/README.md" $short
echo "first five minutes: $(($(date +%s) - begin)) s"

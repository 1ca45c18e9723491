# Everything sets itself up in .venv from the package index: `make demo`, `make test`, `make lint`, `make bench`.
PYTHON ?= python3
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable
# The report of a study is tested in a browser. Where it cannot be had (no Debian, no root), the test skips and says so.
BROWSER := command -v chromedriver >/dev/null || (apt-get -qq update && \
	DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends chromium chromium-driver) \
	>/dev/null 2>&1 || echo 'no Chromium: the report is not tested in a browser'
# Stamps: palpate with its simulation, which the demo needs, and the tools of development on top.
READY := .venv/.ready
READY_DEV := .venv/.ready-dev

.PHONY: demo test lint bench kills test-matrix clean

demo: $(READY)
	$(BIN)/palpate demo

test: lint
	$(BIN)/pytest -n 2

lint: $(READY_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

bench: $(READY_DEV)
	$(BIN)/python benchmarks/step.py --gate

kills: $(READY_DEV)
	$(BIN)/python scripts/kill_commands.py

test-matrix: $(READY_DEV)
	$(BIN)/python -m pip install --quiet uv
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python scripts/test_matrix.py

clean:
	rm -rf .venv demo-run

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "palpate needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(INSTALL) '.[sim]'
	touch $(READY)

$(READY_DEV): $(READY)
	$(INSTALL) '.[dev]'
	@$(BROWSER)
	touch $(READY_DEV)

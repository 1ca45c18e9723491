# Everything sets itself up in .venv from the package index: `make demo`, `make test`, `make lint`, `make kernels`,
# `make wheel`, `make bench`, `make docs`, `make check-numbers`, `make dist`.
PYTHON ?= python3
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
# The page of a run is tested in a browser. Where it cannot be had (no Debian, no root), the test skips and says so.
BROWSER := command -v chromedriver >/dev/null || (apt-get -qq update && \
	DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends chromium chromium-driver) \
	>/dev/null 2>&1 || echo 'no Chromium: the page of a run is not tested in a browser'
# Stamps: palpate and the laboratory with its simulation, which the demo needs, and the tools of development on top.
READY := .venv/.ready
READY_DEV := .venv/.ready-dev
READY_ROS := .venv-ros/.ready

.PHONY: demo test ros-test lint kernels wheel bench docs check-numbers dist clean

demo: $(READY)
	$(BIN)/palpate demo

# Two workers fill two cores: more threads would only wait for one another. The tests of a file share its recordings.
test: lint
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile

# With a real rclpy from the package index, for tests only; `make test` uses it too once it is there, for fewer images.
ros-test: $(READY_DEV) $(READY_ROS)
	PALPATE_ROS_FRAMES=1800 $(BIN)/pytest -n 0 tests/ros2

lint: $(READY_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/python scripts/check_plainness.py
	$(BIN)/python scripts/write_kernels.py --check

# With machine code for this kind of machine, so that its users need no compiler and wait for none.
wheel: $(READY_DEV)
	HATCH_BUILD_HOOKS_ENABLE=1 $(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# After a change of a factor or variable: the derivatives of src/palpate/models/pushing, as compiled code.
kernels: $(READY_DEV)
	$(BIN)/python scripts/write_kernels.py

bench: $(READY_DEV)
	$(BIN)/python benchmarks/step.py --gate

docs: $(READY_DEV)
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet docs docs/_build/html
	@echo 'the pages: docs/_build/html/index.html'

# Compare every table of README and docs with its file in docs/study.
check-numbers: $(READY_DEV)
	$(BIN)/python scripts/reported_numbers.py

# Wheel and sdist of palpate and of the laboratory, in dist, installed and run in an empty environment: ready to upload
# (twine upload dist/*.whl dist/*.tar.gz), with the release notes. Each wheel is built from its sdist.
dist:
	rm -rf dist .venv-dist
	$(PYTHON) -m venv .venv-dist
	.venv-dist/bin/python -m pip install --quiet --disable-pip-version-check build
	.venv-dist/bin/python -m build --outdir dist .
	.venv-dist/bin/python -m build --outdir dist lab
	.venv-dist/bin/python scripts/check_dist.py dist

clean:
	rm -rf .venv .venv-ros .venv-dist dist demo-run docs/_build

$(READY): pyproject.toml lab/pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "palpate needs Python 3.11 or newer")'
	$(PYTHON) -m venv .venv
	$(INSTALL) --editable '.[sim]' --editable lab
	touch $(READY)

$(READY_DEV): $(READY)
	$(INSTALL) --editable '.[dev]' --editable lab
	@$(BROWSER)
	touch $(READY_DEV)

$(READY_ROS): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv-ros
	.venv-ros/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable . \
		'ros-rclpy[fastrtps]' ros-sensor-msgs ros-geometry-msgs ros-diagnostic-msgs ros-std-msgs
	touch $(READY_ROS)

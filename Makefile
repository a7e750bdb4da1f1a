# make demo | test | lint | acceptance | study | bench | clean. Needs Python 3.11 or newer with pip, nothing else.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
INSTALLED_DEV := $(VENV)/installed-dev

.PHONY: help demo test lint acceptance study bench clean

help:
	@echo "make demo        fit the datasets into demo-output/"
	@echo "make test        style, types, tests and notebooks"
	@echo "make lint        style and types only"
	@echo "make acceptance  every headline figure again, beside docs/acceptance.md"
	@echo "make study       efficiency, coverage and designs by repetition, written to docs/"
	@echo "make bench       this project against other tools, written to docs/benchmark.md"
	@echo "make clean       remove everything that make has made"
	@echo "Another Python: make PYTHON=/path/to/python3.12 test"

demo: $(INSTALLED)
	rm -rf demo-output
	$(BIN)/fluidact-fit demo demo-output

test: lint
	$(BIN)/python -m pytest -n 2 tests
	$(BIN)/python -m pytest --nbmake notebooks

lint: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Some ten minutes on two cores; ACCEPTANCE='--only readme' runs a part, ACCEPTANCE=--write writes
# the table anew.
acceptance: $(INSTALLED)
	$(BIN)/python -m studies.acceptance $(ACCEPTANCE)

# Takes an hour or two on two cores; make study STUDY='--scale 0.1' is a taste of it.
study: $(INSTALLED)
	$(BIN)/python studies/statistics_study.py $(STUDY)
	$(BIN)/python studies/ball_screw.py
	$(BIN)/python studies/design.py --output docs/design-study.md
	$(BIN)/python studies/friction_coverage.py --output docs/friction-coverage.md
	$(BIN)/python studies/hydraulic_cylinder.py coverage

# Other tools come from PyPI into environments of their own; MATLAB and Octave do not.
bench: $(INSTALLED)
	$(BIN)/python bench/environments.py
	$(BIN)/python bench/run.py $(BENCH)
	$(BIN)/python bench/speed.py
	$(BIN)/python bench/report.py

clean:
	rm -rf $(VENV) demo-output build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The environment is made anew when pyproject.toml changes, and only then.
$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is missing or older than Python 3.11."; \
		echo "Name another one: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; \
		exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(INSTALLED_DEV): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

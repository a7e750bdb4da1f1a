# make demo | test | lint | docs | ... (make help lists all). Needs Python 3.11 or newer with pip.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed
INSTALLED_DEV := $(VENV)/installed-dev
OLDEST := .venv-oldest
COG := $(BIN)/cog -P -I tools -p 'import docs_tables as docs' --verbosity 1
PAGES := README.md docs/*.md docs/*/*.md sysid/fluidact_fit/family_fits.py

# Where it is set, every process of the tests would compile the program anew.
unexport PYTHONDONTWRITEBYTECODE

MATRIX ?= 3.11 3.12 3.13

.PHONY: help demo check test suite test-slow slow-list test-oldest test-matrix lint style types format docs picture site schema lock house acceptance study bench red-team soak clean

help:
	@echo "make demo         fit the datasets into demo-output/"
	@echo "make check        style of what changed, and one fast test a promise: a minute"
	@echo "make test         style, types, layers and tests, with the newest dependencies: eight minutes"
	@echo "make test-oldest  part of the tests with the oldest dependencies that are supported"
	@echo "make test-matrix  the demo and quick tests on every Python that is supported"
	@echo "make lint         style, types, layers and generated pages only"
	@echo "make style        the same without the types"
	@echo "make types        the types only"
	@echo "make suite        tests and a notebook only"
	@echo "make test-slow    what make test leaves out: repetitions, further cases, notebooks"
	@echo "make slow-list    measure every test and write tests/slow.txt, the list of what is left out"
	@echo "make format       fix the style where ruff can"
	@echo "make docs         write what the pages and the JSON Schema take from the program"
	@echo "make picture      draw the picture of the README anew"
	@echo "make site         build the pages for a browser into site/"
	@echo "make schema       write the shipped JSON Schema only"
	@echo "make lock         write uv.lock anew: the tools of developers are installed as it says"
	@echo "make acceptance   every headline figure again, against docs/evidence/acceptance.md"
	@echo "make house        count lines, long functions, long signatures and uses of Any;"
	@echo "                  HOUSE=--packages counts lines and tuning constants by package"
	@echo "make study        efficiency, coverage and designs by repetition, written to docs/evidence/"
	@echo "make red-team     attack the numbers with other simulators, written to docs/evidence/red-team.md"
	@echo "make soak         attack reader, files and processes, written to docs/evidence/soak.md"
	@echo "make bench        this project against other tools, written to docs/evidence/benchmark.md"
	@echo "make clean        remove everything that make has made"
	@echo "Another Python: make PYTHON=/path/to/python3.12 test"

demo: $(INSTALLED)
	rm -rf demo-output
	$(BIN)/fluidact-fit demo demo-output

# Between two edits: the style of the files that differ from main, and the tests of
# tests/promises.txt.
CHANGED = $(shell git diff --name-only --diff-filter=d main -- '*.py') \
	$(shell git ls-files --others --exclude-standard -- '*.py')
check: $(INSTALLED_DEV)
	$(if $(strip $(CHANGED)),$(BIN)/ruff check $(CHANGED))
	$(if $(strip $(CHANGED)),$(BIN)/ruff format --check $(CHANGED))
	$(BIN)/lint-imports --no-cache --no-logo > /dev/null
	$(BIN)/python -m pytest -n 2 -q @tests/promises.txt

# The types are checked beside the tests: one process, that would leave the other core idle.
test: style
	$(MAKE) --no-print-directory --jobs 2 types suite

suite: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow" --nbmake tests notebooks

test-slow: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow --nbmake tests notebooks

# After tests were added: what takes long is listed anew.
slow-list: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -n 2 --dist worksteal --nbmake --durations=0 --durations-min=0.02 \
		tests notebooks > slow-list.txt || { tail -n 20 slow-list.txt; rm slow-list.txt; exit 1; }
	$(BIN)/python tools/slow_tests.py < slow-list.txt > tests/slow.txt
	rm slow-list.txt

# What depends on the interfaces of the dependencies; the estimates are left to `test`. Old releases
# warn of newer ones below them, and pydantic's word the JSON Schema differently from the committed
# one: neither is a fault of this program.
test-oldest: $(OLDEST)/installed
	$(OLDEST)/bin/python -m pytest -n 2 -W ignore::DeprecationWarning \
		tests/cli tests/control tests/logs tests/parameters tests/report tests/test_units.py \
		--ignore tests/cli/test_broken_logs.py \
		--deselect tests/parameters/test_schema.py::test_the_committed_schema_is_the_one_built

# The newest dependencies there are, not those of uv.lock, on every Python that is installed here
# as python3.N; MATRIX=3.13 takes one. The oldest dependencies have no wheels beyond the oldest one.
test-matrix: test-oldest $(MATRIX:%=matrix-%)

matrix-%: pyproject.toml
	python$* -m venv --clear .venv-matrix-$*
	.venv-matrix-$*/bin/python -m pip install --quiet --upgrade "pip>=25.1"
	.venv-matrix-$*/bin/python -m pip install --quiet --editable . --group test
	.venv-matrix-$*/bin/fluidact-fit demo .venv-matrix-$*/demo
	.venv-matrix-$*/bin/python -m pytest -n 2 tests/logs tests/parameters tests/test_units.py

lint: style types

types: $(INSTALLED_DEV)
	$(BIN)/mypy

style: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(COG) --check --check-fail-msg 'Run: make docs' $(PAGES)

format: $(INSTALLED_DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: schema
	$(BIN)/python tools/docs_tables.py
	$(COG) -r $(PAGES)

# Of the README: committed, since a page of a repository cannot fit a model; in few colours, small.
picture: build/demo/SHA256SUMS
	$(BIN)/python -c 'from PIL import Image; Image.open("build/demo/hydrostatic.png").convert("RGB") \
		.quantize(48, dither=Image.Dither.NONE).save("docs/assets/fit.png", optimize=True)'

# Pictures of fits are drawn when the program or a dataset has changed; a page fetches nothing when
# it is read. To look at it: .venv/bin/python -m http.server --directory site, or open index.html.
site: build/demo/SHA256SUMS
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "site/index.html"

build/demo/SHA256SUMS: $(INSTALLED_DEV) $(wildcard datasets/*/*.csv) $(shell find sysid -name '*.py')
	rm -rf build/demo
	$(BIN)/fluidact-fit demo build/demo
	cp datasets/SHA256SUMS $@

schema: $(INSTALLED_DEV)
	$(BIN)/python tools/schema.py

# Always from PyPI itself, whatever index this machine is set up with.
lock: $(INSTALLED_DEV)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv lock --upgrade --no-config --default-index https://pypi.org/simple

house:
	@$(PYTHON) tools/house.py $(HOUSE)

# Some ten minutes on two cores; ACCEPTANCE='--only readme' runs a part, ACCEPTANCE=--write writes
# the table anew.
acceptance: $(INSTALLED)
	$(BIN)/python -m studies.acceptance $(ACCEPTANCE)

# `make -C studies` lists every study by itself; make -C studies statistics ARGS='--scale 0.1' is a
# taste of one. make red-team RED_TEAM='--vary 0.4 --seed 7' attacks machines that nothing was
# tuned on.
study: $(INSTALLED_DEV)
	$(MAKE) --no-print-directory -C studies study

red-team: $(INSTALLED_DEV)
	$(MAKE) --no-print-directory -C studies red-team ARGS='$(RED_TEAM)'

soak: $(INSTALLED_DEV)
	$(MAKE) --no-print-directory -C studies $(if $(SOAK),attacks,soak) ARGS='$(SOAK)'

# Other tools come from PyPI into environments of their own; MATLAB and Octave do not.
bench: $(INSTALLED)
	$(BIN)/python bench/environments.py
	$(BIN)/python bench/run.py $(BENCH)
	$(BIN)/python bench/speed.py
	$(BIN)/python bench/report.py

clean:
	rm -rf $(VENV) $(OLDEST) .venv-matrix-* demo-output build dist site .mypy_cache .ruff_cache .pytest_cache \
		.hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# An environment is made anew when pyproject.toml changes, and only then. Dependency groups need
# pip 25.1, which Python 3.11 does not come with.
define make_environment
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is missing or older than Python 3.11."; \
		echo "Name another one: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; \
		exit 1; }
	$(PYTHON) -m venv --clear $(1)
	$(1)/bin/python -m pip install --quiet --disable-pip-version-check 'pip>=25.1'
endef

$(VENV)/made: pyproject.toml
	$(call make_environment,$(VENV))
	@touch $@

# Python compiles what is imported, when it is: a third of what pip would.
$(INSTALLED): $(VENV)/made
	$(BIN)/python -m pip install --quiet --no-compile --editable .
	@touch $@

$(INSTALLED_DEV): $(VENV)/made uv.lock tools/locked.py
	$(PYTHON) tools/locked.py > $(VENV)/constraints.txt
	$(BIN)/python -m pip install --quiet --no-compile --constraint $(VENV)/constraints.txt \
		--editable . --group dev
	@touch $(INSTALLED) $@

$(OLDEST)/installed: pyproject.toml tools/oldest.py uv.lock tools/locked.py
	$(call make_environment,$(OLDEST))
	$(PYTHON) tools/oldest.py > $(OLDEST)/constraints.txt
	$(OLDEST)/bin/python -m pip install --quiet --constraint $(OLDEST)/constraints.txt \
		--editable . --group test
	@touch $@

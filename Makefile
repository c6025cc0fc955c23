# Two commands matter: `make demo` flies the built-in aircraft, `make test` proves the code. Both prepare .venv themselves.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.prepared
# Every Python that the product is for; those that are not installed are named and left out.
PYTHONS ?= 3.11 3.12 3.13

# Where it is set, each of the hundred programs that the tests start compiles every module anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check check-lab check-pythons check-view check-gateways check-recipes bench figures hil docs site walk venv install clean
.DEFAULT_GOAL := demo

demo: venv
	$(BIN)/mkdaemon demo

# Three processes on two cores: what runs in real time mostly waits; beside four it came too late.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -p tests.wholefiles -o console_output_style=classic -m "not browser and not gateways and not whole"
# What the product is measured, rehearsed, tested and packed with proves itself apart, and so do the tree and the pages.
LAB_TESTS := tests/lab tests/tools tests/mksim tests/sim_conformance $(addprefix tests/,$(addsuffix .py,\
  cli/test_pages stories/test_process stories/test_walks test_house test_upgrade test_wheel))

test: venv
	$(PYTEST) $(addprefix --ignore ,$(LAB_TESTS)) -p tools.branches --branches

check-pythons:
	@for version in $(PYTHONS); do \
	  if ! python$$version -c '' 2>/dev/null; then echo "Python $$version is not installed: left out"; continue; fi; \
	  echo "Python $$version"; \
	  $(MAKE) test check-lab VENV=build/python-$$version PYTHON=python$$version || exit 1; \
	done

check-lab: venv
	$(PYTEST) $(LAB_TESTS)

check: venv
	$(BIN)/ruff check src lab tools tests examples
	$(BIN)/ruff format --check src lab tools tests examples
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tools.shape
	$(BIN)/python -m tools.docs --check
	$(BIN)/python -m tools.words
	$(BIN)/python -m tools.commit

# The page of `mkctl view` in a real browser; names the package to install where there is none.
check-view: venv
	$(BIN)/python -m pytest -q -m browser tests/view

# Gateways before the real programs they are for. tests/gateways/*/clients.txt names those that are no part of `.venv`;
# without what they need for their windows and maps, for it would replace OpenCV.
check-gateways: venv
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps $(addprefix --requirement ,$(wildcard tests/gateways/*/clients.txt))
	$(BIN)/python -m pytest -q -m gateways tests/gateways

# The recipes of docs/architecture.md, carried out on a copy of the tree, before every test of the packages they edit.
check-recipes: venv
	$(BIN)/python -m pytest -q -m whole tests/tools/test_recipes.py

bench: venv
	$(BIN)/python -m lab protocol --json
	$(BIN)/python -m lab link --json
	$(BIN)/python -m lab stories --json
	$(BIN)/python -m lab vision --quick --json

figures: venv
	$(BIN)/python -m lab figures

# The proving ground: FIRMWARE is a folder of a FlightCtrl's sources, SIMAVR one of simavr; both are the user's.
hil: venv
	$(BIN)/python -m lab.hil.build "$(FIRMWARE)" "$(SIMAVR)" "$(NAVICTRL)"

docs: venv
	$(BIN)/python -m tools.docs

# The documentation as a site, in build/site; what builds it is no part of `.venv` before.
site: venv
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --requirement requirements-docs.txt
	$(BIN)/python -m tools.site

# A newcomer's first day in a new clone with a new home: README's two commands, then every tutorial, line by line.
walk: venv
	$(BIN)/python -m tools.walk

venv: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@echo "preparing $(VENV): a minute or two the first time"
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or later is needed, for example: make PYTHON=/usr/bin/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --retries 10 --timeout 60 --constraint constraints.txt --editable '.[dev]'
	touch $@

install:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --only-binary :all: --require-hashes --requirement requirements-aircraft.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-index --no-deps --no-build-isolation .

clean:
	rm -rf .venv build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis

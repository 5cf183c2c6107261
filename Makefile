# make demo | test | check | bench; everything is installed into .venv from constraints.txt
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help install check test demo quick-demo bench pictures clean

help:
	@echo "make demo    train a policy for about three minutes, evaluate it, draw pictures"
	@echo "make test    run the tests"
	@echo "make check   format, lint, types"
	@echo "make bench   measure the speed of every layer"

install: $(READY)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("surefoot needs Python 3.11 or newer, this is " + sys.version) if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[learn,dev]'
	touch $(READY)

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

test: $(READY)
	$(BIN)/pytest -n 2

demo: $(READY)
	$(BIN)/surefoot demo

quick-demo: $(READY)
	$(BIN)/surefoot demo --minutes 0.4 --out runs/quick-demo

bench: $(READY)
	$(BIN)/surefoot bench

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache

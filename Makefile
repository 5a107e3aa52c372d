# make demo: set up and run the main job, on this machine alone · make test · make lint · make firmware-test · make bench · make accuracy · make magnetic · make loop · make venv: the set-up alone
.DEFAULT_GOAL := help
SHELL := /bin/bash
VENV := .venv
BIN := $(VENV)/bin
# The first that runs: 3.12 is what Jazzy has.
PYTHON ?= $(shell for p in python3.12 python3.11 python3.13 python3.10 python3; do \
	$$p -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null && echo $$p && break; done)
EXTRAS := ros,viewer,report,sim,mocap,raw,test,lint

.PHONY: help venv demo test lint firmware-test bench accuracy magnetic loop clean
help:
	@sed -n 1p Makefile | cut -c3-

venv: $(VENV)/.ready

# Everything that the messages are built from; the package itself is installed editable.
$(VENV)/.ready: setup.py pyproject.toml package.xml $(wildcard msg_defs/* msg_defs/msg/*) $(wildcard scripts/*)
	@./.ci/check-system '$(PYTHON)'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo 'Setting up $(VENV) with ROS 2 Jazzy (a few minutes the first time) …'
	@$(BIN)/pip install --quiet --disable-pip-version-check --upgrade pip 'setuptools>=68' wheel 2>$(VENV)/pip.log || { cat $(VENV)/pip.log >&2; exit 1; }
	@$(BIN)/pip install --quiet --disable-pip-version-check ./msg_defs 2>$(VENV)/pip.log || { cat $(VENV)/pip.log >&2; exit 1; }
	@$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[$(EXTRAS)]' 2>$(VENV)/pip.log || { cat $(VENV)/pip.log >&2; exit 1; }
	@touch $@

demo: venv
	@ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST $(BIN)/sesa2 run --config config/prototype3_8.yaml --source sim --viewer

test: venv
	@$(BIN)/python -m pytest

lint: venv
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

# The real firmware in a simulated board; says which Debian packages it needs.
firmware-test: venv
	@$(MAKE) --no-print-directory -C firmware test
	@SESA2_REQUIRE_FIRMWARE=1 $(BIN)/python -m pytest test/firmware

bench: venv
	@$(BIN)/python bench/run.py

# Errors on the recordings, written into README.md.
accuracy: venv
	@$(BIN)/python bench/accuracy.py

# The paper's tables of shape from magnets, theirs beside ours, written into docs/magnetic.md.
magnetic: venv
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python bench/magnetic_paper.py

# The tip of simulated arms driven by what they feel, beside the paper's; writes docs/loop.md and docs/loop.png.
loop: venv
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python bench/loop.py

clean:
	rm -rf $(VENV) build install log

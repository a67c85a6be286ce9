# Everything runs in .venv, which is made once; no ROS is needed. See CONTRIBUTING.md.

PYTHON ?= python3
# Where there are no ROS wheels (they are for x86_64): make EXTRAS=test ...
EXTRAS ?= ros,plots,test
PYTEST_FLAGS ?=
DEMO_FLAGS ?=

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/made_for

# A ROS sourced in this shell has other libraries than the ones in .venv.
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH RMW_IMPLEMENTATION
unexport ROS_LOCALHOST_ONLY ROS_STATIC_PEERS ROS_DISCOVERY_SERVER
unexport FASTRTPS_DEFAULT_PROFILES_FILE FASTDDS_DEFAULT_PROFILES_FILE

# An environment holds its own path: make a new one when the tree was moved or copied.
MADE_FOR := $(CURDIR) [$(EXTRAS)]
ifneq ($(file < $(STAMP)),$(MADE_FOR))
.PHONY: $(STAMP)
endif

.PHONY: help demo test bench docs lint clean
.DEFAULT_GOAL := help

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*##/make \1\t/p' Makefile | expand -t 16

demo: $(STAMP)  ## run the demonstrations; films, plots and numbers go to tp_demo/
	@$(BIN)/tp_controller demo $(DEMO_FLAGS)

test: $(STAMP)  ## run all tests (PYTEST_FLAGS='-k solver' for some)
	@logs=$$(mktemp -d) && trap 'rm -rf "$$logs"' EXIT && \
	  ROS_LOG_DIR="$$logs" $(BIN)/python -m pytest $(PYTEST_FLAGS)

bench: $(STAMP)  ## measure times on this machine (benchmarks/)
	@set -e; for file in benchmarks/[a-z]*.py; do $(BIN)/python "$$file"; done

docs: $(STAMP)  ## build the pages as a site, strictly: docs/_build/index.html
	@$(BIN)/python -c 'import furo, myst_parser, sphinx' 2> /dev/null || \
	  $(BIN)/python -m pip --disable-pip-version-check install -qq -e '.[docs]'
	@$(BIN)/python -m sphinx -q -n -W --keep-going docs docs/_build

lint: $(STAMP)  ## check code style and types
	@$(BIN)/python -m ruff check .
	@$(BIN)/python -m mypy

clean:  ## remove .venv and everything built
	@rm -rf $(VENV) build install log tp_demo docs/_build *.egg-info
	@rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMP): setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo 'Python 3.10 or newer is needed, "$(PYTHON)" is not.' \
	       'Name one: make PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null || { \
	  echo '"$(PYTHON)" has no venv module: sudo apt install python3-venv' >&2; exit 1; }
	@if [ "$$(cat $@ 2> /dev/null)" != '$(MADE_FOR)' ]; then \
	  echo 'Making .venv (once; about a minute) ...'; \
	  $(PYTHON) -m venv --clear $(VENV); fi
	@$(BIN)/python -m pip --disable-pip-version-check install -qq -e '.[$(EXTRAS)]' || { \
	  echo 'The packages could not be installed. ROS wheels exist for Linux on x86_64, Python' \
	       '3.10 to 3.14; elsewhere: make EXTRAS=test ...' >&2; exit 1; }
	@echo '$(MADE_FOR)' > $@

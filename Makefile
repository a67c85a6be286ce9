# Everything runs in .venv, which is made once; no ROS is needed. See CONTRIBUTING.md.

PYTHON ?= python3
# Where there are no ROS wheels (they are for x86_64): make EXTRAS=test ...
EXTRAS ?= ros plots view record test
# Versions that the tests passed with; the newest ones: make CONSTRAINTS= ...
CONSTRAINTS ?= -c constraints.txt
PYTEST_FLAGS ?=
DEMO_FLAGS ?=

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/made_for
PIP := $(BIN)/python -m pip --disable-pip-version-check install -qq $(CONSTRAINTS)
comma := ,
CHOSEN := $(subst $(comma), ,$(EXTRAS))
# Which of them a target needs.
DEMO_NEEDS := $(patsubst %,$(VENV)/with_%,$(filter ros plots view record,$(CHOSEN)))
DEMO_VIEW := $(if $(filter view,$(CHOSEN)),--view)
TEST_NEEDS := $(patsubst %,$(VENV)/with_%,$(CHOSEN))
# What each installs, and how large its files are then.
SIZE_ros := ROS 2 nodes: rclpy and messages as wheels, 150 MB
SIZE_plots := plots and films: matplotlib, 100 MB
SIZE_view := page in the browser: viser, 60 MB
SIZE_record := recordings: rosbags, 20 MB
SIZE_test := tests, lint, robots to test with, and what docs needs: 850 MB
SIZE_docs := the site: Sphinx, MyST and a theme, 80 MB

PYTEST := $(BIN)/python -m pytest
# These need only processors. Of tests with nodes only two run at once, as each has processes of its
# own, in a ROS domain of its own; those in a browser come one by one, as it draws with all there is.
WITHOUT_NODES := test/unit test/faults/test_fuzz.py test/faults/test_fuzz_core.py \
  test/faults/test_task_faults.py
IN_BROWSER := $(wildcard test/system/test_browser*.py) test/system/test_solid_film.py
FOUR := -n auto --maxprocesses 4 --dist loadfile
TWO := -n auto --maxprocesses 2 --dist loadfile

# A ROS sourced in this shell has other libraries than the ones in .venv.
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH RMW_IMPLEMENTATION
unexport ROS_LOCALHOST_ONLY ROS_STATIC_PEERS ROS_DISCOVERY_SERVER
unexport FASTRTPS_DEFAULT_PROFILES_FILE FASTDDS_DEFAULT_PROFILES_FILE

# An environment contains its own path: make a new one when the tree was moved or copied.
MADE_FOR := $(CURDIR)
ifneq ($(file < $(STAMP)),$(MADE_FOR))
.PHONY: $(STAMP)
endif

.PHONY: help demo test quick bench docs lint clean
.DEFAULT_GOAL := help

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*##/make \1\t/p' Makefile | expand -t 16

demo: $(STAMP) $(DEMO_NEEDS)  ## run a demo, live in the browser; films, plots and numbers go to tp_demo/
	@$(BIN)/tp_controller demo $(DEMO_VIEW) $(DEMO_FLAGS)

test: $(STAMP) $(TEST_NEEDS)  ## run all tests (PYTEST_FLAGS='-k solver' for some)
	@logs=$$(mktemp -d) && trap 'rm -rf "$$logs"' EXIT && export ROS_LOG_DIR="$$logs" && \
	  $(if $(PYTEST_FLAGS),$(PYTEST) $(PYTEST_FLAGS),\
	    $(PYTEST) $(FOUR) $(WITHOUT_NODES) && \
	    $(PYTEST) $(IN_BROWSER) && \
	    $(PYTEST) $(TWO) $(addprefix --ignore=,$(WITHOUT_NODES) $(IN_BROWSER)))

quick: $(STAMP) $(TEST_NEEDS)  ## run the unit tests that are not slow
	@$(PYTEST) $(FOUR) -m 'not slow' test/unit

bench: $(STAMP) $(TEST_NEEDS)  ## measure times on this machine (benchmarks/)
	@set -e; for file in benchmarks/[a-z]*.py; do $(BIN)/python "$$file"; done

docs: $(STAMP) $(VENV)/with_docs  ## build the pages as a site, strictly: docs/_build/index.html
	@$(BIN)/python -m sphinx -q -n -W --keep-going docs docs/_build
	@echo 'docs/_build/index.html; its search shows where a word stands only if the site is served:' \
	      '$(BIN)/python -m http.server --bind 127.0.0.1 --directory docs/_build'

lint: $(STAMP) $(TEST_NEEDS)  ## check code style and types
	@$(BIN)/python -m ruff check .
	@$(BIN)/python -m flake8 .
	@$(BIN)/python -m pydocstyle --config=setup.cfg .
	@$(BIN)/python -m mypy

clean:  ## remove .venv and everything built
	@rm -rf $(VENV) build install log tp_demo docs/_build docs/generated *.egg-info
	@rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
	@find tp_controller -name '*.so' -delete

$(STAMP): setup.py $(wildcard tp_controller/*/*.cpp tp_controller/*/*.h)
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo 'Python 3.10 or newer is needed, "$(PYTHON)" is not.' \
	       'Name one: make PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null || { \
	  echo '"$(PYTHON)" has no venv module: sudo apt install python3-venv' >&2; exit 1; }
	@if [ "$$(cat $@ 2> /dev/null)" != '$(MADE_FOR)' ]; then \
	  echo 'Making .venv, once.'; $(PYTHON) -m venv --clear $(VENV); fi
	@echo '+ library: numpy, scipy, pinocchio, 580 MB ...'
	@$(PIP) -e .
	@echo '$(MADE_FOR)' > $@

$(VENV)/with_%: $(STAMP)
	@echo '+ $(SIZE_$*) ...'
	@TP_CONTROLLER_KEEP_CORE=1 $(PIP) -e '.[$*]' || { \
	  echo 'The packages could not be installed. ROS wheels exist for Linux on x86_64, Python' \
	       '3.10 to 3.14; elsewhere: make EXTRAS=test ...' >&2; exit 1; }
	@touch $@

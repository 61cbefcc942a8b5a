# SPDX-License-Identifier: MIT
# `make demo` and `make test` do the whole set-up themselves; `make` alone lists the targets.

# The clone may be anywhere and make may be called from anywhere (make -C, make -f).
clone := $(shell cd "$(dir $(lastword $(MAKEFILE_LIST)))" && pwd -P)
python := "$(clone)/.venv/bin/python"
env := clone="$(clone)" && . "$(clone)/install/environment.sh" &&
# Arguments of the program that a target runs, for example: make demo ARGS="--elements 80 8"
ARGS ?=
# The demo that `make demo` runs: a file of demos/ without its ending.
DEMO ?= slider_crank

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup setup-tests demo test test-fast test-selection test-other-debian test-debian12 test-debian13 test-unstable test-wheel test-deb lint docs \
	benchmark benchmark-peers clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / {printf "  make %-19s %s\n", $$1, $$2}' "$(clone)/Makefile"

setup: ## install Debian packages and make .venv (does nothing the second time)
	@"$(clone)/install/setup.sh"

setup-tests: # the same, and the Debian packages that only tests need
	@"$(clone)/install/setup.sh" tests

demo: setup ## run a demo, DEMO=slider_crank by default; pictures in results/ (ARGS="..." for options)
	@cd "$(clone)" && $(env) $(python) "demos/$(DEMO).py" $(ARGS)

test: setup-tests ## run the tests: serially, with 2 and with 3 MPI ranks (ARGS="..." for pytest)
	@"$(clone)/tests/run.sh" $(ARGS)

test-fast: setup-tests ## run the serial tests but for the slow ones, for the day's work (ARGS="..." for pytest)
	@"$(clone)/tests/run.sh" --fast $(ARGS)

test-selection: setup ## run the tests of another release: what depends on other packages, one scene of each kind
	@"$(clone)/tests/run.sh" --selection $(ARGS)

test-other-debian: ## run the tests in a root of the other Debian release, 12 or 13 (needs root)
	@"$(clone)/install/debian_root.sh" other make test ARGS='$(ARGS)'

test-debian12: ## run the tests in a Debian 12 root (needs root)
	@"$(clone)/install/debian_root.sh" bookworm make test ARGS='$(ARGS)'

test-debian13: ## run the tests in a Debian 13 root (needs root)
	@"$(clone)/install/debian_root.sh" trixie make test ARGS='$(ARGS)'

test-unstable: ## run a selection of the tests in a root of Debian unstable (needs root)
	@"$(clone)/install/test_unstable.sh" || [ $$? = 77 ] # 77: skipped, and said why

test-wheel: setup ## build a wheel, install it in a fresh environment, run the short program there
	@"$(clone)/install/test_wheel.sh"

test-deb: ## build the Debian package, install and use it in a root of Debian 13 (needs root)
	@"$(clone)/install/test_deb.sh"

lint: setup ## check style, format and types
	@cd "$(clone)" && $(env) status=0; \
	$(python) -m ruff check . || status=1; \
	$(python) -m ruff format --check . || status=1; \
	$(python) -m mypy || status=1; \
	exit $$status

docs: setup ## build the documentation as a site, build/docs/index.html (warnings are errors)
	@cd "$(clone)" && $(env) $(python) -m sphinx -E -W --keep-going -q -c docs/site -d build/doctrees . build/docs
	@echo "docs: $(clone)/build/docs/index.html"

benchmark: setup ## measure speed and growth with the mesh; table and picture in results/ (ARGS="...")
	@cd "$(clone)" && $(env) $(python) benchmarks/run.py $(ARGS)

benchmark-peers: setup ## the same beside Exudyn and pyMOTO, put into results/peers from PyPI (ARGS="...")
	@cd "$(clone)" && $(env) $(python) benchmarks/peer_packages.py && $(python) benchmarks/run.py --only peers $(ARGS)

clean: ## remove .venv, caches and results (the roots of other Debian releases stay)
	@cd "$(clone)" && rm -rf .venv .venv.lock results build docs/reference docs/gallery docs/notebooks/*.md .pytest_cache .mypy_cache .ruff_cache .hypothesis src/*.egg-info
	@find "$(clone)" -name __pycache__ -type d -prune -exec rm -rf {} +

# make demo   a simulated plant through the whole service, a table of modes at the end
# make test   every test
# make check  style, types, import contracts
# make audit  known holes in what is installed, a list of licences
# make bench  what is timed, each with its floor and its aim
# make docs   write docs/reference from the code
# make nerfstudio  an environment of its own for what the reconstruction is compared with (benchmarks.nerfacto)
# make clean  remove what was built and written (.venv, out, caches)
#
# Each installs what it needs into .venv first: once, and again when pyproject.toml changes.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
BINDING := GPL-2.0;GPL-2.0-only;GPL-2.0-or-later;GPL-3.0;GPL-3.0-only;GPL-3.0-or-later;AGPL-3.0;AGPL-3.0-only;AGPL-3.0-or-later;GNU General Public License v3 (GPLv3);GNU General Public License v2 (GPLv2)
EXTRAS := vision,simulate,capture,postgres,dev

.PHONY: demo test check audit bench docs nerfstudio clean install
.DEFAULT_GOAL := help

.PHONY: help
help:
	@sed -n 's/^# \{0,1\}//p' Makefile | sed '/^$$/q'

# The documents that are written from the code.
docs: install
	$(BIN)/python docs/reference/generate.py

demo: install
	$(BIN)/nerfmodal demo --spec examples/acai.yaml --out out/demo

test: install
	@deploy/browser.sh
	$(BIN)/pytest

check: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	@$(BIN)/pip-licenses --ignore-packages bpy --fail-on '$(BINDING)' > /dev/null

# Known holes in what is installed (asks the package index), and every licence.
audit: install
	$(BIN)/pip-audit --skip-editable --progress-spinner off
	@mkdir -p out
	$(BIN)/pip-licenses --order=license --format=markdown --output-file=out/licences.md

bench: install
	@for name in $$(grep -l '__main__' benchmarks/*.py | grep -v _runner | xargs -n 1 basename -s .py); do \
	    $(BIN)/python -m benchmarks.$$name || exit 1; \
	done

# The torch of pyproject.toml; nerfstudio pins much else.
nerfstudio: out/nerfstudio/.installed

out/nerfstudio/.installed:
	@deploy/make-venv.sh out/nerfstudio
	@echo "installing into out/nerfstudio: some minutes"
	out/nerfstudio/bin/python -m pip install --quiet \
	    $$(sed -n 's/.*"\(torch==[^"]*\)".*/\1/p' pyproject.toml) nerfstudio
	@touch $@

clean:
	rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find libs services tests migrations -name __pycache__ -type d -prune -exec rm -rf {} +

install: $(INSTALLED)
	@deploy/system-libraries.sh $(VENV)

$(INSTALLED): pyproject.toml
	@deploy/make-venv.sh $(VENV)
	@echo "installing into $(VENV): some minutes the first time"
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[$(EXTRAS)]'
	@touch $@

# Two commands do all the set-up: `make run` (the demo, headless) and `make test`; `make test-all`
# adds the sweeps.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
OUT    ?= first-light
# Tests wait for a third of their time: three workers keep two cores busy.
WORKERS ?= 3

APT    := xvfb libegl1 libgl1 libxkbcommon-x11-0 libdbus-1-3 libfontconfig1 libxcb-cursor0 \
          libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 libxcb-render-util0 \
          libxcb-shape0 libxcb-xinerama0 libxcb-xkb1 libxcb-xfixes0 fonts-dejavu-core \
          xserver-xorg-core xserver-xorg-video-dummy x11-xserver-utils x11-apps x11-utils openbox \
          gir1.2-aravis-0.8 python3-gi

.PHONY: run test test-all gui figures check style types system clean

run: $(VENV)/run
	$(BIN)/labapp demo --out $(OUT) --force

# What one process of the tests has compiled serves the others.
test test-all: export PYTHONDONTWRITEBYTECODE :=

# mypy computes while tests wait; what it says comes at the end, and its failure fails the command.
test: $(VENV)/dev system style
	@$(BIN)/mypy >$(VENV)/types 2>&1 & types=$$!; \
	trap 'kill $$types 2>/dev/null' EXIT; trap 'exit 130' INT TERM; \
	$(BIN)/python -m pytest -n $(WORKERS); tests=$$?; \
	wait $$types; found=$$?; trap - EXIT; \
	cat $(VENV)/types; \
	exit $$((tests ? tests : found))

test-all: test
	$(BIN)/python -m pytest -n $(WORKERS) -m sweep

# A site of the guide and an API reference, in $(SITE); a warning is an error.
SITE ?= build/docs
.PHONY: docs
docs: $(VENV)/docs
	$(BIN)/python -m sphinx -q -W --keep-going -b html labapp/docs $(SITE)
	@echo "open $(SITE)/index.html"

gui: $(VENV)/run
	$(BIN)/labapp gui

# Measure what labapp claims, all of it or ONLY="psf demo", and write tests/figures/RESULTS.md.
figures: $(VENV)/dev
	PYTHONPATH=tests $(BIN)/python -m figures $(ONLY) $(if $(JSON),--json)

# Small bugs in one module, and which of them its tests notice: make mutants MODULE=optics/plane.py
.PHONY: mutants
mutants: $(VENV)/dev
	PYTHONPATH=tests $(BIN)/python -m mutants $(or $(MODULE),--help)

# Style, types and the imports that the rooms allow each other.
check: style types

style: $(VENV)/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(VENV)/dev
	$(BIN)/mypy

# What Qt and a virtual display need from the system; the headless main job needs none of it.
system:
	@missing=""; \
	for package in $(APT); do \
	  dpkg-query -W -f='$${Status}' $$package 2>/dev/null | grep -q "ok installed" \
	    || missing="$$missing $$package"; \
	done; \
	if [ -n "$$missing" ]; then \
	  if [ "$$(id -u)" = 0 ]; then \
	    apt-get update && apt-get install -y --no-install-recommends $$missing; \
	  else \
	    echo "The window's tests need system packages. Run:"; \
	    echo "  sudo apt-get install --no-install-recommends$$missing"; \
	    exit 1; \
	  fi; \
	fi

$(VENV)/made:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "Python 3.11 or later is needed; name one with: make PYTHON=python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/run: $(VENV)/made pyproject.toml constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	touch $@

$(VENV)/dev: $(VENV)/made pyproject.toml constraints.txt
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]' -e tests/peers
	touch $@ $(VENV)/run

$(VENV)/docs: $(VENV)/run
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) build *.egg-info

# make demo      set up and run the main job on recordings that ship
# make test      set up and run checks and tests
# make test-slow set up and run what takes long
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test test-slow check format clean

demo: $(READY)
	$(RUN)/shadow demo --out out/demo

test: $(READY) check
	$(RUN)/pytest -q -m "not slow"

test-slow: $(READY)
	$(RUN)/pytest -q -m slow

check: $(READY)
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy

format: $(READY)
	$(RUN)/ruff check --fix .
	$(RUN)/ruff format .

# The stamp depends on what is installed, so a change of the pins sets up anew. A Python without
# ensurepip (Debian splits it off) gets pip from virtualenv where that is there.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV) || $(PYTHON) -m virtualenv $(VENV)
	$(RUN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[dev]'
	touch $(READY)

clean:
	rm -rf $(VENV) out build *.egg-info

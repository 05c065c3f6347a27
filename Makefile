# make demo      set up and run the main job on recordings that ship
# make hil-demo  the same with an autopilot in the loop; AUTOPILOT=PATH is ardurover for SITL
# make test      set up and run checks and tests
# make test-slow set up and run what takes long: what runs alone, then calculations on two cores
# make fuzz      damaged files and packets against every parser, a minute each; MINUTES=10 for ten
# make docs      the documentation as a site, with search: out/site/index.html
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin
READY := $(VENV)/.ready

# What pytest makes of the assertions of a file is kept for the next process.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo hil-demo test test-slow fuzz docs chromium check format constraints clean

demo: $(READY)
	$(RUN)/shadow demo --out out/demo

hil-demo: $(READY)
	$(RUN)/shadow hil-demo --out out/hil-demo $(if $(AUTOPILOT),--autopilot $(AUTOPILOT))

# Types are checked beside the tests, which one process reads before three run them.
test: $(READY)
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	@mkdir -p out; failed=0; \
	$(RUN)/mypy > out/mypy.txt 2>&1 & types=$$!; \
	$(RUN)/pytest -q --collect-only -m "not slow" > /dev/null; \
	$(RUN)/pytest -q -m "not slow" -n auto --dist loadfile --no-loadscope-reorder || failed=1; \
	wait $$types || failed=1; \
	cat out/mypy.txt; exit $$failed

test-slow: $(READY) chromium
	@failed=0; \
	SHADOW_BROWSER=$$([ "$$(id -u)" != 0 ] || echo required) $(RUN)/pytest -q -m alone \
		|| failed=1; \
	$(RUN)/pytest -q -m "slow and not alone" -n 2 --dist loadfile --no-loadscope-reorder \
		|| failed=1; \
	exit $$failed

fuzz: $(READY)
	$(RUN)/python -m tests.fuzz --minutes $(or $(MINUTES),1) $(if $(ONLY),--only $(ONLY)) \
		$(if $(SEED),--seed $(SEED))

docs: $(READY)
	$(RUN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(RUN)/mkdocs build --strict

# The studio is tested in a real browser: where this can install one, it may not be missing.
chromium:
	@command -v chromium >/dev/null || { [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null && \
		apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } || \
		echo "no Chromium and no way to install it: its tests will be skipped"

check: $(READY)
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy

format: $(READY)
	$(RUN)/ruff check --fix .
	$(RUN)/ruff format .

# The stamp depends on what is installed, so a change of the pins sets up anew. Debian splits
# ensurepip off its Python: there virtualenv or, for root, the package manager has to help.
$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV) || $(PYTHON) -m virtualenv $(VENV) || \
		{ apt-get update && apt-get install -y python3-venv && $(PYTHON) -m venv $(VENV); }
	$(RUN)/python -m pip install --quiet --disable-pip-version-check \
		--constraint constraints.txt --editable '.[dev]'
	touch $(READY)

# Renew the pins from what a fresh environment resolves to.
constraints:
	rm -rf build/pins && $(PYTHON) -m venv build/pins
	build/pins/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	{ sed -n '/^#/p' constraints.txt; build/pins/bin/python -m pip freeze --exclude-editable; } \
		> build/constraints.txt && mv build/constraints.txt constraints.txt

clean:
	rm -rf $(VENV) out build *.egg-info

# Two commands do everything on a fresh machine with Python 3.11 or newer:
#   make demo    sets up, then runs the main job and puts its results into demo/
#   make test    sets up, then runs every check that guards a change
# make docs builds the site of the documentation in docs/_build.
# make thorough runs the slow campaigns that a release must pass; docs/testing.md says what each does.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PAGE := tests/studio/page
NODE_BIN := $(PAGE)/node_modules/.bin
PAGE_READY := $(PAGE)/node_modules/.ready

.PHONY: demo docs test check lint types types-elsewhere fast coverage page readers thorough format bench fuzz outlines clean constraints page-lock

demo: $(READY)
	$(BIN)/vinefab demo --out demo

test: check

check: lint types
	$(BIN)/pytest -n 2 --dist worksteal

# Formatters and linters: what .pre-commit-config.yaml calls before a commit.
lint: $(READY) page
	$(BIN)/ruff format --check --diff .
	$(BIN)/ruff check .
	$(BIN)/lint-imports

types: $(READY)
	$(BIN)/mypy

# Types where systems differ: as Windows and macOS would see them.
types-elsewhere: $(READY)
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32
	$(BIN)/mypy --platform darwin --cache-dir .mypy_cache/darwin

# The rooms that compute, without a browser or programs of others: what other Pythons are tried with.
fast: $(READY)
	$(BIN)/pytest -n 2 --dist worksteal tests/core tests/growth tests/model tests/outline tests/physics tests/tasks

# Lines and branches of kernels and rules that their tests reach, without the compiler, which hides
# them: docs/testing.md.
coverage: export NUMBA_DISABLE_JIT = 1
coverage: $(READY)
	$(BIN)/coverage run -m pytest -n 0 -m "not thorough and not compiler" tests/growth tests/tasks tests/fabrication/rules tests/search/test_design_batch.py $(wildcard tests/search/test_penalty*.py)
	$(BIN)/coverage report

# The studio's page: types and lint.
page: $(PAGE_READY)
	$(NODE_BIN)/tsc --project $(PAGE)
	$(NODE_BIN)/biome lint --config-path=$(PAGE) --error-on-warnings vinefab/studio/page vinefab/pages/templates

# Programs of others that read our files, each in an environment of its own; tests are skipped without.
readers: .readers/.ready

.readers/.ready:
	$(PYTHON) -m venv .readers/microweldr
	.readers/microweldr/bin/pip install -q microweldr==6.1.11
	npm install --prefix .readers --legacy-peer-deps --no-audit --no-fund lbrnts@0.0.17 svgson@5.3.1 transformation-matrix@3.1.0
	touch $@

docs: $(READY)
	$(BIN)/python -m sphinx -b html -q -W --keep-going docs docs/_build

bench: $(READY)
	$(BIN)/vinefab bench --million

fuzz: $(READY)
	$(BIN)/python tests/attack/growth.py 20000
	$(BIN)/python tests/attack/files.py 3000
	$(BIN)/python tests/attack/names.py
	$(BIN)/python tests/attack/kills.py 20
	$(BIN)/python tests/attack/failing_system.py 2
	$(BIN)/python tests/attack/connections.py
	$(BIN)/python tests/attack/readers.py 600
	$(BIN)/python tests/maps/importers/against_chromium.py 200

thorough: check types-elsewhere fuzz outlines
	$(BIN)/pytest -n 2 -m thorough
	$(BIN)/python tests/fabrication/rules/mutate.py
	$(BIN)/python tests/growth/mutate_kernels.py
	$(BIN)/python tests/fabrication/rules/cuts_clear.py 2000
	$(BIN)/python tests/search/fix_many.py 40
	$(BIN)/python tests/search/fix_many.py 40 trees
	$(BIN)/python tests/tasks/measure_area_errors.py 1000
	$(BIN)/python tests/search/kill.py 20
	$(BIN)/python tests/search/target_cases.py
	$(BIN)/python tests/fabrication/pieces/many_trees.py 2000
	$(BIN)/python tests/observation/many_photos.py 24
	$(BIN)/python tests/observation/many_unkind.py 40 --jobs 2 --out $(VENV)/unkind.json
	$(BIN)/python tests/observation/many_campaigns.py $(VENV)/unkind.json 200
	$(BIN)/python tests/photos/measure_shape.py 60 --jobs 2

outlines: $(READY)
	$(BIN)/python tests/outline/property.py

format: $(READY)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[cluster,dev,docs,evolution,gis,studies,studio,tables,vision]'
	touch $(READY)

$(PAGE_READY): $(PAGE)/package.json $(PAGE)/package-lock.json
	@command -v npm >/dev/null || { echo "node and npm are missing: they check the studio's page, see docs/testing.md" >&2; exit 1; }
	npm ci --prefix $(PAGE) --no-audit --no-fund --loglevel=error
	touch $(PAGE_READY)

# For maintainers: pins for every supported Python and system, without any address in them.
constraints: $(READY)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile pyproject.toml --all-extras --universal --no-annotate --no-header --output-file constraints.txt

# For maintainers: pins of what checks the page, without any address in them.
page-lock:
	cd $(PAGE) && rm -rf node_modules package-lock.json && npm install --no-audit --no-fund --package-lock-only --omit-lockfile-registry-resolved
	sed -i '/"funding": {/,/}/d' $(PAGE)/package-lock.json

clean:
	rm -rf $(VENV) $(PAGE)/node_modules demo build dist

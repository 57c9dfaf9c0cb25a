# make demo    bake an example, fit spheres to it, and say where the pictures are
# make test    run the quick tests: every command, backend and format
# make test-all    run every test; make test-slow: those that make test leaves out
# make lint    ruff, mypy and codespell
# make docs    build the documentation site, docs/_build/html; make docs-serve: show it at http://localhost:8000
# make docs-pictures    make the pictures of the documentation again
# make dist    build the wheel and the source archive in dist/, and check them
# make bench   measure speed and memory
# All of them need `make setup` only once; it comes by itself.

PYTHON ?= python3
BIN := .venv/bin
SETUP := .venv/.setup
BROWSER := .venv/.browser
PYTEST = $(BIN)/python -m pytest -n auto --dist worksteal $(PYTEST_ARGS)

.PHONY: setup demo test test-slow test-all lint docs docs-serve docs-pictures docs-linkcheck dist bench clean

setup: $(SETUP)

$(SETUP): pyproject.toml scripts/setup-gl scripts/setup-validator tests/validator/package-lock.json \
		scripts/setup-viewer viewer/package-lock.json viewer/three.js
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	sh scripts/setup-gl $(BIN)/python
	sh scripts/setup-validator
	sh scripts/setup-viewer
	@touch $@

$(BROWSER): $(SETUP) scripts/setup-browser
	sh scripts/setup-browser $(BIN)/python
	@touch $@

demo: $(SETUP)
	$(BIN)/python examples/make_meshes.py demo
	cd demo && ../$(BIN)/aoprecalc bake colonnade.obj --crease-angle 40
	cd demo && ../$(BIN)/aoprecalc spheres colonnade.obj -n 300 --method shadow
	cd demo && ../$(BIN)/aoprecalc preview colonnade_ao.obj --spheres colonnade_spheres.json --ground \
		--size 1600x720 -o colonnade_preview.png
	@echo
	@echo "Pictures to look at:"
	@echo "  demo/colonnade_ao.png        the ambient-occlusion texture"
	@echo "  demo/colonnade_preview.png   the mesh with it and its own shadow, and 300 spheres with theirs"

test: $(SETUP)
	$(PYTEST) -m "not slow"

test-slow: $(BROWSER)
	$(PYTEST) -m slow

test-all: $(BROWSER)
	$(PYTEST)

lint: $(SETUP)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[lint]'
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/codespell

docs: $(SETUP)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[docs]'
	rm -rf docs/_build/html
	$(BIN)/sphinx-build -E -n -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

docs-serve: docs
	$(BIN)/python -m http.server --bind localhost --directory docs/_build/html 8000

docs-pictures: $(SETUP)
	$(BIN)/python docs/make_pictures.py

docs-linkcheck: docs
	$(BIN)/sphinx-build -q -b linkcheck docs docs/_build/linkcheck

dist: $(SETUP)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dist]'
	rm -rf dist
	$(BIN)/python -m build --quiet
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist/*.whl
	@ls -l dist

bench: $(SETUP)
	$(BIN)/python benchmarks/speed.py
	$(BIN)/python benchmarks/spheres.py

clean:
	rm -rf .venv tests/validator/node_modules viewer/node_modules src/aoprecalc/render/viewer/three.* demo build dist docs/_build

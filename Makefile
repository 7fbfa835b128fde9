# SPDX-License-Identifier: Apache-2.0
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
READY := $(VENV)/ready
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
unexport PYTHONDONTWRITEBYTECODE # each process would compile anew what the tests have changed, which takes 10 s

.PHONY: reproduce-all test test-kernels test-browser test-ingest test-latex test-package test-slurm test-speed peers setup check docs public paper five-minutes sbom docs-numbers docs-pictures lock dist release

reproduce-all: $(READY)
	$(BIN)/snakemake reproduce-all

test: $(READY)
	$(BIN)/python -m pytest

# Fits with the matrix kernels of other processors (any x86 of the last ten years has them): tests/kernels.py.
test-kernels: test-kernel-Nehalem test-kernel-Haswell

test-kernel-%: $(READY)
	OPENBLAS_CORETYPE=$* $(BIN)/python tests/kernels.py
	OPENBLAS_CORETYPE=$* $(BIN)/python -m pytest -m numerics -n0

# The report in headless Chromium (Debian: apt-get install chromium chromium-driver).
test-browser: $(READY)
	$(BIN)/python -m pytest -m browser -n0 tests/browser

# A manuscript of IEEEtran with all results (Debian: apt-get install texlive-publishers texlive-science). Run
# `make reproduce-all` before it. Without TeX it says that it did not run.
test-latex: $(READY)
	$(BIN)/python -m pytest -m latex -n0 -rs tests/latex

# The default campaign's ingested trials, bit by bit. Run `make reproduce-all` before it.
test-ingest: $(READY)
	$(BIN)/python tests/ingested_trials.py

# Wheel and sdist, built twice and compared, then one after the other installed and used in a new environment.
test-package: $(READY)
	$(BIN)/python tests/package.py

# Wheel and sdist in dist/. Their bytes depend on the files alone.
dist: $(READY)
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist

# Recordings with known truth, the answers of other packages, which have an environment of their own, and the tables and the
# figure of docs/peers.md. Half an hour of one core.
peers: $(READY)
	$(PYTHON) -m venv --clear build/peers_venv
	$(BIN)/uv pip install --quiet --python build/peers_venv --editable '.[simulator,peers]'
	OPENBLAS_NUM_THREADS=1 build/peers_venv/bin/python benchmarks/peers/page.py

# All that a release has, in dist/: wheel, sdist, the page of the default campaign, the documentation, checksums. It needs
# no network and attaches nothing.
release: dist docs sbom reproduce-all
	cp results/report.html dist/demo-report.html
	cp build/sbom.cdx.json dist
	$(PYTHON) -m zipfile --create dist/docs.zip build/docs
	cd dist && sha256sum * > SHA256SUMS

# The documentation site in build/docs, without a network. Warnings are errors, such as of a link that leads nowhere.
docs: $(READY)
	rm -rf build/docs build/doctrees
	$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going --doctree-dir build/doctrees docs build/docs

# Numbers of pages beside those that their commands print; the results of `make reproduce-all` must be there.
docs-numbers: $(READY)
	$(BIN)/python tools/docs_numbers.py

# The pictures of README and tutorial, of the results that `make reproduce-all` has made. It needs Chromium.
docs-pictures: $(READY)
	cp results/figures/fig5.png docs/fig5.png
	chromium --headless --no-sandbox --hide-scrollbars --window-size=1280,900 --screenshot=docs/report.png results/report.html
	$(BIN)/python tools/docs_numbers.py docs

# A campaign of 24 trials through a SLURM that exists for this test alone: Debian, as root.
test-slurm: build/cluster
	PYTHONPATH=$(CURDIR)/build/cluster tests/slurm/one_node.sh $(BIN)/python -m pytest -m slurm -n0 -s tests/slurm

# Snakemake's plug-in for SLURM stands beside the environment: Snakemake imports each one that it finds, this one with
# pandas, at every start.
build/cluster: cluster.lock $(READY)
	rm -rf $@
	$(PIP) --require-hashes --no-deps --target $@ -r cluster.lock

# The last release, by the commit that named it.
LAST_RELEASE := 124499ca

# Core-seconds of a campaign of 17 trials, beside those of the last release. Single rounds of 3.0.0 are 0.99 to 1.14 of
# 2.0.0: a round scatters by a tenth. Nothing else may run meanwhile.
test-speed: $(READY)
	$(BIN)/python benchmarks/against.py $(LAST_RELEASE) --short --rounds 1 --most 1.25
	$(BIN)/python benchmarks/doors.py --most 900

# What the project has beside its code: that the files parse, agree and lead somewhere. uv fetches the checkers.
public: dist sbom five-minutes
	$(BIN)/python tools/public.py
	$(CHECKER) cffconvert==2.0.0 --validate
	$(CHECKER) twine==7.0.0 check --strict dist/*.whl dist/*.tar.gz
	$(SCHEMA).github-workflows .github/workflows/*.yml
	$(SCHEMA).github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(SCHEMA).github-issue-forms $(filter-out %/config.yml,$(wildcard .github/ISSUE_TEMPLATE/*.yml))
	$(SCHEMA).readthedocs .readthedocs.yaml
	$(CHECKER) pre-commit==4.7.0 validate-config .pre-commit-config.yaml

CHECKER := $(BIN)/uvx --quiet
SCHEMA := $(CHECKER) check-jsonschema==0.39.0 --builtin-schema vendor

# What docs/five_minutes.md says is typed, typed in a new folder.
five-minutes: $(READY)
	$(BIN)/python tools/typed_page.py docs/five_minutes.md

# The libraries of the environment, which are those of the lock, with version and licence, as CycloneDX.
sbom: $(READY)
	mkdir -p build
	$(CHECKER) --from cyclonedx-bom==7.5.0 cyclonedx-py environment --pyproject pyproject.toml --output-reproducible \
		--validate --output-file build/sbom.cdx.json $(BIN)/python

# The paper for the Journal of Open Source Software, with the numbers of the documentation's tables.
paper: $(READY)
	$(BIN)/python paper/paper.py

setup: $(READY)

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/snakefmt --check Snakefile rules
	$(BIN)/mypy
	$(BIN)/mypy --platform win32 --cache-dir .mypy_cache/win32 # no name of a module that Windows lacks

# The environment holds exactly what the lock names, its bytecode compiled: a job's imports cost 1.4 s with, 3.9 s without.
$(READY): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv --clear $(VENV)
	$(PIP) --no-compile --require-hashes --no-deps -r requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	$(BIN)/python -m compileall -q -j 0 $(VENV)/lib osl_analysis
	touch $(READY)

LOCKED := excel mat73 matlab protobuf simulator tdms docs dev

COMPILE := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate pyproject.toml

# What the extra `cluster` needs beside the environment has a lock of its own.
lock: $(READY)
	$(COMPILE) $(LOCKED:%=--extra %) --group recorders --output-file requirements.lock
	$(COMPILE) --extra cluster --constraints requirements.lock --output-file cluster.lock \
		$$(sed -n 's/^\([^=]*\)==.*/--no-emit-package \1/p' requirements.lock)

# Thin front doors. Each target says what it calls; `make help` lists them.

CARGO ?= cargo

.PHONY: help setup build demo test lint bench hunt gate peers integrations first-trial dist deb docs pictures

help: ## what there is to make
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 15

setup: ## find or fetch Embree 4.4, libclang and a C compiler (tools/setup.py)
	@python3 tools/setup.py

build: setup ## release binaries: treewrightd, treewright, treewright-render, treewright-lab
	$(CARGO) build --release --locked --bins -p treewright-server -p treewright-cli -p treewright-render-cli -p treewright-lab

demo: setup ## tune a built-in scene, then open demo/report.html
	TREEWRIGHT_KERNELS=native $(CARGO) build --profile demo --locked --bins --no-default-features -p treewright-server -p treewright-render-cli
	@tools/demo.sh

dist: ## an archive to hand out, with its check sum (tools/dist.py)
	@python3 tools/dist.py

deb: dist ## a Debian package of the daemon and the command line; wants cargo-deb
	@$(CARGO) deb --version >/dev/null 2>&1 || { echo "deb: run this first: cargo install --locked cargo-deb" >&2; exit 1; }
	$(CARGO) deb -p treewright-server --profile dist --no-build --no-strip --output target/

docs: ## the documentation as a book in target/book; wants mdbook
	@command -v mdbook >/dev/null || { echo "docs: run this first: $(CARGO) install --locked mdbook" >&2; exit 1; }
	mdbook build docs

pictures: build ## the pictures of the documentation, by this version; wants chromium-driver (tools/pictures.py)
	@python3 tools/pictures.py

test: ## formatting, lints, docs, unit, property and end-to-end tests
	@python3 tools/setup.py --tests
	@tools/test.sh

lint: setup ## formatting, lints and docs only
	@tools/test.sh lint

bench: build ## measure the evaluation scenes (tools/bench.py; SCENES=FOLDER for real ones)
	@python3 tools/bench.py

hunt: ## plant defects in the service and let the simulator find them (tests/simulation/hunt.py)
	@python3 tests/simulation/hunt.py

gate: ## compare searches and answers with the recorded ones, on the same seeds (lab/record/gate.json)
	$(CARGO) run --locked -p treewright-lab --example gate

integrations: setup ## the SDKs for Python and Node with real packages from PyPI and npm (integrations/)
	@tools/integrations.sh

first-trial: ## lines and seconds to the first trial with each client (tools/first_trial.py)
	@python3 tools/first_trial.py

peers: ## compare the searches with Optuna, SMAC3, Nevergrad, scipy and Kernel Tuner (tests/peers)
	$(CARGO) build --release --locked -p treewright-lab --example ask_tell
	@test -d target/peers/env || python3 -m venv target/peers/env
	@target/peers/env/bin/pip install --quiet --requirement tests/peers/requirements.txt
	@test -d target/peers/kernel || { mkdir -p target/peers/kernel && cd target/peers/kernel && \
		../env/bin/pip download --quiet --no-deps --no-binary :all: autotuning-methodology==1.1.0 && \
		tar xzf *.tar.gz --wildcards --strip-components=5 '*/mockfiles/mock_gpu.json'; }
	@for suite in floor-held-out bbob-held-out grid-held-out grid-told-held-out made-kernels zlib kernel-told bbob bbob-noiseless grid kernel; do \
		target/peers/env/bin/python tests/peers/run.py --suite $$suite --folder target/peers/kernel --out target/peers/$$suite.jsonl || exit 1; done

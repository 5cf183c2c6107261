# make demo | test | check | bench; everything is installed into .venv from constraints.txt
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: help install docs check test test-fast fuzz kill soak demo quick-demo bench results results-tables results-controllers results-engines results-strategies results-ring results-holosoma screenshots clean

help:
	@echo "make demo    train a policy for about three minutes, evaluate it, draw pictures"
	@echo "make test    run the tests"
	@echo "make test-fast  run the tests that need no learning and no browser, in a minute and a half"
	@echo "make check   format, lint, types, import layers, links of the documentation"
	@echo "make docs    build the documentation: build/site/index.html"
	@echo "make bench   measure the speed of every layer"

install: $(READY)

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit("surefoot needs Python 3.11 or newer, this is " + sys.version) if sys.version_info < (3, 11) else 0'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[all,dev]'
	touch $(READY)

check: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# The documentation as a site in build/site, without a network; strict: a link that leads nowhere stops it.
docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "site: build/site/index.html"

test: $(READY)
	$(BIN)/pytest -n 2 -m "not browser"
	$(BIN)/pytest -m browser

# Without the tests that are marked slow: those that learn, open a browser, build a wheel, run commands or whole suites.
test-fast: $(READY)
	$(BIN)/pytest -n 2 -m "not slow"

demo: $(READY)
	$(BIN)/surefoot demo

quick-demo: $(READY)
	$(BIN)/surefoot demo --minutes 0.4 --out runs/quick-demo

bench: $(READY)
	$(BIN)/surefoot bench

# What results/ holds and the README quotes: learning, nine hours on two cores, then the tables.
ALGORITHMS := trpo ppo ddpg
SEEDS := 0 1 2
POLICIES := src/surefoot/agents/shipped
results: $(READY)
	for s in $(SEEDS); do \
	    $(BIN)/surefoot train --algorithm trpo --minutes 27 --seed $$s --run runs/results/trpo-$$s && \
	    $(BIN)/surefoot train --algorithm ppo --minutes 15 --seed $$s --run runs/results/ppo-$$s && \
	    $(BIN)/surefoot train --algorithm ddpg --minutes 5 --seed $$s --run runs/results/ddpg-$$s || exit 1; \
	    for a in $(ALGORITHMS); do \
	        cp runs/results/$$a-$$s/curve.csv results/curves/$$a-$$s.csv; \
	        $(BIN)/surefoot evaluate runs/results/$$a-$$s --results runs/seeds.sqlite \
	            --export-thresholds results/seeds.csv || exit 1; done; done
	$(BIN)/surefoot ablate --export results/ablations/left-out
	for a in $(ALGORITHMS); do \
	    $(BIN)/surefoot train --algorithm $$a --preset complete --run runs/results/complete-$$a || exit 1; done
	for a in $(ALGORITHMS); do \
	    $(BIN)/surefoot select --mean-minutes 10 runs/results/complete-$$a --out $(POLICIES)/$$a.onnx || exit 1; done
	$(MAKE) results-tables

results-tables: $(READY)
	for p in nominal best $(ALGORITHMS); do \
	    $(BIN)/surefoot evaluate $$p --suite paper --directions 16 --results runs/results.sqlite \
	        --json results/evaluate-$$p.json \
	        --export-thresholds results/thresholds.csv || exit 1; done
	$(BIN)/surefoot report runs/results.sqlite --curves results/curves --out runs/report.html --markdown results/report.md
	$(BIN)/surefoot pictures --policy best
	$(MAKE) screenshots
	$(BIN)/surefoot bench --json results/bench.json

# What docs/controllers.md quotes.
CONTROLLERS := stand ankle hip wieber2006a wieber2006b stephens2010 urata2011
results-controllers: $(READY)
	for c in $(CONTROLLERS); do \
	    $(BIN)/surefoot evaluate controllers/$$c --suite paper --results runs/controllers.sqlite \
	        --json runs/controllers-$$c.json \
	        --export-thresholds results/controllers.csv || exit 1; done

# The table that sets robots and policies side by side, hours on two cores; interrupted, it goes on where it was. The
# foreign policies need `pip install --no-deps holosoma-inference==0.1.3`.
RING := runs/ring.sqlite
RUN_RING := $(BIN)/surefoot evaluate --suite ring --results $(RING)
results-ring: $(READY)
	for r in g1 h1; do $(RUN_RING) nominal --robot $$r || exit 1; done
	$(RUN_RING) results/g1/g1-ddpg.onnx
	for c in FastSAC PPO; do $(RUN_RING) examples/holosoma.py:$$c --robot g1_arms --directions 8 || exit 1; done
	$(RUN_RING) best --export-thresholds results/ring.csv
	$(BIN)/surefoot report $(RING) --no-trials --out runs/ring.html --markdown runs/ring.md

# What PyBullet keeps of the thresholds at the root, of the shipped policies and of the classical controllers; PyBullet
# needs about 45 minutes of one core for a policy, and 15 to 40 for a controller.
results-engines: $(READY)
	for p in best $(ALGORITHMS); do for e in mujoco pybullet; do \
	    $(BIN)/surefoot evaluate $$p --engine $$e --results runs/engines.sqlite \
	        --export-thresholds results/engines.csv || exit 1; done; done
	for c in $(CONTROLLERS); do for e in mujoco pybullet; do \
	    $(BIN)/surefoot evaluate controllers/$$c --engine $$e --results runs/engines-controllers.sqlite \
	        --export-thresholds results/engines-controllers.csv || exit 1; done; done
	$(BIN)/surefoot report runs/engines.sqlite runs/engines-controllers.sqlite \
	    --out runs/engines.html --markdown runs/engines.md

# How policies, robots and engines answer pushes, an hour on two cores; surefoot pictures draws it.
STRATEGIES := $(BIN)/surefoot strategies --trials 3 --out results/strategies.csv
results-strategies: $(READY)
	for p in best $(ALGORITHMS) results/g1/g1-ddpg.onnx; do $(STRATEGIES) $$p || exit 1; done
	$(STRATEGIES) ppo --engine pybullet --directions 8
	$(BIN)/surefoot pictures --policy best

# What docs/foreign-policies.md says of friction; needs `pip install --no-deps holosoma-inference==0.1.3`.
results-holosoma: $(READY)
	for c in FastSAC PPO; do \
	    $(BIN)/surefoot evaluate examples/holosoma.py:$$c --robot g1_arms --results runs/holosoma.sqlite \
	        --suite results/holosoma/`echo $$c | tr A-Z a-z`.toml --export results/holosoma/trials.parquet || exit 1; done

# What docs/play.md, docs/report.md and the README show of the live page and the report; needs chromium. The report is
# that of all results, if there is one, or one of the pushes that ppo survives.
screenshots: $(READY)
	test -f runs/report.html || ($(BIN)/surefoot evaluate ppo --results runs/shown.sqlite && \
	    $(BIN)/surefoot report runs/shown.sqlite --curves results/curves --out runs/report.html)
	$(BIN)/python docs/screenshots.py runs/report.html
	$(BIN)/surefoot video ddpg --out docs/pictures/push.gif --impulse 300 --begin -0.3 --end 2.6 --size 480 360 --fps 12.5

# 100,000 damaged files of every format; after an hour it stops, and the same call goes on.
fuzz: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/fuzz.py

# 100 kills of trainings, evaluations and studies at random moments and 30 at chosen writes, an hour at most.
kill: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/kill.py

# 50 viewers of the live page for two hours, and its memory.
soak: $(READY)
	PYTHONPATH=tests $(BIN)/python tests/soak.py

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache

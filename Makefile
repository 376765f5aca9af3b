# One command per job. Everything runs from .venv, which is built from the lock files.
# The newest interpreter of this machine that pyproject.toml allows; PYTHON=... names another.
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import ensurepip, sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null && echo $$p && break; done)
VENV   := .venv
BIN    := $(VENV)/bin
JOBS   ?=
LOOPS   := $(patsubst studies/loops/%.toml,loop-%,$(filter-out %/semitrailer.toml,$(wildcard studies/loops/*.toml)))
IDENTIFY := $(patsubst studies/identify/%.toml,study-identify-%,$(wildcard studies/identify/*.toml))
NOTEBOOKS := $(patsubst docs/%,build/%,$(wildcard docs/notebooks/*.ipynb))
STUDIES := $(patsubst studies/%.toml,study-%,$(wildcard studies/*.toml))
RECORDED := $(patsubst studies/%.toml,study-%,$(shell grep -ls 'kind *= *"from_file"' studies/*.toml))

# A worker keeps what it has compiled: in three parts it takes half the memory.
TESTS_1 := tests/diagnosis tests/identification tests/bench tests/recordings
TESTS_2 := tests/study tests/recorded tests/remedy tests/realtime
TESTS_3 := $(filter-out $(TESTS_1) $(TESTS_2),$(patsubst %/,%,$(wildcard tests/*/ tests/test_*.py)))

.DEFAULT_GOAL := help
.PHONY: help setup studies loop $(LOOPS) report test test-view proof wheel lint attribution attribution-docs foreign sensitivity check-proof tuning-proof fuzz mutation faults audit endurance scale short-runs bench lock clean study-narx-architecture study-realtime study-identify-swarm study-identify-em reproduce-box reproduce-nearest reproduce notebooks docs $(IDENTIFY) $(STUDIES)

help:            ## show the targets
	@echo "study-<name>              run studies/<name>.toml, write results/<name>/report.html and .pdf;"
	@echo "                          there are: $(STUDIES)"
	@echo "loop-<name>               trace what a model lacks in measured drives: $(LOOPS)"
	@echo "study-identify-<name>     parameters of a car from measured drives (Sun 3.3): $(IDENTIFY)"
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 26

$(VENV)/run.stamp: requirements.lock pyproject.toml reproductions/pyproject.toml
	@test -x $(BIN)/python || test -n "$(PYTHON)" || { echo "there is no Python 3.11 to 3.14 here; install one, or name it: make PYTHON=..." >&2; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --progress-bar off -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e . -e ./reproductions
	@touch $@

$(VENV)/dev.stamp: $(VENV)/run.stamp requirements-dev.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --progress-bar off -r requirements-dev.lock
	@touch $@

$(VENV)/docs.stamp: $(VENV)/dev.stamp requirements-docs.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --progress-bar off -r requirements-docs.lock
	@touch $@

$(VENV)/peers.stamp: $(VENV)/dev.stamp requirements-bench.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --progress-bar off -r requirements-bench.lock
	@touch $@

setup: $(VENV)/run.stamp ## create .venv with pinned packages

# One target for every file in studies/: `make study-mass` runs studies/mass.toml.
$(STUDIES): study-%: studies/%.toml $(VENV)/run.stamp
	$(BIN)/harness run $< $(if $(JOBS),--jobs $(JOBS)) --out results/$*

study-narx-architecture: $(VENV)/run.stamp ## choose delays and size of the NARX network (20 minutes), as Ziaukas 5.2.2
	$(BIN)/python -m reproductions.narx_architecture --out results/narx-architecture

study-identify-swarm: $(VENV)/run.stamp ## find the semitrailer's parameters by swarm, REPEATS=10 times (Ziaukas 4.2, 4.3)
	$(BIN)/python -m reproductions.ziaukas_swarm $(if $(REPEATS),--repeats $(REPEATS)) $(if $(JOBS),--jobs $(JOBS)) --out results/identify-swarm

study-identify-em: $(VENV)/run.stamp ## find a car's parameters by EM with particles, REPEATS=50 times (Sun 3.2)
	$(BIN)/python -m reproductions.sun_em $(if $(REPEATS),--repeats $(REPEATS)) $(if $(JOBS),--jobs $(JOBS)) --out results/identify-em

# One target for every file in studies/identify/: cars identified from measured drives, which are not part of the project.
$(IDENTIFY): study-identify-%: studies/identify/%.toml $(VENV)/run.stamp
	$(BIN)/python -m reproductions.identify_measured $< $(if $(JOBS),--jobs $(JOBS)) --out results/identify-$*

reproduce-box: $(VENV)/run.stamp ## which findings of Ziaukas 2023 survive what it does not publish (an hour; goes on where it stopped)
	$(BIN)/python -m reproductions.box $(if $(JOBS),--jobs $(JOBS)) --out results/reproduce-box --page docs/tables/unpublished.md

reproduce-nearest: $(VENV)/run.stamp ## the studies of Ziaukas 2023 at the nearest point of that box, with both networks (a minute)
	$(BIN)/python -m reproductions.box.nearest $(if $(JOBS),--jobs $(JOBS)) --out results/reproduce-nearest --page docs/tables/unpublished.md

study-realtime: $(VENV)/run.stamp ## time per step of each estimator against the 10 ms cycle, as Ziaukas Bild 6.9
	$(BIN)/harness realtime studies/mass.toml --drive fast-sine --out results/realtime

loop: $(VENV)/run.stamp ## trace an effect that nobody declared, then open the seal (SEED=... draws it again)
	$(BIN)/python -m bench.demonstration $(if $(SEED),--seed $(SEED))

# One target for every other file in studies/loops/: measured drives, which are not part of the project.
$(LOOPS): loop-%: studies/loops/%.toml $(VENV)/run.stamp
	$(BIN)/harness trace $< $(if $(JOBS),--jobs $(JOBS)) --out results/loop-$*

study-%:
	@echo "there is no studies/$*.toml; there are: $(STUDIES)" >&2; exit 2

studies: $(filter-out $(RECORDED),$(STUDIES)) study-realtime ## run every study that needs no recording, gather them in results/campaign/report.html and .pdf
	$(BIN)/harness campaign results --out results/campaign

reproduce: $(VENV)/run.stamp ## renew docs/tables/reproduction.md: every published number beside ours, from the results that are there
	$(BIN)/python -m reproductions.reproduce --results results --out results/reproduction

report: $(VENV)/run.stamp ## rewrite the reports of all finished studies
	@for d in results/*/scores.zarr; do [ -e "$$d" ] || continue; $(BIN)/harness report $$(dirname $$d) || exit 1; done

test: $(VENV)/dev.stamp ## run the tests
	failed=; for part in "$(TESTS_1)" "$(TESTS_2)" "$(TESTS_3)"; do \
		$(BIN)/python -m pytest --numprocesses auto --dist loadfile -m "not proof and not wheel and not notebooks and not browser" $$part || failed=1; \
	done; test -z "$$failed"

test-view: $(VENV)/dev.stamp ## run the tests of harness view in a browser (needs Chromium on the PATH)
	$(BIN)/python -m pytest -m browser tests/view

proof: $(VENV)/dev.stamp ## run the tests that take long: the cluster, the blind plant, a trace from end to end
	$(BIN)/python -m pytest --numprocesses auto --dist loadfile -m proof

wheel: $(VENV)/dev.stamp ## build sdist and wheel, install the wheel in a fresh environment, try it in an empty folder
	$(BIN)/python -m pytest -m wheel tests/package

notebooks: $(VENV)/docs.stamp ## run the notebooks of the tutorial, and the commands that README and docs show
	$(BIN)/python -m pytest --numprocesses auto -m notebooks tests/package

# What `make notebooks` has run already is not run again.
build/notebooks/%.ipynb: docs/notebooks/%.ipynb $(VENV)/docs.stamp $(shell find -L harness -name '*.py' -o -name '*.toml')
	$(BIN)/python -m bench.notebooks $< $@

docs: $(VENV)/docs.stamp $(NOTEBOOKS) ## write the documentation as a site to site/, strictly, with notebooks run and pictures renewed
	PYTHONPATH=tests $(BIN)/python -m bench.gallery docs
	rm -rf build/docs && cp -R docs build/docs && cp $(NOTEBOOKS) build/docs/notebooks
	$(BIN)/python -m bench.reference build/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

lint: $(VENV)/dev.stamp ## ruff, mypy and the rule of imports
	$(BIN)/ruff check .
	$(BIN)/ruff check --quiet --preview --select PLW1514 . # text files are UTF-8 wherever they are written
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

attribution: $(VENV)/dev.stamp ## trace the blind plant's cases and score what was named (hours; CASES="...", VEHICLE, MAGNITUDE, QUALITY=field, bus or real, REPEATS, FIRST, JOBS; GATE=274: cases at random, of these KIND=effect)
	$(BIN)/python -m bench.attribution $(if $(CASES),--cases $(CASES)) $(if $(VEHICLE),--vehicle $(VEHICLE)) $(if $(MAGNITUDE),--magnitude $(MAGNITUDE)) $(if $(QUALITY),--quality $(QUALITY)) $(if $(REPEATS),--repeats $(REPEATS)) $(if $(FIRST),--first $(FIRST)) $(if $(GATE),--gate $(GATE)) $(if $(KIND),--kind $(KIND)) $(if $(JOBS),--jobs $(JOBS))

attribution-docs: $(VENV)/dev.stamp ## renew tables and figures of docs/tables/attribution.md from results/attribution
	$(BIN)/python -m bench.attribution.renew results/attribution$(if $(QUALITY),-$(QUALITY))/attribution.json

foreign: $(VENV)/dev.stamp ## trace twelve cases of a second plant, which shares no code with the first, and score them (hours; CASES="a h", JOBS)
	$(BIN)/python -m bench.foreign $(if $(CASES),--cases $(CASES)) $(if $(JOBS),--jobs $(JOBS))

sensitivity: $(VENV)/dev.stamp ## trace some of them with each number of the criteria halved and doubled (half an hour; CASES, NUMBERS, FIRST, QUALITY; it continues where it stopped; PAGE=1: tables into docs/tables/attribution.md)
	$(BIN)/python -m bench.attribution.sensitivity$(if $(PAGE), --page) $(if $(CASES),--cases $(CASES)) $(if $(NUMBERS),--numbers $(NUMBERS)) $(if $(FIRST),--first $(FIRST)) $(if $(QUALITY),--quality $(QUALITY))

check-proof: $(VENV)/dev.stamp ## plant faults in recordings and count what harness check names and mends (SEEDS=1000:1010, FOREIGN=1000:1050)
	$(BIN)/python -m bench.recording_faults $(if $(SEEDS),--seeds $(SEEDS)) $(if $(FOREIGN),--foreign $(FOREIGN)) $(if $(JOBS),--jobs $(JOBS)) --out results/check-proof

tuning-proof: $(VENV)/dev.stamp ## count how often the intervals of harness tune --data hold the true noise (SETS=18, CASES=semitrailer); goes on where it stopped
	$(BIN)/python -m bench.tuning $(if $(SETS),--sets $(SETS)) $(if $(CASES),--cases $(CASES)) --out results/tuning-proof/variances.jsonl

fuzz: $(VENV)/dev.stamp ## read INPUTS=100000 broken files of every kind; each is read or refused in words (exit status 1 if not)
	PYTHONPATH=tests $(BIN)/python -m bench.fuzz $(if $(INPUTS),--inputs $(INPUTS)) $(if $(SEED),--seed $(SEED)) --out results/fuzz

mutation: $(VENV)/dev.stamp ## change the numeric code in COUNT=100 places, one at a time, and count which a test sees (an hour; SEED)
	$(BIN)/python -m bench.mutation $(if $(COUNT),--count $(COUNT)) $(if $(SEED),--seed $(SEED)) $(if $(JOBS),--jobs $(JOBS))

faults: $(VENV)/dev.stamp ## kill, fill, cut, flip, suspend and compare the bits: the long form (half an hour; SEED=...)
	PYTHONPATH=tests $(BIN)/python -m bench.faults --out results/faults $(if $(SEED),--seed $(SEED))

audit: $(VENV)/docs.stamp ## are the pins of the locks installed, whole, complete, their licences known? (ADVISORIES=folder: any weak?)
	$(BIN)/python -m bench.supply $(if $(ADVISORIES),--advisories $(ADVISORIES))

scale: $(VENV)/dev.stamp ## report of a store of RUNS=10000000 runs: time and memory
	$(BIN)/python -m bench.scale $(if $(RUNS),--runs $(RUNS)) --out results/scale

short-runs: $(VENV)/dev.stamp ## compute RUNS=1000000 short runs, once more, and killed half-way; then Dask against threads
	$(BIN)/python -m bench.scale --run --runs $(or $(RUNS),1000000) --out results/short-runs
	$(BIN)/python -m bench.scale --dask --runs $(or $(RUNS),200000) --out results/short-runs-dask

endurance: $(VENV)/dev.stamp ## run Kalman-type filters for HOURS=24 of simulated time and look at their covariances
	$(BIN)/python -m bench.endurance $(if $(HOURS),--hours $(HOURS))

bench: $(VENV)/$(if $(PEERS),peers,dev).stamp ## print the speed table (PEERS=1: other libraries on the same problem; DEVICE=cuda: on a graphics card; both: JAX there)
	$(if $(DEVICE),$(BIN)/python -m pip install -q -e '.[cuda]' $(if $(PEERS),'jax[cuda13]'))
	$(BIN)/python -m bench$(if $(DEVICE),.card$(if $(PEERS), --jax),$(if $(PEERS),.peers))

lock: ## renew the lock files from pyproject.toml (needs uv)
	uv pip compile -q --python-version 3.11 --no-header --no-annotate --no-emit-index-url --upgrade pyproject.toml requirements-build.in -o requirements.lock
	uv pip compile -q --python-version 3.11 --no-header --no-annotate --no-emit-index-url --extra dev -c requirements.lock pyproject.toml -o requirements-dev.lock
	uv pip compile -q --python-version 3.11 --no-header --no-annotate --no-emit-index-url --extra dev --extra docs -c requirements-dev.lock pyproject.toml -o requirements-docs.lock
	uv pip compile -q --python-version 3.11 --no-header --no-annotate --no-emit-index-url --extra dev --extra bench -c requirements-dev.lock pyproject.toml -o requirements-bench.lock

clean: ## remove results and caches (keeps .venv)
	find results -mindepth 1 ! -name README.md -delete
	rm -rf .pytest_cache .mypy_cache .ruff_cache
	-$(BIN)/harness cache --clear

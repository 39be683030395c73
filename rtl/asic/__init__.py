"""The accelerator in the cells of a chip's process: Liberty files, netlist, area, timing."""

"""The eskin accelerator in Amaranth HDL, one component a file."""

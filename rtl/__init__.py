"""The eskin accelerator in Amaranth HDL, one component a file."""

if __name__ != "eskin.rtl":  # the checkout's top folder may be on the path: a module has one name
    raise ImportError("import eskin.rtl: as rtl its modules would be loaded a second time")

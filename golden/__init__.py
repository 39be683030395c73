"""Golden model of eskin: what every stage of the hardware must compute, bit for bit."""

if __name__ != "eskin.golden":  # the checkout's top folder may be on the path: a module has one name
    raise ImportError("import eskin.golden: as golden its modules would be loaded a second time")

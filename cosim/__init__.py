"""Co-simulation: runner, benches, scoreboard, latency report."""

if __name__ != "eskin.cosim":  # the checkout's top folder may be on the path: a module has one name
    raise ImportError("import eskin.cosim: as cosim its modules would be loaded a second time")

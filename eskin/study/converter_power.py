"""Power of a converter by its data sheet: beside the chain's estimate, never in its sum."""

from eskin.golden.core import AcceleratorConfig, Record, converter_plan


def converter_power(config: AcceleratorConfig) -> Record | None:
    """Highest power of the converter while it runs all the time; None without a converter.

    Returns
    -------
    dict
        converter, chips, power_w (None: no figure at hand), scanning_w (the same, were it to take nothing between
        scans), per_touch_j (of the touch's frames; both None likewise), rests_on (words).
    """
    converter, power, scanning, energy = config.interface.converter, None, None, None
    if converter.name == "none":
        return None
    plan, words = converter_plan(config), "no figure of its data sheet at hand"
    if converter.watt is not None:
        power = plan.chips * converter.watt
        scanning = power * plan.scan_cycles / config.hardware.clock_hz * config.sensor.scan_rate_hz
        energy = power * config.touch_s
        words = f"{converter.stated}; never idle, so an upper figure at this rate; not measured"
    figures = {"power_w": power, "scanning_w": scanning, "per_touch_j": energy, "rests_on": words}
    return {"converter": converter.name, "chips": plan.chips, **figures}


def in_words(power: Record) -> str:
    """A row of a table."""
    if power["power_w"] is None:
        return f"{power['converter']}: {power['rests_on']}"
    many = f"{power['chips']} chips, " if power["chips"] > 1 else ""
    asleep = f"{1e3 * power['scanning_w']:.3g} mW if it sleeps between scans"
    figures = (
        f"{1e3 * power['power_w']:.3g} mW at most, {asleep}, {1e3 * power['per_touch_j']:.3g} mJ a touch"
    )
    return f"{figures} ({many}{power['rests_on']}); in no other figure"

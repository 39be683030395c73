"""Golden model of eskin: what every stage of the hardware must compute, bit for bit."""

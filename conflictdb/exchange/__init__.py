"""Formats of other systems: NOTAM, AIXM, OpenAir, S-124, S-421, ASTM F3548 and ED-269/318; the core imports none."""

"""The most memory that a program has had."""

# The end of a program in Python: it prints its peak, bytes. From its own status: ru_maxrss includes the size of the
# process before it executed this program, that of the test run.
PRINT_PEAK = """
import pathlib
(peak,) = (line for line in pathlib.Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:"))
print(int(peak.split()[1]) * 1024)
"""

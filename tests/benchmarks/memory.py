"""The most memory that a process takes, in megabytes (10^6 bytes). Not on Windows."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

MEGABYTES = (1 if sys.platform == "darwin" else 1024) / 1e6  # in a unit of ru_maxrss

# Linux counts what the process that starts another had in memory; this one is small.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def peak() -> float:
    """What this process has taken at most."""
    import resource  # which Windows lacks

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * MEGABYTES


def peak_of_estimate(*arguments: str | Path) -> float:
    """What `mpsnet estimate` takes at most."""
    command: Sequence[str | Path] = [sys.executable, "-c", PEAK, sys.executable, "-m", "mpsnet_core", "estimate"]
    done = subprocess.run([*command, *arguments], check=True, capture_output=True, text=True)
    return int(done.stdout) * MEGABYTES

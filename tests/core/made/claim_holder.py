"""A process that holds a claim."""

import subprocess

HOLD = """
import sys
from mpsnet_core.io.claims import Claims

with Claims(sys.argv[1]) as claims, claims.claim(int(sys.argv[2])) as ours:
    print(ours, flush=True)
    sys.stdin.read()
"""


def has_it(child: "subprocess.Popen[str]") -> bool:
    assert child.stdout is not None
    return {"True\n": True, "False\n": False}[child.stdout.readline()]

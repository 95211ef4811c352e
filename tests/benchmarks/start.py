"""How long `import mpsnet_core` and the command line's help take, beyond what Python itself takes to start.

python tests/benchmarks/start.py [--rounds 9]

Processor time, which tells more where other programs run; modules are compiled before, as an installation has them.
Not on Windows, which tells no processor time of a child.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile

CASES = {
    "import mpsnet_core": ("-c", "import mpsnet_core"),
    "mpsnet --help": ("-m", "mpsnet_core", "--help"),
    "mpsnet estimate --help": ("-m", "mpsnet_core", "estimate", "--help"),
}


def spent(arguments: tuple[str, ...], environment: dict[str, str]) -> float:
    """Seconds of processor of a Python with these arguments."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    seconds: dict[str, list[float]] = {name: [] for name in CASES}
    with tempfile.TemporaryDirectory() as compiled:
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": compiled}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        for number in range(rounds + 1):
            plain = spent(("-c", "pass"), environment)
            for name, arguments in CASES.items():
                took = spent(arguments, environment) - plain
                if number:
                    seconds[name].append(took)
    for name, times in seconds.items():
        print(f"{name}: {1e3 * statistics.median(times):.0f} ms of processor more than Python alone")


if __name__ == "__main__":
    main()

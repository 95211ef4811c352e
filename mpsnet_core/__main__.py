"""``python -m mpsnet_core`` is the command line ``mpsnet``."""

import sys

from mpsnet_core.cli import main

sys.exit(main())

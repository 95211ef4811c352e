"""What is too large for the repository: in the folder that MPSNET_TEST_DATA names, where there is one."""

import os
from pathlib import Path

import pytest


def external_data(place: str) -> Path:
    """A file or folder of it; without it the test is skipped."""
    path = Path(os.environ.get("MPSNET_TEST_DATA", ""), place)
    if "MPSNET_TEST_DATA" not in os.environ or not path.exists():
        pytest.skip(f"MPSNET_TEST_DATA does not name a folder with {place}")
    return path

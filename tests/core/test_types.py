"""What type checkers know of the package's public names.

mypy reads this file too (pyproject.toml, tool.mypy): where it knows less, it reports the comment as needless.
"""

import pytest

from mpsnet_core import Estimate


def test_a_name_that_an_operation_does_not_take_is_refused() -> None:
    with pytest.raises(TypeError, match="typo"):
        Estimate(image=("photo.png",), rig="rig.json", output="normals.png", typo=3)  # type: ignore[call-arg]

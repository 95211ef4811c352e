"""The examples in docstrings do what they say."""

import doctest
import importlib
import pkgutil
import re

import pytest

import mpsnet_core
from mpsnet_core.errors import SettingsError

MODULES = [found.name for found in pkgutil.walk_packages(mpsnet_core.__path__, "mpsnet_core.", lambda _: None)]


def test_examples_are_true():
    tried = 0
    for name in MODULES:
        if name.endswith("__main__"):
            continue
        try:
            module = importlib.import_module(name)
        except (ImportError, SettingsError):  # for want of an extra
            continue
        found = doctest.testmod(module)
        assert found.failed == 0, name
        tried += found.attempted
    assert tried > 50


@pytest.mark.parametrize("name", sorted(mpsnet_core.__all__))
def test_what_the_package_offers_has_a_docstring(name: str):
    offered = getattr(mpsnet_core, name)
    assert not callable(offered) or (offered.__doc__ or "").strip()


@pytest.mark.parametrize("name", sorted(mpsnet_core.__all__))
def test_sections_of_docstrings_have_a_line_of_their_own(name: str):
    assert not re.search(r"\w+ -{3,} \w", getattr(mpsnet_core, name).__doc__ or "")

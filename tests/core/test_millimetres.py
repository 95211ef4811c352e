"""Lengths as people write them."""

import pytest

from mpsnet_core.errors import InputError
from mpsnet_core.relief.material.material_files import millimetres


@pytest.mark.parametrize(
    ("text", "expected"),
    [("120mm", 120), ("12 cm", 120), ("0.12m", 120), (".12M", 120), ("4in", 101.6), (" 1e-1 mm ", 0.1)],
)
def test_a_number_and_its_unit_is_a_length(text, expected):
    assert millimetres(text) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("120", "'120' is not a length; give a number and its unit (mm, cm, m, in), for instance 120mm"),
        ("-3mm", "'-3mm' is not a length"),
        ("1,5mm", "'1,5mm' is not a length"),
        ("0mm", "0mm is not a length that can be photographed"),
        ("1e9m", "1e9m is not a length that can be photographed"),
    ],
)
def test_what_is_no_length_is_reported(text, words):
    with pytest.raises(InputError) as caught:
        millimetres(text)
    assert str(caught.value).startswith(words)

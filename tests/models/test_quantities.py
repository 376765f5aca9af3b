"""Quantities in words."""

import pytest

from harness.models.quantities import listed


@pytest.mark.parametrize(
    ("parts", "text"),
    [([], "nothing"), (["mass"], "mass"), (["mass", "load"], "mass and load"), (["a", "b", "c"], "a, b and c")],
)
def test_parts_are_listed_in_words_however_few_they_are(parts, text):
    assert listed(parts) == text

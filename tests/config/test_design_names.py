"""Designs are folders of a store: their names are none of its files, and differ in more than case."""

import pytest


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Checksums", "'Checksums' is where the store keeps those of its files"),
        ("zarr.json", "'zarr.json' is where the store keeps what it is"),
        ("Level", "'Level' is the name of design[0] already"),
    ],
)
def test_a_name_that_the_store_has_is_refused(refused, name, expected):
    lines = refused(append=f'[[design]]\nname = "{name}"\n')
    assert any(line.startswith(f"design[1].name: {expected}") for line in lines), lines

"""The peers' problem: the filters in extended precision against ours, and every installed library against them."""

import importlib

import numpy as np
import pytest

from bench.peers import ours, reference
from bench.peers.problem import NUMPY, driven, equations, problem

SAMPLES = 60


@pytest.fixture(scope="module")
def given():
    return {kind: problem(kind, SAMPLES, 2) for kind in ("ekf", "ukf")}


@pytest.fixture(scope="module")
def exact(given):
    if np.finfo(np.longdouble).nmant < 63:
        pytest.skip("no extended precision on this processor")
    return {kind: reference.extended(kind, p) for kind, p in given.items()}


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_our_filters_err_by_rounding_only(kind, given, exact):
    assert np.abs(exact[kind]).max(axis=0).all()  # every state moves
    assert 0 < reference.error(ours.means(given[kind]), exact[kind]) < 1e-12


def test_the_error_is_a_share_of_the_size_of_each_state():
    exact = np.array([[1.0, 0.0, 200.0], [-4.0, 0.0, 100.0]])
    for off, share in (([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]], 1 / 200), ([[0.0, 5.0, 1.0], [1.0, 0.0, 0.0]], 1 / 4)):
        assert reference.error(exact + np.array(off), exact) == pytest.approx(share)


def test_the_equations_over_other_numbers_are_those_of_the_kernels(given):
    """A step of the plant from a moving state, in double and in extended precision."""
    plant = driven(given["ekf"])
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=plant.compiled.nx) * 1e-2, plant.inputs[30]
    plain = equations(plant, NUMPY).ahead(x, u).astype(float)
    wide = equations(plant, NUMPY, np.longdouble).ahead(x.astype(np.longdouble), u.astype(np.longdouble)).astype(float)
    lanes = [np.repeat(v[:, None], 8, axis=1) for v in (x, u)]
    after, work = np.zeros((plant.compiled.nx, 8)), np.zeros((plant.compiled.nw, 8))
    plant.compiled.kernels.next_state(*lanes, np.repeat(plant.constants, 8, axis=1), after, work)
    np.testing.assert_allclose(plain, after[:, 0], rtol=1e-12)
    np.testing.assert_allclose(wide, plain, rtol=1e-12)


@pytest.mark.parametrize(
    ("library", "module", "name", "kind", "accuracy"),
    [
        ("dynamax", "jax_filters", "dynamax", "ekf", 1e-4),  # it adds 1e-9 to a diagonal before it solves
        ("dynamax", "jax_filters", "dynamax", "ukf", 1e-4),
        ("cuthbert", "jax_filters", "cuthbert", "ekf", 1e-12),
        ("stonesoup", "stone_soup", "unscented", "ukf", 1e-12),
        ("filterpy", "filterpy_filter", "unscented", "ukf", 1e-12),
    ],
)
def test_every_library_solves_the_same_problem(library, module, name, kind, accuracy, given, exact):
    pytest.importorskip(library, reason="only `make bench PEERS=1` installs the other libraries")
    peers = importlib.import_module(f"bench.peers.{module}")
    made = getattr(peers, name)
    means = (
        peers.filtering(made(kind, given[kind]), given[kind])[1]() if module == "jax_filters" else made(given[kind])()
    )
    assert reference.error(means, exact[kind]) < accuracy

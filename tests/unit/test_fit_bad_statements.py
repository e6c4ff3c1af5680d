"""What is wrong in the statements with FRFs, in the pole table or in what is asked for: one clear sentence."""

from dataclasses import replace

import numpy as np
import pytest

from ema.dof import Dof
from ema.errors import InputError
from ema.fit import modes, stabilise
from ema.fit.modal import _named_frequencies, _named_rows
from tests.unit.fit_rig import frfs, model


@pytest.fixture(scope="module")
def good():
    return frfs(model([120.0, 150.0], [0.004, 0.006], dofs=5, drive=(0, 3)), 100, 180, 201, noise=0.005)


@pytest.fixture(scope="module")
def table(good):
    return stabilise(good, range(4, 25, 4))


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        (lambda _: {"added_decay": -5.0}, "decay that the exponential window added is no decay; got -5 1/s"),
        (lambda _: {"added_decay": float("nan")}, "is no decay; got nan 1/s"),
        (lambda _: {"record_length": -1.0, "window": "rectangular"}, "record length is no length; got -1 s"),
        (lambda good: {"effective_lines": np.zeros(len(good.frequencies))}, "is not positive; got 0"),
    ],
    ids=["decay", "no number", "length", "lines"],
)
def test_statements_that_cannot_be(good, table, statement, said):
    stated = replace(good, **statement(good))
    for fit in (stabilise, lambda measured: modes(measured, table)):
        with pytest.raises(InputError, match=said):
            fit(stated)


def test_a_negative_variance_of_a_line_takes_the_median_of_its_frf(good):
    variance = np.full(good.values.shape, 1e-6)
    usual = replace(good, variance=variance.copy())
    variance[100, 2, 1] = -1
    one, other = (modes(each, stabilise(each, range(4, 25, 4))) for each in (usual, replace(good, variance=variance)))
    np.testing.assert_allclose(other.natural_frequencies, one.natural_frequencies, rtol=1e-6)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=0.01)


def test_a_pole_table_of_other_references(good, table):
    other = replace(good, inputs=(Dof(8, "+Z"), Dof(9, "+Z")))
    for measured in (other, good.pick(inputs=[0])):
        with pytest.raises(InputError, match="the pole table is not that of these FRFs"):
            modes(measured, table)


@pytest.mark.parametrize("near", [[], ["120"], "120", [[120.0]]])
def test_frequencies_that_are_none(near):
    with pytest.raises(InputError, match="near names no frequencies"):
        _named_frequencies(near)


@pytest.mark.parametrize("index", [[], [3.5], ["3"]])
def test_rows_that_are_none(index):
    with pytest.raises(InputError, match="index names no rows of the pole table"):
        _named_rows(index)


def test_nothing_that_is_named_is_refused_before_a_fit(good, table):
    with pytest.raises(InputError, match="near names no frequencies"):
        modes(good, table, near=[])
    with pytest.raises(InputError, match="index names no rows"):
        modes(good, table, index=[])


def test_a_single_number_names_one_mode(good, table):
    near = modes(good, table, near=150.0)
    np.testing.assert_allclose(near.natural_frequencies, [150.0], rtol=1e-3)
    row = int(np.argmin(np.abs(table.poles - near.poles[0])))
    np.testing.assert_array_equal(modes(good, table, index=row).poles, near.poles)

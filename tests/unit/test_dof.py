"""DOFs are read as test engineers write them and survive the universal file's codes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.dof import DIRECTIONS, Dof, match
from ema.errors import InputError

dofs = st.builds(Dof, st.integers(0, 10**9), st.sampled_from(DIRECTIONS), st.sampled_from(["", "table", "beam 2"]))


@given(dofs)
def test_text_and_uff_round_trip(dof):
    assert Dof.parse(str(dof)) == dof
    assert Dof.from_uff(dof.node, dof.uff_direction, dof.part) == dof


@pytest.mark.parametrize(
    "text, expected",
    [
        ("12Z", "12:+Z"),
        ("12+Z", "12:+Z"),
        ("12:-z", "12:-Z"),
        ("table:12:+Z", "table:12:+Z"),
        ("7", "7:S"),
        (" 3 : -RX ", "3:-RX"),
    ],
)
def test_the_ways_people_write_dofs(text, expected):
    assert str(Dof.parse(text)) == expected


@pytest.mark.parametrize("text", ["", "Z", "12:+W", "1.5Z", "12:+Z/5:-Z"])
def test_text_that_is_no_dof(text):
    with pytest.raises(InputError, match="not a DOF"):
        Dof.parse(text)


def test_match_carries_the_sign():
    wanted = [Dof(1, "+Z"), Dof(2, "-Z"), Dof(9, "+X")]
    present = [Dof(2, "+Z"), Dof(1, "-Z")]
    assert match(wanted, present) == [(0, 1, -1), (1, 0, -1)]

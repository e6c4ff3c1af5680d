"""The check of types and shapes in the test run: what it refuses is what ``jaxtyping.jaxtyped`` refuses."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import numpy as np
import pytest
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float, TypeCheckError

from ema.data.frf import FrfSet
from ema.synthesis import frfs as synthesised
from tests.checked_types import checked, original


def by_jaxtyping(target):
    return original(target, typechecker=beartype(conf=BeartypeConf(is_pep484_tower=True)))


Vector = Float[np.ndarray, "n"]
TWO, THREE = np.zeros(2), np.zeros(3)


@pytest.fixture(params=[checked, by_jaxtyping])
def check(request):
    return request.param


def refused(call, *given, **named):
    with pytest.raises((BeartypeCallHintViolation, TypeCheckError)):
        call(*given, **named)


def test_types_of_parameters_and_of_the_result(check):
    @check
    def half(number: float, *more: int, name: str = "", **rest: "int") -> float:
        return name or number / 2 if not rest else number / 2

    assert half(1) == 0.5 and half(1.0, 2, 3, other=4) == 0.5
    for given, named in (("1",), {}), ((1.0, 2.5), {}), ((1.0,), {"name": 2}), ((1.0,), {"other": "4"}):
        refused(half, *given, **named)
    refused(half, 1.0, name="no number")


def test_axes_of_one_name_have_one_length_within_a_call_and_not_beyond_it(check):
    @check
    def added(one: Vector, other: Vector | None = None) -> Vector:
        return one if other is None else one + other

    @check
    def outer(one: Vector) -> "Float[np.ndarray, '2 n']":
        assert len(added(THREE)) == 3, "the call within has axes of its own"
        return np.stack([one, one])

    assert len(added(TWO, TWO)) == 2 and len(added(THREE)) == 3
    assert outer(TWO).shape == (2, 2)
    refused(added, TWO, THREE)
    refused(added, TWO.astype(int))
    refused(added, [1.0, 2.0])


def test_axes_of_the_result_are_those_of_the_parameters(check):
    @check
    def longer(values: list[Vector]) -> Vector:
        return np.append(values[0], 0.0)

    refused(longer, [TWO])


def test_names_that_a_string_stands_for_or_that_do_not_exist(check):
    @check
    def of(values: "list[Float[np.ndarray, 'n']]", unknown: "Nowhere") -> "Vector":
        return values[0]

    assert len(of([TWO], object())) == 2
    refused(of, ["two"], 1)


def test_inner_functions_are_each_their_own(check):
    """Defined twice, called within each other, with names of the outer one, defaults that differ, and an error between."""

    def making(scale, default, kind=float):
        @check
        def scaled(values: Vector, within=None, *, factor: kind = default) -> Vector:
            if within is not None:
                values = within(values)
            return factor * scale * values

        return scaled

    double, triple = making(2.0, 1.0), making(3.0, 10.0)
    assert double(np.ones(2), triple).tolist() == [60.0, 60.0]
    refused(double, TWO, lambda _: THREE)
    refused(triple, TWO, lambda _: 1.0)
    refused(triple, TWO, factor="2")
    with pytest.raises(ZeroDivisionError):
        double(TWO, lambda values: triple(values, lambda _: 1 / 0))
    assert triple(np.ones(1)).tolist() == [30.0]
    named = making(np.ones(1), "2", str)
    refused(named, TWO, factor=2.0)


def test_data_classes_and_methods(check):
    @check
    @dataclass(frozen=True, kw_only=True)
    class Pair:
        one: Vector
        other: Vector
        names: list = field(default_factory=list)

        @classmethod
        @check
        def of(cls, one: Vector) -> "Pair":
            return cls(one=one, other=one)

        @property
        @check
        def length(self) -> int:
            return self.names[0] if self.names else len(self.one)

        @staticmethod
        @check
        def twice(number: int) -> int:
            return 2 * number

    assert Pair.of(TWO).length == 2 and Pair.twice(2) == 4
    refused(Pair, one=TWO, other=THREE)
    refused(Pair.of, 2)
    refused(Pair.twice, "2")
    refused(lambda: Pair(one=TWO, other=TWO, names=["a"]).length)


def test_a_generator_is_one(check):
    @check
    def counted(values: Vector) -> Iterator[int]:
        yield from range(len(values))

    assert list(counted(TWO)) == [0, 1]
    refused(counted, [0.0])


def test_functions_and_containers_of_the_package_are_checked():
    refused(synthesised, "model", np.arange(3.0))
    given = {each.name: None for each in fields(FrfSet) if each.init}
    refused(FrfSet, **given)

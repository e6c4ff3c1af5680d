"""The check of types and shapes in the test run: what it refuses is what ``jaxtyping.jaxtyped`` refuses."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields

import numpy as np
import pytest
from beartype import BeartypeConf, beartype
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import AnnotationError, Bool, Complex, Float, Inexact, Int, Shaped, TypeCheckError, _storage

from ema.data.frf import FrfSet
from ema.data.stored_signals import StoredSignals
from ema.synthesis import frfs as synthesised
from tests.checked_types import EVERY, FIRST, _alike, _made, checked, fits, next_test, original


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


def test_the_check_of_an_inner_function_is_made_once():
    """A hint of an array is another class whenever its function is defined: two of one text are one hint."""

    def making(kind):
        @checked
        def scaled(values: Float[np.ndarray, "n"], factor: kind = 2) -> list[Float[np.ndarray, "n"]]:
            return [factor * values]

        return scaled

    first = making(float)
    (code,) = [one for one in _made if one.co_qualname.endswith("made_once.<locals>.making.<locals>.scaled")]
    check = _made[code][1]
    second = making(float)
    assert _made[code][1] is check and first(TWO)[0].tolist() == second(TWO)[0].tolist()
    refused(second, TWO, "2")
    third = making(str)
    assert _made[code][1] is not check
    refused(third, TWO, 2)


def test_hints_are_one_where_arrays_axes_and_all_about_them_are():
    def hints(axes: str, kind: type) -> list[object]:
        array = Float[np.ndarray, axes]
        return [array, array | None, list[array], tuple[array, ...], Callable[[array, kind], array], dict[kind, array]]

    for place, (one, other) in enumerate(zip(hints("n m", int), hints("n m", int), strict=True)):
        assert _alike(one, other)
        for rest in (*hints("n", int), *hints("n m", int)[:place], Complex[np.ndarray, "n m"], None, float):
            assert not _alike(one, rest) and not _alike(rest, one)
    assert not any(map(_alike, hints("n m", int)[4:], hints("n m", float)[4:]))


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
    checked_by_the_tests = FrfSet.__init__.__wrapped__.__wrapped__  # behind the checks that are always there
    refused(checked_by_the_tests, object.__new__(FrfSet), **given)


HINTS = (
    Float[np.ndarray, "n"],
    Float[np.ndarray, "n n"],
    Complex[np.ndarray, "n 2"],
    Inexact[np.ndarray, "_ m"],
    Int[np.ndarray, "m n"],
    Bool[np.ndarray, ""],
    Float[np.ndarray, "n *more"],
    Float[np.ndarray, "... m"],
    Float[np.ndarray, "n+1"],
    Float[np.ndarray, "#n m"],
    Shaped[np.ndarray, "n"],
    Float[StoredSignals, "n m"],
)


def test_arrays_and_axes_are_judged_as_by_jaxtyping():
    """Sequences of hints and arrays in one call, with what is known of the axes after each."""
    rng = np.random.default_rng(17)
    verdicts = set()
    for _ in range(2500):
        _storage.push_shape_memo({})
        _storage.push_shape_memo({})
        ours, theirs = _storage._shape_storage.memo_stack[-2:]
        try:
            for _ in range(12):
                hint = HINTS[rng.integers(len(HINTS))]
                shape = tuple(rng.integers(1, 4, size=rng.integers(0, 3)).tolist())
                value = [np.zeros(shape, kind) for kind in ("f4", "f8", "c16", "i8", "?", "U3")][rng.integers(6)]
                found = []
                for memo, judge in (
                    (ours, fits),
                    (theirs, lambda hint, value: hint.__instancecheck_str__(value) == ""),
                ):
                    _storage._shape_storage.memo_stack[-1] = memo
                    try:
                        found.append(judge(hint, value))
                    except AnnotationError:
                        found.append("no such axis")
                    memo = _storage._shape_storage.memo_stack[-1]
                    ours, theirs = (memo, theirs) if judge is fits else (ours, memo)
                assert found[0] == found[1], (hint, value.shape, value.dtype, ours, theirs)
                assert ours[:2] == theirs[:2]
                verdicts.add((hint, found[0]))
        finally:
            _storage.pop_shape_memo()
            _storage.pop_shape_memo()
    assert {(hint, True) for hint in HINTS[:-1]} | {(hint, False) for hint in HINTS} <= verdicts


def test_what_is_no_array_or_of_another_kind_is_refused():
    assert not isinstance([1.0], Vector) and not isinstance(None, Vector) and not isinstance(np.float64(1.0), Vector)
    assert isinstance(TWO, Vector) and not isinstance(TWO.astype(int), Vector) and not isinstance(np.zeros(()), Vector)


def test_after_its_first_calls_in_a_test_a_function_is_checked_now_and_then():
    calls = []

    def half(number: float) -> float:
        calls.append(number)
        return number / 2 if isinstance(number, float) else 0.0

    half.__qualname__ = "half"  # as one of a module
    half = checked(half)
    for _ in range(FIRST):
        refused(half, "1")
    assert not calls
    hidden = 0
    for _ in range(4 * EVERY):
        try:
            half("1")
            hidden += 1
        except BeartypeCallHintViolation:
            pass
    assert hidden == len(calls) == 4 * (EVERY - 1)
    next_test()
    refused(half, "1")

"""Results of tasks in other processes: in their order, not held once they are used, and a worker without memory."""

import gc
import os
import weakref
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from ema.errors import InputError
from ema.study.remote import in_order


def test_a_task_that_ends_its_worker_is_one_sentence() -> None:
    """As the system does where memory runs out."""
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool,
        pytest.raises(InputError, match=r"a task ended its workers.*expected workers with enough memory.*more memory"),
    ):
        list(in_order([pool.submit(os._exit, 137)]))


def test_a_result_is_let_go_once_it_is_used() -> None:
    """Those of a campaign of many runs are larger than memory."""
    futures, known = [], []
    for number in range(3):
        array = np.full(4, number)
        known.append(weakref.ref(array))
        futures.append(Future())
        futures[-1].set_result(array)
    del array
    results = in_order(list(futures))
    futures.clear()
    for number in range(3):
        value = next(results)[0]
        assert value == number
        del value
        gc.collect()
        assert [one() is None for one in known[: number + 1]] == [True] * number + [False]


def test_what_follows_a_fault_is_called_off() -> None:
    futures: list[Future[int]] = [Future() for _ in range(3)]
    futures[0].set_exception(InputError("no force"))
    with pytest.raises(InputError, match="no force"):
        list(in_order(futures))
    assert futures[1].cancelled() and futures[2].cancelled()

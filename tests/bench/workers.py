"""Where the draws of a bench are computed: here, in processes of this machine, or on the workers of a Dask scheduler."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ema.cli.cluster import workers
from ema.study.remote import in_order


@contextmanager
def mapping(cluster: str | None, jobs: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """What stands for ``map``: results in the order of the draws, the same numbers wherever they are computed."""
    with workers(cluster, jobs) as executor:
        if executor is None:
            yield map
        else:
            yield lambda function, draws: in_order([executor.submit(function, draw) for draw in draws])

"""Where tasks run: here, in processes of this machine, or on the workers of a Dask scheduler."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.errors import FailureError, InputError, require

if TYPE_CHECKING:
    from distributed import Client

WAIT = 20.0
"""Seconds that a cluster has to answer and to show its first worker."""
_RETRIES = 3
"""Workers that may die under a task before it is given up: the default of Dask (allowed-failures)."""

Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster",
        help="Address of a Dask scheduler, such as tcp://127.0.0.1:8786 (tls:// with the certificates of "
        "Dask's configuration).",
    ),
]


@contextmanager
def workers(cluster: str | None, jobs: int) -> Iterator[Executor | None]:
    """Where tasks run: a cluster, processes, or ``None`` for here."""
    if cluster is not None:
        with _cluster(cluster) as executor:
            yield executor
    elif jobs > 1:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        # a fresh interpreter: forking one whose compiled code holds threads may hang
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            yield pool
    else:
        yield None


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    if find_spec("distributed") is None:
        require("distributed", "cluster")
    from distributed import Client

    try:
        client = Client(address, timeout=WAIT)
    except (OSError, ValueError, TimeoutError, TypeError) as error:
        raise InputError(
            "no cluster answers",
            where=address,
            got=str(error).splitlines()[0] if str(error) else "",
            expected="the address of a running scheduler",
            advice="start `dask scheduler` and `dask worker ADDRESS`",
        ) from error
    try:
        try:
            client.wait_for_workers(1, timeout=WAIT)
        except TimeoutError as error:
            raise FailureError(
                "the cluster has no worker",
                where=address,
                got=f"none within {WAIT:g} s",
                advice=f"start one with `dask worker {address}`",
            ) from error
        _warn(address)
        _compare_versions(client, address)
        yield client.get_executor(pure=False, retries=_RETRIES)
    finally:
        client.close(timeout=WAIT)


def _warn(address: str) -> None:
    """Say once that a plain scheduler runs what anybody sends, unless nobody else can reach it."""
    import sys

    protocol, _, place = address.rpartition("://")
    local = place.rpartition(":")[0].strip("[]") in ("127.0.0.1", "localhost", "::1")
    if protocol != "tls" and not local:
        print(
            f"ema: {address} runs code for whoever reaches it: keep it in a closed network, or use tls://",
            file=sys.stderr,
        )


def _compare_versions(client: "Client", address: str) -> None:
    """Refuse workers on which this computation would be another one.

    Raises
    ------
    InputError : a worker has no friction-ema, or other versions of it or of what computes.
    """
    from ema import fingerprint

    here = dict(fingerprint.versions())
    answers: dict[str, Any] = client.run(versions_here, on_error="return")
    for worker, answer in answers.items():
        if isinstance(answer, Exception):
            raise InputError(
                "a worker cannot load friction-ema",
                where=f"worker {worker}",
                got=f"{type(answer).__name__}: {str(answer).splitlines()[0] if str(answer) else ''}",
                expected="this version of it installed",
                advice=f"install friction-ema {here['friction-ema']} in the environment of `dask worker {address}`",
            )
        there = dict(answer)
        other = [name for name in here if there.get(name) != here[name]]
        if other:
            raise InputError(
                "a worker has other versions than this process",
                where=f"worker {worker}",
                got=_versions(there, other),
                expected=_versions(here, other),
                advice="install the same packages on both, so that results are the same",
            )


def _versions(versions: dict[str, str], names: Sequence[str]) -> str:
    return ", ".join(f"{name} {versions.get(name, 'absent')[:12]}" for name in names[:4])


def versions_here() -> tuple[tuple[str, str], ...]:
    """What computes in this process, asked of a worker."""
    from ema import fingerprint

    return fingerprint.versions()

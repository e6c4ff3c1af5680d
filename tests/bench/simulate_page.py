"""The time solver on the page about speed, from the figures of ``python -m tests.bench.simulate``."""

from typing import Any

from tests.bench.write_docs import number, table


def time_solver(result: dict[str, Any]) -> str:
    """Section about snap-backs and first calls."""
    lines = []
    for row in result["snap-back"]:
        force, fast, exact = f"{row['force']:g}", row["fast"], row["reference"]
        ended = [run for run in row["opensees"] if "error" not in run]
        # the peer's coarsest step whose error is allowed, or its finest
        peer = ended[-1] if ended else None
        for name, own in (("friction-ema, fast", fast), ("friction-ema, reference", exact)):
            ratio = number(peer["cpu"] / own["cpu"]) if peer else "-"
            lines.append([force, name, number(own["cpu"]), f"{own['deviation']:.1e}", f"{own['energy']:.1e}", ratio])
        lines += [
            [force, f"OpenSeesPy {run['version']}, {1e6 * run['step']:g} us", number(run["cpu"]),
             f"{run['deviation']:.1e}", "-", ""]
            for run in ended
        ]  # fmt: skip
    head = [
        "F_N [N]", "system", "processor time per simulated second [s]", "error / initial deflection",
        "energy balance / initial energy", "times faster than OpenSeesPy's last row",
    ]  # fmt: skip
    calls = [[name, number(seconds)] for name, seconds in result["first calls"].items()]
    return "\n\n".join([
        "## Snap-back: double beam, 2 x 20 elements, 20 node pairs, Eq. (4), 20 N",
        table(head, lines),
        "OpenSeesPy is run with ever finer steps until its error falls below a thousandth. The truth is the reference "
        "mode at half its spacing. First calls, in a new process that has to compile everything:",
        table(["first call", "processor time [s]"], calls),
        f"Measured {result['date']} on {result['machine']['processor']}. From `python -m tests.bench.simulate`.",
    ])  # fmt: skip

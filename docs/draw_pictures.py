"""Draw the pictures of README and docs from the built-in campaign's result: `python docs/draw_pictures.py`.

Run `ema run reports/table_hammer.toml` first.
"""

from pathlib import Path

from ema import fit, show, store

ROOT = Path(__file__).resolve().parent.parent
RESULT = ROOT / "reports" / "_build" / "table_hammer.h5"


def main() -> None:
    """Mode shapes of the table with its beam, and the stabilisation diagram that they were chosen from."""
    result = store.load(RESULT)
    beam = next(run for run in result.runs if run.run.id == "beam_1kN")
    pictures = ROOT / "docs" / "pictures"
    pictures.mkdir(exist_ok=True)
    show.mode_shapes(beam.modes, result.campaign.geometry, range(4)).savefig(pictures / "mode_shapes.png", dpi=110)
    inside = beam.frfs.band(*beam.poles.band)
    diagram = show.stabilisation(beam.poles, beam.modes, inside.frequencies, fit.cmif(inside))
    diagram.savefig(pictures / "stabilisation.png", dpi=110)


if __name__ == "__main__":
    main()

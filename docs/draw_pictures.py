"""Draw the pictures of README and docs from the results of built-in campaigns: `python docs/draw_pictures.py`.

Run `ema run reports/table_hammer.toml` and `ema run reports/table_placement.toml` first.
"""

from pathlib import Path

from ema import fit, show, store

ROOT = Path(__file__).resolve().parent.parent
BUILT = ROOT / "reports" / "_build"


def main() -> None:
    """Shapes of the table with its beam, the stabilisation diagram behind them, and the forecast of a placed beam."""
    result = store.load(BUILT / "table_hammer.h5")
    beam = next(run for run in result.runs if run.run.id == "beam_1kN")
    pictures = ROOT / "docs" / "pictures"
    pictures.mkdir(exist_ok=True)
    show.mode_shapes(beam.modes, result.campaign.geometry, range(4)).savefig(pictures / "mode_shapes.png", dpi=110)
    inside = beam.frfs.band(*beam.poles.band)
    diagram = show.stabilisation(beam.poles, beam.modes, inside.frequencies, fit.cmif(inside))
    diagram.savefig(pictures / "stabilisation.png", dpi=110)
    placed = store.load(BUILT / "table_placement.h5")
    show.forecast_bands(placed.forecast_check).savefig(pictures / "forecast.png", dpi=110)


if __name__ == "__main__":
    main()

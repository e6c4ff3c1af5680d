"""Draw the pictures of docs/friction-beams.md: `python docs/draw_friction_beams.py` (about half a minute)."""

from pathlib import Path

from ema import show
from ema.data import Damping, Response
from ema.simulate import Masing, double_beam, snapback

PICTURES = Path(__file__).resolve().parent / "pictures"
TIP = "beam 2:20:+Z"
LAW = Masing(friction_coefficient=0.3, contact_stiffness=1e9)
MATERIAL = Damping(mass_factor=0.4)


def figure_3() -> tuple[list[Response], list[str]]:
    """Free vibration at 1 kN and at 8 kN."""
    return [snapback(double_beam(LAW, force), 20.0, TIP, 0.5) for force in (1000.0, 8000.0)], ["1 kN", "8 kN"]


def figure_4() -> tuple[Response, Response]:
    """Velocity at 6 kN with the damping of the material, as measured, and without it, as computed in the paper."""
    runs = [
        snapback(double_beam(LAW, 6000.0, damping=damping), 20.0, TIP, 1.5, sampling_rate=20_000.0)
        for damping in (MATERIAL, Damping())
    ]
    return runs[0], runs[1]


def main() -> None:
    """Draw both figures."""
    PICTURES.mkdir(exist_ok=True)
    runs, labels = figure_3()
    show.free_vibration(runs, labels, contacts=(0, 4, 19)).savefig(PICTURES / "double_beam_figure_3.png", dpi=110)
    one, two = figure_4()
    labels_4 = ("with material damping", "friction only")
    show.velocity_comparison(one, two, (10, 300), labels_4).savefig(PICTURES / "double_beam_figure_4.png", dpi=110)


if __name__ == "__main__":
    main()

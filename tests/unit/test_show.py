"""Pictures are looked at by their structure: what is drawn, what is written, and whether all of it can be read."""

import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from ema import show
from ema.data import (
    Condition,
    Excitation,
    Geometry,
    Hit,
    HitGallery,
    JointForce,
    ModalMap,
    ModalModel,
    PoleTable,
    poles_from,
)
from ema.dof import Dof
from ema.errors import FailureError
from ema.show.renderer import renderer_works
from ema.synthesis import frfs as synthesise
from tests.unit.report_corpus import plate


def model(modes: int = 6, points: int = 20, seed: int = 3) -> ModalModel:
    generator = np.random.default_rng(seed)
    frequencies = np.sort(generator.uniform(200, 1300, modes))
    shapes = generator.normal(size=(points, modes)) * np.exp(0.05j * generator.normal(size=(points, modes)))
    poles = poles_from(frequencies, np.full(modes, 0.005))
    return ModalModel(
        poles,
        shapes,
        tuple(Dof(node, "+Z") for node in range(1, points + 1)),
        shapes[:2] / (2j * poles.imag),
        (Dof(1, "+Z"), Dof(2, "-Z")),
        scaling="unit modal mass",
    )


def measured(modal: ModalModel, coherence: bool = True):
    frfs = synthesise(modal, np.linspace(200, 1300, 400), "accelerance", outputs=modal.inputs, inputs=modal.dofs)
    return replace(frfs, coherence=np.full(frfs.values.shape, 0.9) if coherence else None)


def pole_table(modal: ModalModel) -> PoleTable:
    orders = np.repeat(np.arange(4, 41, 2), len(modal.poles))
    poles = np.tile(modal.poles, 19)
    letters = np.array(list("ofdvs") * (len(orders) // 5 + 1))[: len(orders)]
    return PoleTable(orders, poles, letters, np.ones((len(orders), 2), complex), modal.inputs, (200.0, 1300.0))


def gallery(reasons: list[str]) -> HitGallery:
    times = np.arange(300) / 51200
    pulse = 800 * np.sin(np.pi * np.clip((times - 1e-3) / 1e-3, 0, 1)) ** 2
    blows = tuple(
        Hit("take", index, Dof(1, "-Z"), 0.1 * index, 800.0, 0.4, 1e-3, not reason, reason, pulse, 51200.0)
        for index, reason in enumerate(reasons)
    )
    frequencies = np.linspace(0, 4000, 200)
    return HitGallery(blows, frequencies, np.exp(-((frequencies / 1500) ** 2)), (2270.0, 3210.0))


def drawn(figure: Figure) -> list[Text]:
    """Draw it, and return the visible texts with their places."""
    FigureCanvasAgg(figure).draw()
    return [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]


def boxes(figure: Figure, texts: list[Text]):
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    return [text.get_window_extent(renderer) for text in texts]


def assert_legible(figure: Figure) -> None:
    """No text leaves the figure, and no two overlap by more than a hair."""
    shown = drawn(figure)
    extents = boxes(figure, shown)
    # tick labels outside the view exist without being drawn
    inside = [
        (text, box)
        for text, box in zip(shown, extents, strict=True)
        if box.width > 0 and np.isfinite([box.x0, box.y0]).all() and _in_view(text, figure)
    ]
    for text, box in inside:
        assert box.x0 > -2 and box.y0 > -2, text.get_text()
        assert box.x1 < figure.bbox.x1 + 2 and box.y1 < figure.bbox.y1 + 2, text.get_text()
    for (first, a), (second, b) in combinations(inside, 2):
        width, height = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert width < 1.5 or height < 1.5, f"{first.get_text()!r} overlaps {second.get_text()!r}"


def _in_view(text: Text, figure: Figure) -> bool:
    """Whether a tick label belongs to a tick that is drawn."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            labels = [label for tick in axis.get_major_ticks() for label in (tick.label1, tick.label2)]
            labels += [label for tick in axis.get_minor_ticks() for label in (tick.label1, tick.label2)]
            if text in labels:
                ticks = axis._update_ticks()  # type: ignore[attr-defined]
                return axes.axison and any(text in (tick.label1, tick.label2) for tick in ticks)
            if text is axis.label or text is axis.offsetText:
                return axes.axison
    return True


def scatter_count(figure: Figure) -> int:
    return sum(len(c.get_offsets()) for axes in figure.axes for c in axes.findobj(PathCollection))


MODES = model()
FRFS = measured(MODES)

FIGURES = {
    "stabilisation": lambda: show.stabilisation(
        pole_table(MODES), MODES, FRFS.frequencies, np.abs(FRFS.values[:, 0, :2])
    ),
    "frf_overview": lambda: show.frf_overview(FRFS, MODES),
    "coherence": lambda: show.coherence(FRFS, MODES),
    "indicator": lambda: show.indicator(FRFS.frequencies, np.linalg.svd(FRFS.values, compute_uv=False), MODES),
    "reconstruction": lambda: show.reconstruction(FRFS, FRFS, [(0, 0), (1, 3), (0, 5)], ["best", "median", "worst"]),
    "mac_matrix": lambda: show.mac_matrix(np.eye(6)),
    "error_map": lambda: show.error_map(np.full((2, 20), 0.01), FRFS.outputs, FRFS.inputs),
    "mode_shapes": lambda: show.mode_shapes(MODES, plate()),
    "shapes_over_dofs": lambda: show.shapes_over_dofs(MODES),
    "complexity": lambda: show.complexity(MODES),
    "hits": lambda: show.hits(gallery(["", "", "double hit", "overload", ""])),
    "force_spectrum": lambda: show.force_spectrum(gallery([""])),
    "normal_force": lambda: show.normal_force(
        Condition(Excitation("hammer"), (JointForce("J1", 100.0, 3.0, trace=np.ones(9)), JointForce("J2")))
    ),
    "damping_map": lambda: show.damping_map(chart()),
    "frequency_map": lambda: show.frequency_map(chart()),
}


def chart() -> ModalMap:
    damping = np.array([[0.01, 0.03, 0.02], [0.01, 0.02, 0.04]])
    return ModalMap(np.array([10.0, 20.0]), np.array([50.0, 100.0, 150.0]), 500 - 100 * damping, damping, name="mode 1")


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_legible_at_report_width(name: str):
    figure = FIGURES[name]()
    assert isinstance(figure, Figure)
    assert figure.get_figwidth() <= 9.0
    assert_legible(figure)


@pytest.mark.parametrize(
    "draw",
    [
        lambda many: show.stabilisation(pole_table(many), many),
        lambda many: show.frf_overview(measured(many), many),
        lambda many: show.coherence(measured(many), many),
        lambda many: show.mac_matrix(np.eye(60), [f"{n}: {n * 20} Hz" for n in range(60)]),
        lambda many: show.error_map(np.full((2, 80), 0.01), many.inputs, many.dofs),
        lambda many: show.shapes_over_dofs(many),
    ],
)
def test_sixty_modes_and_160_frfs_stay_legible(draw):
    assert_legible(draw(model(60, 80)))


def test_axes_carry_units():
    for name, across, up in (
        ("stabilisation", "Frequency [Hz]", "Model order"),
        ("frf_overview", "Frequency [Hz]", "Accelerance [(m/s²)/N]"),
        ("force_spectrum", "Frequency [Hz]", "Force autospectrum [dB re max]"),
        ("hits", "Time from the peak [ms]", "Force [N]"),
        ("damping_map", "Normal force F_N [N]", "Excitation force F_E [N]"),
    ):
        axes = FIGURES[name]().axes[0]
        assert (axes.get_xlabel(), axes.get_ylabel()) == (across, up)
    bare = replace(FRFS, quantity="unstated", unit="unstated")
    assert show.frf_overview(bare).axes[0].get_ylabel() == "FRF [unit unstated]"


def test_stabilisation_draws_every_pole_by_its_letter_and_numbers_the_modes():
    poles = pole_table(MODES)
    figure = FIGURES["stabilisation"]()
    counts = {c.get_label(): len(c.get_offsets()) for c in figure.axes[0].collections}
    expected = {"new": "o", "frequency": "f", "frequency and damping": "d", "frequency and vector": "v", "stable": "s"}
    assert counts == {meaning: int(np.sum(poles.letter == letter)) for meaning, letter in expected.items()}
    numbers = {text.get_text() for text in figure.axes[0].texts}
    assert numbers == {"1", "2", "3", "4", "5", "6"}


def test_numbers_of_close_modes_are_staggered_not_overprinted():
    close = replace(MODES, poles=poles_from(500 + 0.5 * np.arange(6.0), np.full(6, 0.005)))
    figure = show.stabilisation(pole_table(MODES), close)
    assert_legible(figure)
    assert [text.get_text() for text in figure.axes[0].texts] == ["1", "2", "3"]
    assert sum(line.get_xdata()[0] == line.get_xdata()[1] for line in figure.axes[0].lines) == 6


def test_overview_keeps_every_peak_of_a_long_record():
    frequencies = np.linspace(0, 1000, 40_001)
    values = np.full((40_001, 1, 1), 1e-3 + 0j)
    values[12_345] = 7.0
    long = replace(
        FRFS, frequencies=frequencies, values=values, outputs=FRFS.outputs[:1], inputs=FRFS.inputs[:1], coherence=None
    )
    curves = next(c for c in show.frf_overview(long).axes[0].collections if isinstance(c, LineCollection))
    assert curves.get_segments()[0][:, 1].max() == 7.0


def test_reconstruction_draws_measured_and_model_for_each_place():
    rebuilt = replace(FRFS, values=2 * FRFS.values)
    figure = show.reconstruction(FRFS, rebuilt, [(0, 4), (1, 1)], ["best", "worst"])
    axes = figure.axes[0]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.abs(FRFS.values[:, 0, 4]))
    np.testing.assert_allclose(axes.lines[1].get_ydata(), 2 * np.abs(FRFS.values[:, 0, 4]))
    assert axes.get_title(loc="left") == "1:+Z/5:+Z  (best)"
    assert axes.lines[0].get_linestyle() != axes.lines[1].get_linestyle()


def test_reconstruction_shows_the_band_of_the_model_only():
    band = FRFS.band(400, 900)
    axes = show.reconstruction(FRFS, band, [(0, 0)]).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), band.frequencies)
    assert axes.get_xlim() == (band.frequencies[0], band.frequencies[-1])


def test_drive_points_are_found_in_either_sense():
    from ema.show.frf import drive_points

    assert drive_points(FRFS) == [(0, 0), (1, 1)]


def test_mac_matrix_prints_its_numbers_and_stays_silent_when_they_would_be_too_small():
    values = np.array([[1.0, 0.3], [0.04, 0.98]])
    assert [text.get_text() for text in show.mac_matrix(values).axes[0].texts] == ["1.00", "0.30", "0.98"]
    assert not show.mac_matrix(np.eye(40)).axes[0].texts


def test_shapes_are_drawn_with_their_faces_and_largest_displacement():
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = FIGURES["mode_shapes"]()
    panels = [axes for axes in figure.axes if axes.name == "3d"]
    assert len(panels) == 6
    assert panels[0].get_title().startswith(f"1: {MODES.natural_frequencies[0]:.5g} Hz, 0.5 %")
    faces = next(c for c in panels[0].collections if isinstance(c, Poly3DCollection))
    assert len(faces.get_facecolor()) == 12


def test_shapes_stay_inside_their_panels():
    figure = FIGURES["mode_shapes"]()
    drawn(figure)
    renderer = figure.canvas.get_renderer()
    for axes in (axes for axes in figure.axes if axes.name == "3d"):
        frame = axes.get_window_extent(renderer)
        for collection in axes.collections:
            paths = np.concatenate([collection.get_transform().transform(p.vertices) for p in collection.get_paths()])
            assert paths[:, 0].min() >= frame.x0 - 1 and paths[:, 0].max() <= frame.x1 + 1
            assert paths[:, 1].min() >= frame.y0 - 1 and paths[:, 1].max() <= frame.y1 + 1


def test_points_on_a_line_become_curves_over_position():
    line = Geometry(np.arange(1, 6), np.column_stack([np.linspace(0, 1, 5), np.zeros((5, 2))]), ((1, 2, 3, 4, 5),))
    shapes = np.array([[1.0], [0.2], [-0.8], [0.2], [1.0]], complex)
    modal = ModalModel(
        poles_from(np.array([112.0]), np.array([1e-4])),
        shapes,
        tuple(Dof(n, "-Z") for n in range(1, 6)),
        np.ones((1, 1), complex),
        (Dof(1, "-Z"),),
    )
    curve = show.mode_shapes(modal, line).axes[0].lines[1]
    np.testing.assert_allclose(curve.get_xdata(), np.linspace(0, 1, 5), atol=1e-12)
    np.testing.assert_allclose(np.abs(curve.get_ydata()), np.abs(shapes[:, 0].real), atol=1e-12)


def test_rejected_blows_carry_their_reasons():
    figure = show.hits(gallery(["", "double hit", "double hit", "overload", ""]))
    assert [axes.get_title(loc="left") for axes in figure.axes[:2]] == ["accepted: 2", "rejected: 3"]
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"accepted", "double hit", "overload"}


def test_no_panel_stays_empty():
    assert len(show.hits(gallery(["", ""])).axes) == 2
    assert len(show.hits(gallery(["overload", "overload"])).axes) == 2


def test_many_reasons_are_gathered():
    figure = show.hits(gallery([f"reason {n}" for n in range(30)]))
    assert len(figure.legends[0].get_texts()) <= 7
    assert_legible(figure)


def test_unknown_normal_force_is_said_and_not_drawn_as_zero():
    figure = FIGURES["normal_force"]()
    assert "unknown" in [text.get_text() for text in figure.axes[0].texts]
    assert not figure.axes[0].get_ylim()[0] <= 0 <= figure.axes[0].get_ylim()[1]


def test_ridge_and_holes_of_a_map():
    figure = show.damping_map(chart())
    ridge = next(line for line in figure.axes[0].lines if line.get_label() == "largest damping")
    np.testing.assert_allclose(ridge.get_xdata(), [100, 150])
    holed = replace(chart(), damping=np.array([[0.01, np.nan, 0.02], [0.01, 0.02, 0.04]]))
    hatched = [patch for patch in show.damping_map(holed).axes[0].patches if patch.get_hatch()]
    assert [tuple(p.get_xy()) for p in hatched if np.isfinite(p.get_x())] == [(75.0, 5.0)]
    assert_legible(show.damping_map(holed))


NOTHING = ModalModel(
    np.zeros(0, complex), np.zeros((20, 0), complex), MODES.dofs, np.zeros((2, 0), complex), MODES.inputs
)


@pytest.mark.parametrize(
    ("figure", "told"),
    [
        (lambda: show.complexity(NOTHING), "no mode"),
        (lambda: show.mode_shapes(NOTHING, plate()), "no mode"),
        (lambda: show.shapes_over_dofs(NOTHING), "no mode"),
        (lambda: show.mac_matrix(np.zeros((0, 0))), "no mode"),
        (lambda: show.hits(HitGallery((), np.zeros(0), np.zeros(0), (0.0, 0.0))), "no impact"),
        (lambda: show.force_spectrum(HitGallery((), np.zeros(0), np.zeros(0), (0.0, 0.0))), "no accepted impact"),
        (lambda: show.coherence(measured(MODES, False)), "without a coherence"),
        (lambda: show.normal_force(Condition()), "no friction beam"),
        (lambda: show.damping_map(replace(chart(), damping=np.full((2, 3), np.nan))), "no point"),
        (lambda: show.reconstruction(FRFS, FRFS, []), "no FRF"),
        (lambda: show.error_map(np.zeros((0, 0)), (), ()), "no FRF"),
    ],
)
def test_nothing_to_draw_is_said(figure, told):
    made = figure()
    drawn(made)
    assert any(told in text.get_text() for text in made.findobj(Text))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("spoil", ["zero", "one line", "undefined coherence"])
def test_dead_and_short_records_are_drawn_without_complaint(spoil: str):
    frfs = {
        "zero": replace(FRFS, values=0 * FRFS.values, coherence=np.zeros(FRFS.values.shape)),
        "one line": FRFS.lines(slice(5, 6)),
        "undefined coherence": replace(FRFS, coherence=np.full(FRFS.values.shape, np.nan)),
    }[spoil]
    values = np.linalg.svd(frfs.values, compute_uv=False)
    for figure in (
        show.frf_overview(frfs, MODES),
        show.coherence(frfs, MODES),
        show.reconstruction(frfs, frfs, [(0, 0)]),
        show.indicator(frfs.frequencies, values),
        show.stabilisation(pole_table(MODES), MODES, frfs.frequencies, values),
    ):
        FigureCanvasAgg(figure).draw()


@pytest.mark.filterwarnings("error")
def test_shapes_without_motion_lines_or_extent_are_drawn():
    still = replace(MODES, shapes=0 * MODES.shapes)
    points = replace(plate(), faces=())
    alone = replace(MODES, shapes=MODES.shapes[:1], dofs=MODES.dofs[:1])
    for figure in (
        show.mode_shapes(still, plate()),
        show.complexity(still),
        show.shapes_over_dofs(still),
        show.mode_shapes(MODES, points),
        show.mode_shapes(alone, Geometry(np.array([1]), np.zeros((1, 3)))),
        show.mac_matrix(np.full((3, 3), np.nan)),
    ):
        FigureCanvasAgg(figure).draw()


def test_empty_pole_table():
    table = PoleTable(
        np.zeros(0, int), np.zeros(0, complex), np.zeros(0, "<U1"), np.zeros((0, 2), complex), MODES.inputs, (1.0, 2.0)
    )
    assert any("no pole" in text.get_text() for text in show.stabilisation(table).findobj(Text))


def test_settings_of_the_caller_survive():
    before = dict(matplotlib.rcParams)
    for make in FIGURES.values():
        make()
    assert dict(matplotlib.rcParams) == before


def test_neither_pyplot_nor_a_backend_is_touched():
    script = (
        "import sys, numpy as np, matplotlib; from ema import show\n"
        "show.mac_matrix(np.eye(3)); show.error_map\n"
        "from ema.show import mode_shapes, hits, stabilisation, frf_overview, complexity, normal_force, damping_map\n"
        "assert 'matplotlib.pyplot' not in sys.modules and 'pyvista' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_importing_the_room_loads_no_matplotlib():
    subprocess.run([sys.executable, "-c", "import sys, ema.show; assert 'matplotlib' not in sys.modules"], check=True)


def test_rendering_by_vtk_or_a_clear_refusal(monkeypatch: pytest.MonkeyPatch):
    """Where VTK works it draws; where it does not, the process lives and says what to use instead."""
    if renderer_works():
        picture = show.rendered_shape(MODES, plate(), 0).axes[0].images[0].get_array()
        assert np.asarray(picture).std() > 1
    monkeypatch.setattr("ema.show.renderer.renderer_works", lambda: False)
    with pytest.raises(FailureError, match=r"use ema\.show\.mode_shapes"):
        show.rendered_shape(MODES, plate(), 0)


def test_a_crashing_renderer_does_not_take_the_process_along(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("ema.show.renderer._PROBE", "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    renderer_works.cache_clear()
    assert renderer_works() is False
    renderer_works.cache_clear()

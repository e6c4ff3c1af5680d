"""Models from files are the models of the simulator; every mistake is one sentence with its line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.linalg import eigh

import acquisition
from acquisition import model_file
from acquisition.model_building import law_of
from ema import store
from ema.data import Damping, ModalModel, NormalContact, poles_from
from ema.elements import Plate, Section, plate_matrices, stepped_beam
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    RoughContact,
    RoughNormalContact,
    Valanis,
    beam,
    double_beam,
    frf,
    snapback,
)

EXAMPLE = Path(__file__).parents[2] / "datasets" / "double_beam"
HOST = """
[model]
name = "beam on a beam"

[structure]
kind = "beam"
length = "0.5 m"
width = "40 mm"
height = "10 mm"
elements = 10
"""
REST = """
[beam]
kind = "beam"
length = "0.2 m"
width = "30 mm"
height = "5 mm"
elements = 4

[[joints]]
name = "left"
host_nodes = "3-7"
beam_nodes = "0-4"
normal_force = "1 kN"
normal_stiffness = "1e8 N/m"

[law]
name = "masing"
friction_coefficient = 0.2
contact_stiffness = "20 N/um"
"""


def opened(folder: Path, text: str):
    (folder / "model.toml").write_text(text)
    return acquisition.open_model(folder)


def test_the_double_beam_is_that_of_the_simulator():
    found, wanted = acquisition.open_model(EXAMPLE / "model.toml"), double_beam(Masing(0.3, 1e9), 1000.0)
    for part in ("host", "beam"):
        for matrix in ("mass", "stiffness"):
            assert np.array_equal(getattr(getattr(found, part), matrix), getattr(getattr(wanted, part), matrix))
    (one,), (two,) = found.joints, wanted.joints
    assert np.array_equal(one.area_shares, two.area_shares)
    assert replace(one, area_shares=None) == replace(two, area_shares=None)
    assert (found.pair_spacing, found.damping, found.name) == (wanted.pair_spacing, Damping(0.001), "double beam")


def test_a_beam_on_a_beam(tmp_path):
    found = opened(tmp_path, HOST + REST + '[damping]\nratio = "0.1 %"\nmass_factor = "0.3 1/s"\n')
    assert np.array_equal(found.host.mass, beam(Section(0.5, 0.04, 0.01, elements=10)).mass)
    assert np.array_equal(found.beam.mass, beam(Section(0.2, 0.03, 0.005, elements=4), clamped=(False, False)).mass)
    (joint,) = found.joints
    assert joint.pairs == ((3, 0), (4, 1), (5, 2), (6, 3), (7, 4)) and joint.half_heights == (0.005, 0.0025)
    assert joint.law == Masing(0.2, 2e7) and joint.normal_force == 1000.0
    assert found.damping == Damping(0.001, 0.3) and found.pair_spacing == pytest.approx(0.05)
    steady = frf(found, np.array([30.0, 33.0]), 1.0, "10:+Z", ["10:+Z", "beam:2:+Z"])
    assert steady.converged.all()
    released = snapback(found, 200.0, "10:+Z", 0.05)
    assert released.energy.error <= 1e-6 and released.energy.friction[-1] > 0


def test_a_table_that_floats_cannot_be_released():
    table = acquisition.open_model(EXAMPLE.parent / "table_with_beam")
    with pytest.raises(InputError, match="the structure is not held"):
        snapback(table, 20.0, "table:0:+Z", 0.05)


def test_sections_are_put_in_line(tmp_path):
    sections = [Section(0.2, 0.04, 0.01, elements=4), Section(0.3, 0.04, 0.02, elements=6)]
    text = (
        HOST.split("length")[0]
        + 'ends = ["free", "clamped"]\n'
        + "".join(
            f'[[structure.sections]]\nlength = "{s.length} m"\nwidth = "{s.width} m"\nheight = "{s.height} m"\nelements = {s.elements}\n'
            for s in sections
        )
    )
    found = opened(tmp_path, text + REST.replace("normal_force", 'half_heights = ["10 mm", "2.5 mm"]\nnormal_force'))
    assert np.array_equal(found.host.stiffness, stepped_beam(sections, (False, True)).stiffness)


def test_a_plate_under_a_beam(tmp_path):
    text = HOST.split("[structure]")[0] + (
        '[structure]\nkind = "plate"\nlength = "0.9 m"\nwidth = "0.5 m"\nheight = "60 mm"\nyoungs_modulus = "110 GPa"\n'
        'density = "7200 kg/m^3"\npoisson = 0.26\nelements = [9, 5]\n'
    )
    joint = REST.replace('host_nodes = "3-7"\nbeam_nodes = "0-4"', "pairs = [[8, 0], [32, 4]]")
    found = opened(tmp_path, text + joint)
    assert np.array_equal(
        found.host.mass,
        plate_matrices(
            Plate(0.9, 0.5, 0.06, youngs_modulus=110e9, poisson=0.26, density=7200.0, elements=(9, 5)), clamped=False
        ).mass,
    )
    assert found.joints[0].half_heights == (0.03, 0.0025)


def test_matrices_and_mapping(tmp_path):
    """The files of another program, in mm, t and s."""
    host = beam(Section(0.5, 0.04, 0.01, elements=10))
    per_si = np.array([1.0 if dof.axis.startswith("R") else 1000.0 for dof in host.dofs])
    for name in ("mass", "stiffness"):
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", getattr(host, name) / np.outer(per_si, per_si) / 1e-3)
    (tmp_path / "dofs.txt").write_text("\n".join(map(str, host.dofs)))
    text = HOST.split("kind")[0] + (
        'kind = "matrices"\nmass = "mass.mtx"\nstiffness = "stiffness.mtx"\ndofs = "dofs.txt"\nlength_unit = "1 mm"\n'
        'mass_unit = "1 t"\n'
    )
    found = opened(tmp_path, text + REST.replace("normal_force", 'half_heights = ["5 mm", "2.5 mm"]\nnormal_force'))
    plain = opened(tmp_path, HOST + REST)
    np.testing.assert_allclose(found.host.stiffness, plain.host.stiffness, rtol=1e-12, atol=1e-6)
    one, two = (frf(model, np.array([30.0]), 1.0, "10:+Z", ["10:+Z"]) for model in (found, plain))
    assert one.values[0, 0, 0] == pytest.approx(two.values[0, 0, 0], rel=1e-6)


def test_a_measured_host(tmp_path):
    host = beam(Section(0.5, 0.04, 0.01, elements=10))
    squares, shapes = eigh(host.stiffness, host.mass)
    poles = poles_from(np.sqrt(squares) / (2 * np.pi), np.full(len(squares), 1e-3))
    modes = ModalModel(
        poles, shapes.astype(complex), host.dofs, shapes / (2j * poles.imag), host.dofs, scaling="unit modal mass"
    )
    store.save(tmp_path / "modes.h5", {"bare": modes, "other": modes})
    text = HOST.split("kind")[0] + 'kind = "measured"\nfile = "modes.h5"\nrun = "bare"\n'
    heights = REST.replace("normal_force", 'half_heights = ["5 mm", "2.5 mm"]\nnormal_force')
    found = opened(tmp_path, text + heights)
    assert isinstance(found.host, ModalModel) and np.array_equal(found.host.poles, poles)
    with pytest.raises(
        InputError, match=r"line 5: .*no such modal model.*got bare 2, expected run = one of bare, other"
    ):
        opened(tmp_path, text.replace('"bare"', '"bare 2"') + heights)


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ('name = "masing"', Masing(0.3, 1e9)),
        ('name = "regularised masing"', RegularisedMasing(0.3, 1e9)),
        ('name = "regularised masing"\nexponent = 2.5', RegularisedMasing(0.3, 1e9, 2.5)),
        ('name = "iwan"', Iwan(0.3, 1e9)),
        ('name = "iwan"\nchi = -0.3\nbeta = 2\nsprings = 20', Iwan(0.3, 1e9, -0.3, 2.0, 20)),
        ('name = "dahl"\nshape = 2', Dahl(0.3, 1e9, 2.0)),
        ('name = "dahl"', Dahl(0.3, 1e9)),
        ('name = "modified iwan"\nchi = 1', ModifiedIwan(0.3, 1e9, 1.0)),
        ('name = "bouc wen"\ngamma = -0.5', BoucWen(0.3, 1e9, 1.0, -0.5)),
        ('name = "valanis"', Valanis(0.3, 1e9)),
        ('name = "lugre"', LuGre(0.3, 1e9)),
        ('name = "lugre"\nviscous = 3\nstatic_ratio = 1.5', LuGre(0.3, 1e9, 0.0, 3.0, 1.5)),
        ('name = "coulomb"', Coulomb(0.3, 1e9)),
        (
            'name = "parallel masing"\nstiffness_shares = [0.25, 0.75]\nforce_shares = [0.5, 0.5]',
            ParallelMasing(0.3, 1e9, [0.25, 0.75], [0.5, 0.5]),
        ),
        (
            'name = "masing"\nstiffness_exponent = 0.5\nreference_force = "2 kN"\nstiffness_cap = "2e9 N/m"\nisotropic = false',
            Masing(0.3, 1e9, stiffness_exponent=0.5, reference_force=2000.0, stiffness_cap=2e9, isotropic=False),
        ),
    ],
)
def test_laws_are_those_of_the_constructors(text, law):
    import tomllib

    table = tomllib.loads(text) | {"friction_coefficient": 0.3, "contact_stiffness": "1e9 N/m"}
    assert law_of(model_file.LawTable(**table)) == law


ROUGH = 'name = "rough contact"\nfriction_coefficient = 0.3\n'
GAUSSIAN = ROUGH.replace("rough", "gaussian rough")


@pytest.mark.parametrize(
    ("text", "law"),
    [
        (ROUGH + 'summit_deviation = "1 um"', RoughContact(0.3, 1e-6)),
        (
            ROUGH + 'summit_deviation = "2 um"\npoisson = 0.25\nsprings = 90\nreference_force = "2 kN"',
            RoughContact(0.3, 2e-6, 0.25, springs=90, reference_force=2000.0),
        ),
        (GAUSSIAN + 'summit_deviation = "1 um"\nseparation = 3', RoughContact(0.3, 1e-6, separation=3.0)),
        (
            GAUSSIAN + 'contact_stiffness = "1e9 N/m"\nseparation = 2',
            replace(RoughContact(0.3, 1e-6, separation=2.0), contact_stiffness=1e9),
        ),
    ],
)
def test_rough_surfaces_by_their_heights(text, law):
    import tomllib

    assert law_of(model_file.LawTable(**tomllib.loads(text))) == law


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (ROUGH, "needs a summit_deviation .* or the contact_stiffness"),
        (ROUGH + 'summit_deviation = "1 um"\ncontact_stiffness = "1e9 N/m"', "one of them"),
        (ROUGH + 'contact_stiffness = "1e9 N/m"\npoisson = 0.3', "poisson goes with summit_deviation"),
        (
            ROUGH + 'summit_deviation = "1 um"\nstiffness_exponent = 0.5',
            "'stiffness_exponent' follows from the heights",
        ),
        (
            ROUGH + 'summit_deviation = "1 um"\nseparation = 3',
            "'separation' is no parameter of the law 'rough contact'",
        ),
        (GAUSSIAN + 'summit_deviation = "1 um"', "needs a separation such as 3"),
        (ROUGH + 'summit_deviation = "1 N"', "not a displacement"),
        (ROUGH.replace("rough contact", "masing") + 'summit_deviation = "1 um"', "no parameter of the law 'masing'"),
    ],
)
def test_rough_surfaces_that_are_none_get_a_sentence(text, words):
    import tomllib

    with pytest.raises(ValueError, match=words):
        model_file.LawTable(**tomllib.loads(text))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            '"0.5 m"',
            "0.5",
            r"line 7: \[structure\], length: a number without a unit; write it as a text such as \"0.5 m\"",
        ),
        ('"0.5 m"', '"0.5 N"', "line 7: .*not a displacement; got '0.5 N', expected a unit such as m"),
        ('"0.5 m"', '"-0.5 m"', "line 7: .*greater than 0"),
        ("elements = 10", "element = 10", r"line 10: unknown key 'element' in \[structure\]; did you mean elements"),
        ('kind = "beam"', 'kind = "bridge"', "line 6: .*'bridge'"),
        ("elements = 10", "elements = [3, 4]", "one number of elements"),
        ('"1 kN"', '"-1 kN"', "joints.*normal_force: .*greater than or equal to 0"),
        ('"1 kN"', '"nan kN"', "line 23: .*no number before the unit"),
        ('"1 kN"', "1000", 'write it as a text such as "1000 N"'),
        ("friction_coefficient = 0.2", "friction_coefficient = -0.2", "greater than or equal to 0"),
        ('"0-4"', '"0-3"', "5 host_nodes cannot be paired with 4 beam_nodes"),
        ('"0-4"', '"0 to 4"', "not a range of nodes"),
        ('host_nodes = "3-7"\n', "", "host_nodes and beam_nodes go together"),
        ('host_nodes = "3-7"\nbeam_nodes = "0-4"\n', "", "joint left has no node pairs"),
        ('name = "masing"', 'name = "masing"\nexponent = 8', "'exponent' is no parameter of the law 'masing'"),
        ('contact_stiffness = "20 N/um"', "", "a law needs a contact_stiffness"),
        ('[law]\nname = "masing"', '[laws]\nname = "masing"', "unknown key 'laws'"),
        ("normal_stiffness", "normal_stifness", "did you mean normal_stiffness"),
        ('normal_stiffness = "1e8 N/m"', "", "line 19: .*lacks its normal_stiffness"),
        (
            'kind = "beam"\nlength = "0.2 m"',
            'kind = "measured"\nfile = "x.h5"\nlength = "0.2 m"',
            "'elements' says nothing about a measured",
        ),
        (
            "[law]",
            '[snapback]\nload = "20 N"\nat = "99:+Z"\nduration = "1 s"\n\n[law]',
            "line 28: the structure has no such DOF; got 99:.Z",
        ),
        ("[law]", '[snapback]\nload = "20 N"\nat = "tip"\nduration = "1 s"\n\n[law]', "line 28: .*not a DOF"),
        (
            "[law]",
            '[loop]\namplitude = "1 um"\njoint = "right"\n\n[law]',
            "line 28: no such joint; got right, expected left",
        ),
        ('name = "beam on a beam"', "name = beam", "not TOML"),
    ],
)
def test_mistakes_are_named_with_their_line(tmp_path, old, new, words):
    text = HOST + REST
    assert old in text
    with pytest.raises(InputError, match=words) as caught:
        opened(tmp_path, text.replace(old, new, 1))
    assert "model.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_normal_contact(tmp_path):
    power = 'area = "15 cm^2"\n[joints.normal_contact]\nname = "power"\nexponent = 1.5\nreference_force = "2 kN"\n'
    (joint,) = opened(tmp_path, HOST + REST.replace("[law]", power + "[law]")).joints
    assert joint.normal_contact == NormalContact("power", 1.5, 2000.0) and joint.area == pytest.approx(1.5e-3)
    rough = '[joints.normal_contact]\nname = "rough"\nsummit_deviation = "1 um"\nreference_force = "2 kN"\n'
    (joint,) = opened(tmp_path, HOST + REST.replace("[law]", rough + "[law]")).joints
    assert joint.normal_contact == RoughNormalContact(1e-6, 2000.0)
    curve = '[joints.normal_contact]\nname = "curve"\npoints = [{ penetration = "0 um", force = "0 N" }, '
    curve += '{ penetration = "5 um", force = "1 kN" }]\n'
    (joint,) = opened(tmp_path, HOST + REST.replace("[law]", curve + "[law]")).joints
    assert np.array(joint.normal_contact.points) == pytest.approx(np.array([[0.0, 0.0], [5e-6, 1000.0]]))
    for text, words in (
        (rough.replace('summit_deviation = "1 um"\n', ""), 'needs a summit_deviation such as "1 um"'),
        (rough.replace("rough", "power"), "'summit_deviation' says nothing about a power contact"),
        (power.replace("power", "linear"), "'exponent' says nothing about a linear contact"),
        (curve.split("points")[0], "two points or more"),
        (power.replace("1.5\n", "0.5\n"), "greater than or equal to 1"),
        (power.replace("cm^2", "cm"), "not an area; got '15 cm', expected a unit such as m.2"),
    ):
        with pytest.raises(InputError, match=words):
            opened(tmp_path, HOST + REST.replace("[law]", text + "[law]"))


STIFF = 'normal_stiffness = "1e8 N/m"'
POINTS = '\n[joints.normal_contact]\nname = "curve"\npoints = [[0, 0], [1, 1]]'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "friction_coefficient = 0.2",
            "friction_coefficient = true",
            "friction_coefficient: .*valid number; got true$",
        ),
        ("[law]", "[law]\nstiffness_exponent = false", "stiffness_exponent: .*valid number; got false$"),
        ("elements = 10", "elements = true", "elements: .*valid integer; got true$"),
        (STIFF, STIFF + "\nforce_shares = [0.5, true]", "force_shares: .*valid number; got true$"),
        ("[law]", "[damping]\nratio = true\n[law]", "ratio: .*valid number; got true$"),
        ('normal_force = "1 kN"', "normal_force = nan", "normal_force: input should be a finite number; got nan$"),
        ('length = "0.5 m"', 'length = "inf m"', "got 'inf m', expected a value such as \"1.02 m\"$"),
        ('length = "0.5 m"', 'length = "0.5"', "got '0.5', expected a value such as \"1.02 m\", or"),
        (STIFF, STIFF + '\ndirections = ["Z"]', "directions number 1: input should be 'X' or 'Y'; got 'Z'$"),
        (STIFF, STIFF + POINTS, r"points number 1: a table with the keys penetration, force is meant.*; got \[0, 0\]"),
        ("[law]", '[law]\nstribeck_velocity = "1 mm"', "not a velocity; got '1 mm', expected a unit such as m/s"),
        ("[law]", '[law]\nviscous = "1 N/m"', "not a damping; got '1 N/m', expected a unit such as N s/m"),
    ],
)
def test_values_of_another_kind_say_what_is_meant(tmp_path, old, new, words):
    text = HOST + REST
    assert old in text
    with pytest.raises(InputError, match=words):
        opened(tmp_path, text.replace(old, new, 1))


def test_numbers_of_a_law_with_their_units(tmp_path):
    law = 'name = "lugre"\nstribeck_velocity = "1 mm/s"\nviscous = "2 N s/mm"\nbristle_damping = 3'
    (joint,) = opened(tmp_path, HOST + REST.replace('name = "masing"', law)).joints
    assert dict(joint.law.parameters) == pytest.approx(
        {"bristle damping": 3.0, "viscous": 2000.0, "static ratio": 1.0, "stribeck velocity": 1e-3}
    )


def test_directions_in_small_letters(tmp_path):
    (joint,) = opened(tmp_path, HOST + REST.replace(STIFF, STIFF + '\ndirections = ["x", "Y"]')).joints
    assert joint.directions == ("X", "Y")


def test_missing_files_are_told(tmp_path):
    with pytest.raises(InputError, match="there is no model here"):
        acquisition.open_model(tmp_path)
    text = HOST.split("kind")[0] + 'kind = "matrices"\nmass = "m.mtx"\nstiffness = "k.mtx"\ndofs = ["1:+X"]\n'
    with pytest.raises(InputError, match=r"line 5: .*m\.mtx: the file cannot be read: No such file"):
        opened(tmp_path, text + REST)

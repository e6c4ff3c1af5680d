"""Friction laws: their constructors, and how they are handed to the compiled solvers.

Every law is elastic with k_T at first and limited by F_C = mu F_N. Solvers take the increments of ``ema.contact``.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ema.contact.catalogue import CATALOGUE, checked
from ema.contact.iwan import iwan_springs as iwan_springs
from ema.contact.laws import REGISTERED, OwnLaw, UserFunction, check_parameters
from ema.contact.rough import ROUGH, growth_exponent, rough_stiffness
from ema.data import FrictionLaw
from ema.errors import InputError
from ema.own_functions import LawName, of_function

PIECEWISE_LINEAR = tuple(name for name, law in CATALOGUE.items() if law.kernel in ("spring", "springs", "rough"))
"""Laws that consist of Masing springs while the normal force stays: the event-driven reference mode takes these."""


def Masing(friction_coefficient: float, contact_stiffness: float, **options: Any) -> FrictionLaw:
    """Return the law of a spring in series with a dry slider: elastic up to F_C, then sliding.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m].
    **options : object
        Options of every law: ``stiffness_exponent``, ``reference_force`` [N], ``stiffness_cap`` [N/m], ``isotropic``;
        see ``FrictionLaw``.

    Returns
    -------
    FrictionLaw
        The law.

    References
    ----------
    .. [1] Gaul, Roseira and Becker (2008), Eq. 4.

    Examples
    --------
    >>> Masing(0.3, 2e7).name
    'masing'
    """
    return FrictionLaw("masing", friction_coefficient, contact_stiffness, **options)


def RegularisedMasing(
    friction_coefficient: float, contact_stiffness: float, exponent: float = 8.0, **options: Any
) -> FrictionLaw:
    """Return the smooth evolution rule with an exponent m on ``|F/F_C|``.

    It dissipates below F_C, and a preload relaxes under small cycles, which no Masing spring does.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m].
    exponent : float, default 8.0
        m, above 0.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If the exponent is not positive.

    References
    ----------
    .. [1] Gaul, Roseira and Becker (2008), Eq. 5.

    Examples
    --------
    >>> RegularisedMasing(0.3, 2e7).parameters
    (('exponent', 8.0),)
    """
    if not (np.isfinite(exponent) and exponent > 0):
        raise InputError("not an exponent", where="regularised Masing", got=exponent, expected="m > 0, e.g. 8")
    return FrictionLaw(
        "regularised masing", friction_coefficient, contact_stiffness, (("exponent", float(exponent)),), **options
    )


def BoucWen(
    friction_coefficient: float, contact_stiffness: float, exponent: float = 1.0, gamma: float = 0.5, **options: Any
) -> FrictionLaw:
    """Return the law of Bouc and Wen: ``dF/du = k_T (1 - |F/F_C|^n (gamma + beta sgn(F du)))``, beta = 1 - gamma.

    With A = beta + gamma the force ends at F_C; a spring in parallel belongs in the structure.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m].
    exponent : float, default 1.0
        n, above 0.
    gamma : float, default 0.5
        From -1 to 1/2: above it the law would gain energy, at 1/2 unloading is elastic and the law that of
        :func:`RegularisedMasing`, below it unloading is stiffer than k_T.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If a parameter is outside these limits.

    References
    ----------
    .. [1] Bouc (1967); Wen (1976), Journal of the Engineering Mechanics Division 102:249.
    .. [2] Limits of gamma: Erlicher and Point (2004).

    Examples
    --------
    >>> BoucWen(0.3, 2e7, exponent=2.0).parameters
    (('exponent', 2.0), ('gamma', 0.5))
    """
    parameters = checked("bouc wen", exponent, gamma)
    return FrictionLaw("bouc wen", friction_coefficient, contact_stiffness, parameters, **options)


def Coulomb(friction_coefficient: float, stick_stiffness: float = float("inf"), **options: Any) -> FrictionLaw:
    """Return the law of rigid friction, as the stiff limit of a Masing spring.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    stick_stiffness : float, optional
        Stiffness of the sticking joint [N/m]; by default 1000 times the structure's own stiffness at the contacts, and
        a finding of every result states the number.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Examples
    --------
    >>> Coulomb(0.3).name
    'coulomb'
    """
    return FrictionLaw("coulomb", friction_coefficient, stick_stiffness, **options)


def ParallelMasing(
    friction_coefficient: float,
    contact_stiffness: float,
    stiffness_shares: Sequence[float],
    force_shares: Sequence[float],
    **options: Any,
) -> FrictionLaw:
    """Return the law of Masing springs in parallel.

    Parameters
    ----------
    friction_coefficient : float
        mu of all springs together.
    contact_stiffness : float
        k_T of all springs together [N/m].
    stiffness_shares : sequence of float
        Share of each spring in k_T, above 0, sum 1.
    force_shares : sequence of float
        Share of each spring in the slip force, sum 1.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If the lists differ in length, hold a negative number, or do not sum to 1.

    Examples
    --------
    >>> len(ParallelMasing(0.3, 2e7, [0.5, 0.5], [0.2, 0.8]).parameters)
    4
    """
    for name, shares in (("stiffness_shares", stiffness_shares), ("force_shares", force_shares)):
        if min(shares, default=-1) < 0 or abs(sum(shares) - 1) > 1e-9:
            raise InputError(
                "not shares", where="parallel Masing", got=f"{name} = {list(shares)}", expected="0 or more each, sum 1"
            )
    if len(stiffness_shares) != len(force_shares) or min(stiffness_shares) == 0:
        raise InputError(
            "every spring needs a share of stiffness and of force",
            where="parallel Masing",
            got=f"{len(stiffness_shares)} and {len(force_shares)}",
            expected="equal lengths, stiffness above 0",
        )
    springs = [(f"stiffness share {n}", float(s)) for n, s in enumerate(stiffness_shares)]
    springs += [(f"force share {n}", float(s)) for n, s in enumerate(force_shares)]
    return FrictionLaw("parallel masing", friction_coefficient, contact_stiffness, tuple(springs), **options)


def Iwan(
    friction_coefficient: float,
    contact_stiffness: float,
    chi: float = -0.5,
    beta: float = 1.0,
    springs: int = 60,
    **options: Any,
) -> FrictionLaw:
    """Return the four-parameter Iwan model in Masing springs: F_S = mu F_N, K_T, chi, beta.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        K_T of the whole joint [N/m].
    chi : float, default -0.5
        Exponent of the density of slip forces, above -1 up to 0; the loss in microslip grows with amplitude^(3 + chi).
    beta : float, default 1.0
        Stiffness of the spring that slips last over that of the others, 0 or more.
    springs : int, default 60
        Number of Masing springs.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If chi is outside (-1, 0], beta below 0, or there are fewer than 2 springs.

    References
    ----------
    .. [1] Segalman (2005), A four-parameter Iwan model for lap-type joints, Journal of Applied Mechanics 72:752.

    Examples
    --------
    >>> dict(Iwan(0.3, 2e7).parameters)["springs"]
    60.0
    """
    if not -1 < chi <= 0 or not beta >= 0 or springs < 2:
        raise InputError(
            "not an Iwan model",
            got=f"chi {chi}, beta {beta}, {springs} springs",
            expected="-1 < chi <= 0, beta >= 0, 2 or more springs",
        )
    parameters = (("chi", float(chi)), ("beta", float(beta)), ("springs", float(springs)))
    return FrictionLaw("iwan", friction_coefficient, contact_stiffness, parameters, **options)


def ModifiedIwan(
    friction_coefficient: float,
    contact_stiffness: float,
    chi: float = 0.5,
    beta: float = 1.0,
    springs: int = 60,
    **options: Any,
) -> FrictionLaw:
    """Return an Iwan model with any power of the density of slip forces.

    The loss in microslip grows with amplitude^(3 + chi). The equations of Segalman (2005) hold for any chi above -1,
    where the stiffness is finite; he has chi up to 0, which is :func:`Iwan`. Here it goes up to 1.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        K_T of the whole joint [N/m].
    chi : float, default 0.5
        Exponent of the density of slip forces, above -1 up to 1.
    beta : float, default 1.0
        As of :func:`Iwan`.
    springs : int, default 60
        Number of Masing springs.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If chi is outside (-1, 1], beta below 0, or there are fewer than 2 springs.

    Examples
    --------
    >>> dict(ModifiedIwan(0.3, 2e7).parameters)["chi"]
    0.5
    """
    parameters = checked("modified iwan", chi, beta, springs)
    return FrictionLaw("modified iwan", friction_coefficient, contact_stiffness, parameters, **options)


def RoughContact(
    friction_coefficient: float,
    summit_deviation: float,
    poisson: float = 0.3,
    separation: float | None = None,
    springs: int = 60,
    reference_force: float = 1000.0,
    **options: Any,
) -> FrictionLaw:
    """Return the law of two rough surfaces: summits of random height, each elastic, each with slip of its own.

    The summits are spheres that press by Hertz's law, and slip from their edges inwards (Cattaneo, Mindlin) where mu
    times the pressure is reached. With exponential heights the normal force F_N gives both contact stiffnesses,
    k_N = F_N/s and k_T = 2 (1 - nu)/(2 - nu) k_N, the friction force on first loading
    mu F_N (1 - exp(-k_T u/(mu F_N))), and the loss per cycle, (2/3) k_T^2 u^3/(mu F_N) at small amplitudes u. Where F_N
    changes during a motion, summits that part let go, and those that come to touch are unstressed.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force, of every summit.
    summit_deviation : float
        s, standard deviation of the heights of the summits of both surfaces [m], usually 0.1 to 10 um.
    poisson : float, default 0.3
        nu of both bodies, above -1 up to 1/2.
    separation : float, optional
        With Gaussian heights: distance of their mean from the opposite plane at the ``reference_force``, over s, above
        0 up to 6. By default the heights are exponential.
    springs : int, default 60
        Masing springs that stand for the summits that touch, 2 or more: with 60 the friction force errs by up to 0.2 %
        of mu F_N and the loss per cycle by up to 1.6 %, with 120 by 0.05 % and 0.4 %. About half as many stand for
        those that touch when F_N grows, up to 20 times that at rest.
    reference_force : float, default 1000.0
        Normal force [N] of the whole joint at which k_T is stated. It changes nothing with exponential heights.
    **options : object
        ``isotropic``, as of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law. With Gaussian heights k_T grows with the power of F_N that is that of the surface at the
        ``reference_force``, about 0.95.

    Raises
    ------
    InputError
        If a number is outside these limits.

    See Also
    --------
    RoughNormalContact : The normal contact of the same surfaces, which lifts off.

    References
    ----------
    .. [1] Greenwood and Williamson (1966), Contact of nominally flat surfaces, Proceedings of the Royal Society A
       295:300.
    .. [2] Mindlin (1949), Compliance of elastic bodies in contact, Journal of Applied Mechanics 16:259.
    .. [3] Normal law and first loading: Ciavarella (1998); changing normal forces: Popov and Hess (2015), Method of
       dimensionality reduction in contact mechanics and friction.

    Examples
    --------
    >>> law = RoughContact(0.3, summit_deviation=1e-6)
    >>> round(law.contact_stiffness / 1e6), law.stiffness_exponent  # N/um at 1 kN
    (824, 1.0)
    """
    name = ROUGH[separation is not None]
    stated = {"summit deviation": summit_deviation, "poisson": poisson}
    for parameter in CATALOGUE[name].instead:
        if not parameter.allows(stated[parameter.name]):
            got = f"{parameter.name} {stated[parameter.name]:g}"
            raise InputError("not a rough surface", where=f"law {name}", got=got, expected=parameter.limits)
    if not (np.isfinite(reference_force) and reference_force > 0):
        raise InputError("not a reference force", where=f"law {name}", got=f"{reference_force} N", expected="above 0 N")
    if separation is None:
        parameters, exponent = checked(name, springs), 1.0
    else:
        parameters = checked(name, separation, springs)
        exponent = growth_exponent(separation)
    stiffness = rough_stiffness(reference_force, summit_deviation, separation, poisson)
    return FrictionLaw(
        name,
        friction_coefficient,
        stiffness,
        parameters,
        stiffness_exponent=exponent,
        reference_force=reference_force,
        **options,
    )


def Dahl(friction_coefficient: float, contact_stiffness: float, shape: float = 1.0, **options: Any) -> FrictionLaw:
    """Return the law of Dahl: ``dF/du = k_T |1 - sgn(v) F/F_C|^shape``.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m].
    shape : float, default 1.0
        Exponent, above 0.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If the exponent is not positive.

    References
    ----------
    .. [1] Dahl (1968), A solid friction model, Aerospace Corporation.

    Examples
    --------
    >>> Dahl(0.3, 2e7).parameters
    (('shape', 1.0),)
    """
    if not (np.isfinite(shape) and shape > 0):
        raise InputError("not a shape exponent", where="Dahl", got=shape, expected="above 0, usually 1")
    return FrictionLaw("dahl", friction_coefficient, contact_stiffness, (("shape", float(shape)),), **options)


def Valanis(friction_coefficient: float, contact_stiffness: float, kappa: float = 0.9, **options: Any) -> FrictionLaw:
    """Return the law of Valanis without hardening: dF/du = k_T (1 - phi) / (1 - kappa phi).

    phi is F/F_C in the direction of motion.

    Parameters
    ----------
    friction_coefficient : float
        mu, slip force over normal force.
    contact_stiffness : float
        k_T of the whole joint [N/m].
    kappa : float, default 0.9
        From 0, which is Dahl's law, to 0.999, which is nearly a Masing spring.
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If kappa is outside these limits.

    References
    ----------
    .. [1] Valanis (1971); Gaul and Nitsche (2001), Applied Mechanics Reviews 54:93.

    Examples
    --------
    >>> Valanis(0.3, 2e7).parameters
    (('kappa', 0.9),)
    """
    return FrictionLaw("valanis", friction_coefficient, contact_stiffness, checked("valanis", kappa), **options)


def LuGre(
    friction_coefficient: float,
    contact_stiffness: float,
    bristle_damping: float = 0.0,
    viscous: float = 0.0,
    static_ratio: float = 1.0,
    stribeck_velocity: float = 1e-3,
    **options: Any,
) -> FrictionLaw:
    """Return the LuGre law of the whole joint.

    Parameters
    ----------
    friction_coefficient : float
        mu, Coulomb force F_C over normal force.
    contact_stiffness : float
        Stiffness of the bristles [N/m].
    bristle_damping : float, default 0.0
        Damping of the bristles [N s/m].
    viscous : float, default 0.0
        Viscous damping [N s/m].
    static_ratio : float, default 1.0
        F_S/F_C, 1 or more.
    stribeck_velocity : float, default 0.001
        Stribeck velocity [m/s].
    **options : object
        As of :func:`Masing`.

    Returns
    -------
    FrictionLaw
        The law.

    Raises
    ------
    InputError
        If a damping is negative, the static ratio below 1, or the velocity not positive.

    References
    ----------
    .. [1] Canudas de Wit, Olsson, Åström and Lischinsky (1995), IEEE Transactions on Automatic Control 40:419.

    Examples
    --------
    >>> dict(LuGre(0.3, 2e7, static_ratio=1.2).parameters)["static ratio"]
    1.2
    """
    if min(bristle_damping, viscous) < 0 or static_ratio < 1 or not stribeck_velocity > 0:
        raise InputError(
            "not a LuGre model",
            got=f"{bristle_damping=}, {viscous=}, {static_ratio=}, {stribeck_velocity=}",
            expected="dampings of 0 or more, F_S/F_C of 1 or more, a positive velocity",
        )
    parameters = (
        ("bristle damping", float(bristle_damping)),
        ("viscous", float(viscous)),
        ("static ratio", float(static_ratio)),
        ("stribeck velocity", float(stribeck_velocity)),
    )
    return FrictionLaw("lugre", friction_coefficient, contact_stiffness, parameters, **options)


def register_law(name: str, function: UserFunction) -> Callable[..., FrictionLaw]:
    """Make a law of one's own known to both solvers.

    ``function(force, slip_increment, contact_stiffness, slip_force, p0, p1, p2, p3)`` returns the new force; it is
    compiled. Up to four parameters are handed through. The result is used like every other law.

    Parameters
    ----------
    name : str
        Name of the law.
    function : UserFunction
        The law.

    Returns
    -------
    callable
        Makes the law from ``friction_coefficient``, ``contact_stiffness`` [N/m] and its parameters.

    Raises
    ------
    InputError
        If the name is taken by a built-in law, or the function cannot be compiled or does not return a number.

    Examples
    --------
    >>> def jenkins(force, du, k, limit, p0, p1, p2, p3):
    ...     return min(max(force + k * du, -limit), limit)
    >>> mine = register_law("jenkins of mine", jenkins)
    >>> law = mine(friction_coefficient=0.3, contact_stiffness=1e9)
    >>> law.name
    'jenkins of mine'
    """
    from ema.compiled import of_numbers

    if name in CATALOGUE:
        raise InputError("the name of a built-in law", where="register_law", got=name, expected="a name of your own")
    try:
        fingerprint = of_function(function)
        compiled = of_numbers(getattr(function, "py_func", function), 8, fingerprint)
        trial = compiled.ctypes(0.0, 1e-9, 1e6, 1.0, 0.0, 0.0, 0.0, 0.0)
    except Exception as error:
        raise InputError(
            "the law cannot be compiled",
            where=f"law {name}",
            got=str(error).strip().splitlines()[0],
            expected="a function of eight numbers that returns a number",
            advice="use plain arithmetic, comparisons and the math module only",
        ) from error
    if not np.isfinite(trial):
        raise InputError("the law returns no number", where=f"law {name}", got=trial, expected="a finite force")
    REGISTERED[name] = OwnLaw(function, compiled, fingerprint)
    known = LawName(name, fingerprint, function.__module__ or "")

    def make(friction_coefficient: float, contact_stiffness: float, *parameters: float, **options: Any) -> FrictionLaw:
        named = tuple((f"p{n}", float(p)) for n, p in enumerate(parameters))
        return FrictionLaw(known, friction_coefficient, contact_stiffness, named, **options)

    return make


_ODD, _ELASTIC = 1e-9, 1e-3
"""Departures from an odd law, over the slip force, and of the first slope from k_T, relative, that are rounding and the
curvature of a law whose difference is taken over a millionth of F_C/k_T."""


def check_isotropic(law: FrictionLaw, where: str) -> None:
    """Refuse a law of the user's own in two directions that no radial return makes isotropic.

    Turned by 180 degrees it must be the same law, and sticking must be as stiff across the force as along it.

    Raises
    ------
    InputError : the law is not odd, or not elastic with k_T at first.
    """
    if not law.isotropic or law.name not in REGISTERED:
        return
    check_parameters(law)
    k, limit = law.contact_stiffness, law.friction_coefficient * law.reference_force or 1.0
    values = [*(value for _, value in law.parameters), 0.0, 0.0, 0.0, 0.0][:4]

    def force(before: float, way: float) -> float:
        return float(REGISTERED[law.name][0](before * limit, way * limit / k, k, limit, *values)) / limit

    wrong = ""
    if abs(force(0.0, 1e-6) / 1e-6 - 1) > _ELASTIC:
        wrong = f"a first slope of {force(0.0, 1e-6) / 1e-6:.3g} k_T"
    for before in (-0.9, -0.3, 0.0, 0.5, 1.0):
        for way in (0.1, 1.0, 3.0):
            if abs(force(before, way) + force(-before, -way)) > _ODD:
                wrong = f"{force(before, way):.3g} F_C one way and {force(-before, -way):.3g} F_C the other"
    if wrong:
        raise InputError(
            "this law has no isotropic form",
            where=where,
            got=f"{law.name} with {wrong}",
            expected="isotropic=False, or an odd law that is elastic with k_T at first",
        )

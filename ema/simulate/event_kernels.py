"""Compiled exact motion from one change of stick and slip to the next.

Between changes every mode is mean + exp(-half t) (re cos wt - im sin wt), and where a harmonic force acts the forced
motion is added. All modes of a phase share ``half``, which mass-proportional damping gives. ``beat``: that and the
angular frequency of the harmonic force, 0 where there is none. A spring is given by how it slides (-1, 0 stuck, 1), its
stiffness, its limit and the displacement at which it rests; what is ``sought`` by the spacing of the instants at which
springs are looked at, and by displacement and velocity that are rounding.
"""

import numpy as np

from ema.compiled import compiled, fast_with_arrays, inner_with_arrays
from ema.contact.linear_kernels import copy_into, matvec
from ema.simulate.phase_kernels import into_modes, phase_of

# rows of the work array of a phase: wave, mean, forced wave, frequency, and displacement and velocity at some time
RE, IM, MEAN, TIDE_RE, TIDE_IM, OMEGA, X, V, COS, SIN, NOW_RE, NOW_IM = range(12)
# places in the vector of running numbers
NOW, SAMPLE, EVENTS, HALTED, PHASE, CHANGED = range(6)
HORIZON = 0.02
"""s: a phase is begun anew after this time, so that rounding does not gather."""
TERMS = 60
"""Terms of a series at most: a bound on the work, for it ends where terms are rounding."""
_ROUNDED = 10.0
"""Displacement over that of rounding up to which a spring beyond its limit is there by rounding: 1.2 was seen where
springs stick and slip in turns without end. Larger ones carry energy that nothing would book."""


@fast_with_arrays
def motion(wave, beat, t):
    """Write displacements and velocities, ``t`` after the start of a phase, into the rows X and V of ``wave``.

    ``wave`` (row, mode): the work array of the phase; ``beat``: decay of its modes, and angular frequency of the force.
    """
    fade = np.exp(-beat[0] * t)
    for r in range(wave.shape[1]):
        cosine, sine = fade * np.cos(wave[OMEGA, r] * t), fade * np.sin(wave[OMEGA, r] * t)
        wave[NOW_RE, r] = wave[RE, r] * cosine - wave[IM, r] * sine
        wave[NOW_IM, r] = wave[RE, r] * sine + wave[IM, r] * cosine
    present(wave, beat, t)


@fast_with_arrays
def begin(wave, modes, state, force, beat, harmonic):
    """Waves of a phase of ``modes`` that starts with the modal state q, p under contact forces ``force``.

    ``harmonic``: amplitude and angle of the harmonic load.
    """
    (squares, vectors, slips), (q, p), (half, pulse), (load, angle) = modes, state, beat, harmonic
    into_modes(slips, force, wave[MEAN])
    into_modes(vectors, q, wave[X])
    into_modes(vectors, p, wave[V])
    if pulse > 0.0:
        into_modes(vectors, load, wave[TIDE_RE])
    for r in range(len(squares)):
        wave[MEAN, r] /= squares[r]
        wave[OMEGA, r] = np.sqrt(squares[r] - half * half)
        if pulse > 0.0:
            # load exp(j angle) / (w^2 - pulse^2 + 2 j half pulse)
            stiff, loss = squares[r] - pulse * pulse, 2.0 * half * pulse
            size = wave[TIDE_RE, r] / (stiff * stiff + loss * loss)
            wave[TIDE_RE, r] = size * (stiff * np.cos(angle) + loss * np.sin(angle))
            wave[TIDE_IM, r] = size * (stiff * np.sin(angle) - loss * np.cos(angle))
        x = wave[X, r] - wave[MEAN, r] - wave[TIDE_RE, r]
        v = wave[V, r] + pulse * wave[TIDE_IM, r]
        wave[RE, r], wave[IM, r] = x, -(v + half * x) / wave[OMEGA, r]


@inner_with_arrays
def grown(rate, t):
    """Integral of exp(rate s) over s from 0 to t."""
    x = rate * t
    if abs(x.real) + abs(x.imag) < 1e-3:
        return t * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0 * (1.0 + x / 5.0))))
    return (np.exp(x) - 1.0) / rate


@inner_with_arrays
def books(wave, beat, t):
    """Loss to damping and work of the harmonic load over the first t s of a phase, in closed form.

    The velocity of a mode is Re(a exp(rate t) + b exp(j pulse t)), its load Re(g exp(j pulse t)); the integral of
    Re(x exp(s t)) Re(y exp(z t)) is half the real part of x y grown(s + z) + x y* grown(s + z*).
    """
    (half, pulse), lost, supplied = beat, 0.0, 0.0
    if half == 0.0 and pulse == 0.0:
        return lost, supplied
    still, twice = grown(complex(-2.0 * half, 0.0), t), grown(complex(0.0, 2.0 * pulse), t)
    for r in range(wave.shape[1]):
        omega = wave[OMEGA, r]
        rate = complex(-half, omega)
        a = rate * complex(wave[RE, r], wave[IM, r])
        square = (a * a * grown(2.0 * rate, t)).real + (a * a.conjugate() * still).real
        if pulse > 0.0:
            tide = complex(wave[TIDE_RE, r], wave[TIDE_IM, r])
            b = complex(0.0, pulse) * tide
            up, down = grown(rate + complex(0.0, pulse), t), grown(rate - complex(0.0, pulse), t)
            square += 2.0 * (a * b * up + a * b.conjugate() * down).real
            square += (b * b * twice).real + abs(b) ** 2 * t
            g = tide * complex(omega * omega + half * half - pulse * pulse, 2.0 * half * pulse)
            supplied += 0.5 * (g * a * up + g.conjugate() * a * down + g * b * twice + g * b.conjugate() * t).real
        lost += half * square
    return lost, supplied


@compiled()
def books_over(wave, beat, times, out):
    """The same up to each of ``times``, in the columns of ``out``."""
    for n in range(len(times)):
        out[n, 0], out[n, 1] = books(wave, beat, times[n])


@inner_with_arrays
def excess(spring, u, v, sought):
    """Positive once a spring has to change: a stuck one above its limit, a sliding one whose velocity reverses."""
    (slide, k, limit, rest), (_, blur, still) = spring, sought
    if slide == 0.0:
        return k * (abs(u - rest) - blur) - limit
    return -slide * v - still


@fast_with_arrays
def series(row, wave, beat, t, dt, out):
    """Taylor coefficients of the relative displacement of one contact about the time t of the rows NOW_RE, NOW_IM.

    Returns how many it takes up to t + dt.
    """
    (half, pulse), top, size = beat, 0.0, 1.0
    out[:] = 0.0
    for r in range(len(row)):
        out[0] += row[r] * wave[MEAN, r]
        top = max(top, wave[OMEGA, r])
        wave[X, r], wave[V, r] = row[r] * wave[NOW_RE, r], row[r] * wave[NOW_IM, r]
    drive_re, drive_im, c, s = 0.0, 0.0, np.cos(pulse * t), np.sin(pulse * t)
    if pulse > 0.0:
        for r in range(len(row)):
            drive_re += row[r] * (wave[TIDE_RE, r] * c - wave[TIDE_IM, r] * s)
            drive_im += row[r] * (wave[TIDE_RE, r] * s + wave[TIDE_IM, r] * c)
    for n in range(TERMS):
        total = drive_re
        for r in range(len(row)):
            total += wave[X, r]
            a = wave[X, r]
            wave[X, r] = (-half * a - wave[OMEGA, r] * wave[V, r]) * (dt / (n + 1))
            wave[V, r] = (wave[OMEGA, r] * a - half * wave[V, r]) * (dt / (n + 1))
        out[n] += total
        drive_re, drive_im = -pulse * drive_im * dt / (n + 1), pulse * drive_re * dt / (n + 1)
        size *= (top + half) * dt / (n + 1)
        if size < 1e-18:
            return n + 1
    return TERMS


@fast_with_arrays
def polynomial(terms, s):
    """Value and derivative of a polynomial."""
    value, slope = 0.0, 0.0
    for n in range(len(terms) - 1, -1, -1):
        slope = slope * s + value
        value = value * s + terms[n]
    return value, slope


@inner_with_arrays
def crossing(terms, dt, spring, sought, ends):
    """Share of ``dt`` at which a spring changes, by the Illinois form of false position on the exact motion.

    ``ends``: its ``excess`` at the begin and at the end.
    """
    start, end = ends
    if start >= 0.0:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(80):
        middle = (low * end - high * start) / (end - start)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        u, v = polynomial(terms, middle)
        value = excess(spring, u, v / dt, sought)
        if value > 0.0:
            high, end = middle, value
            start *= 0.5
        else:
            low, start = middle, value
            end *= 0.5
        if high - low <= 1e-14:
            break
    return high


@fast_with_arrays
def turn(wave):
    """Turn all waves by one interval."""
    for r in range(wave.shape[1]):
        a, b = wave[NOW_RE, r], wave[NOW_IM, r]
        wave[NOW_RE, r] = a * wave[COS, r] - b * wave[SIN, r]
        wave[NOW_IM, r] = a * wave[SIN, r] + b * wave[COS, r]


@fast_with_arrays
def present(wave, beat, t):
    """Displacements and velocities at the rows NOW_RE and NOW_IM."""
    half, pulse = beat
    c, s = np.cos(pulse * t), np.sin(pulse * t)
    for r in range(wave.shape[1]):
        wave[X, r] = wave[MEAN, r] + wave[NOW_RE, r]
        wave[V, r] = -half * wave[NOW_RE, r] - wave[OMEGA, r] * wave[NOW_IM, r]
    if pulse > 0.0:
        for r in range(wave.shape[1]):
            wave[X, r] += wave[TIDE_RE, r] * c - wave[TIDE_IM, r] * s
            wave[V, r] -= pulse * (wave[TIDE_RE, r] * s + wave[TIDE_IM, r] * c)


@inner_with_arrays
def settle(springs, u, v, blur):
    """Put stuck springs that are beyond their limits, but move back, at their limits.

    A spring that sticks is at its limit, and the modes of the next phase give its displacement with a rounding of their
    own: whether it slips again is for its velocity to say. By displacement alone the springs of one contact, which all
    turn at one time, would stick and slip in turns without end.
    """
    contact, k, limit, rest, slide, _ = springs
    for j in range(len(k)):
        pull, reach = u[contact[j]] - rest[j], limit[j] / k[j]
        beyond = abs(pull) - reach
        if slide[j] == 0.0 and blur < beyond <= _ROUNDED * blur and pull * v[contact[j]] <= 0.0:
            rest[j] += pull - np.copysign(reach, pull)


@inner_with_arrays
def next_event(slips, wave, beat, springs, horizon, sought, room):
    """First time up to ``horizon`` at which a spring sticks or slips, and that spring (-1: none)."""
    contact, k, limit, rest, slide, _ = springs
    u, v, terms, before, after = room
    steps = max(int(np.ceil(horizon / sought[0])), 1)
    dt = horizon / steps
    fade = np.exp(-beat[0] * dt)
    for r in range(wave.shape[1]):
        wave[NOW_RE, r], wave[NOW_IM, r] = wave[RE, r], wave[IM, r]
        wave[COS, r], wave[SIN, r] = fade * np.cos(wave[OMEGA, r] * dt), fade * np.sin(wave[OMEGA, r] * dt)
    anything = False
    for j in range(len(k)):
        anything = anything or slide[j] != 0.0
    for n in range(steps + 1):
        if n > 0:
            turn(wave)
        present(wave, beat, n * dt)
        matvec(slips, wave[X], u)
        if anything or n == 0:
            matvec(slips, wave[V], v)
        if n == 0:
            settle(springs, u, v, sought[1])
        found, when, ready = -1, 2.0, False
        for j in range(len(k)):
            i, spring = contact[j], (slide[j], k[j], limit[j], rest[j])
            after[j] = excess(spring, u[i], v[i], sought)
            if n > 0 and after[j] > 0.0:
                if not ready:
                    # back to the start of the interval
                    c, s, size = wave[COS], wave[SIN], fade * fade
                    for r in range(wave.shape[1]):
                        a, b = wave[NOW_RE, r], wave[NOW_IM, r]
                        wave[NOW_RE, r], wave[NOW_IM, r] = (a * c[r] + b * s[r]) / size, (b * c[r] - a * s[r]) / size
                    ready = True
                count = series(slips[i], wave, beat, (n - 1) * dt, dt, terms)
                at = crossing(terms[:count], dt, spring, sought, (before[j], after[j]))
                if at < when:
                    found, when = j, at
        if found >= 0:
            return (n - 1 + when) * dt, found
        for j in range(len(k)):
            before[j] = after[j]
    return horizon, -1


@inner_with_arrays
def change(springs, j, u, lost):
    """Let one spring stick or slip at relative displacement u."""
    contact, k, limit, rest, slide, begun = springs
    if slide[j] == 0.0:
        slide[j] = 1.0 if u > rest[j] else -1.0
        begun[j] = u
    else:
        lost[contact[j]] += limit[j] * abs(u - begun[j])
        rest[j] = u - slide[j] * limit[j] / k[j]
        slide[j] = 0.0


@inner_with_arrays
def pulls(springs, force):
    """Constant part of the contact forces of a phase."""
    contact, k, limit, rest, slide, _ = springs
    force[:] = 0.0
    for j in range(len(k)):
        force[contact[j]] += k[j] * rest[j] if slide[j] == 0.0 else -slide[j] * limit[j]


@inner_with_arrays
def keep(sample, slip, state, springs, lost, samples):
    """One sample: modal state, forces of the springs and friction loss of the contacts so far."""
    (contact, k, limit, rest, slide, begun), (q, p) = springs, state
    out_q, out_p, out_force, out_lost, _ = samples
    copy_into(out_q[sample], q)
    copy_into(out_p[sample], p)
    copy_into(out_lost[sample], lost)
    u = np.empty(slip.shape[0])
    matvec(slip, q, u)
    for j in range(len(k)):
        i = contact[j]
        if slide[j] == 0.0:
            out_force[sample, j] = k[j] * (u[i] - rest[j])
        else:
            out_force[sample, j] = slide[j] * limit[j]
            out_lost[sample, i] += limit[j] * abs(u[i] - begun[j])


@compiled()
def follow(clock, sought, structure, springs, state, books_of, harmonic, phases):
    """Go on from event to event until a sample is kept.

    clock: ``numbers``, which say where the motion is, times of the samples, the last sample, and changes without
    progress at most. structure: squared frequencies, rows of the relative displacements and stiffness of the contacts
    in the stuck structure, half the decay. springs: contact, stiffness, limit, where they rest, how they slide, where
    that began. state: q, p. books_of: friction loss and time of sliding of every contact, loss to damping and work of
    the load, samples. harmonic: modal load, rad/s and rad. phases: see ``phase_kernels``. Returns False where springs
    change without end.
    """
    (numbers, times, last, most), (squares, slip, total, half), (load, pulse, angle) = clock, structure, harmonic
    (contact, k, _, _, slide, _), (lost, slid, booked, samples), (q, p) = springs, books_of, state
    wave, force, beat = np.zeros((12, len(squares))), np.empty(len(total)), (half, pulse)
    room = (np.zeros(len(total)), np.zeros(len(total)), np.empty(TERMS), np.empty(len(k)), np.empty(len(k)))
    here, speed = np.empty(len(squares)), np.empty(len(squares))
    end = times[len(times) - 1]
    while numbers[SAMPLE] <= last:
        now, sample = numbers[NOW], int(numbers[SAMPLE])
        n = phase_of(springs, (squares, slip, total), phases, int(numbers[PHASE]), int(numbers[CHANGED]))
        modes = phases[0][n], phases[1][n], phases[2][n]
        pulls(springs, force)
        begin(wave, modes, state, force, beat, (load, pulse * now + angle))
        length, spring = next_event(modes[2], wave, beat, springs, min(end - now, HORIZON) + 1e-12, sought, room)
        while sample < len(times) and times[sample] <= now + length:
            motion(wave, beat, times[sample] - now)
            matvec(modes[1], wave[X], here)
            matvec(modes[1], wave[V], speed)
            keep(sample, slip, (here, speed), springs, lost, samples)
            damped, worked = books(wave, beat, times[sample] - now)
            samples[4][sample, 0], samples[4][sample, 1] = booked[0] + damped, booked[1] + worked
            sample += 1
        damped, worked = books(wave, beat, length)
        booked[0] += damped
        booked[1] += worked
        motion(wave, beat, length)
        matvec(modes[1], wave[X], q)
        matvec(modes[1], wave[V], p)
        for j in range(len(k)):
            slid[contact[j]] += length * abs(slide[j])
        numbers[NOW], numbers[SAMPLE], numbers[PHASE], numbers[CHANGED] = now + length, sample, n, spring
        if spring >= 0:
            numbers[EVENTS] += 1
            u = 0.0
            for r in range(len(squares)):
                u += slip[contact[spring], r] * q[r]
            change(springs, spring, u, lost)
        numbers[HALTED] = numbers[HALTED] + 1 if length < 1e-14 else 0
        if numbers[HALTED] > most:
            return False
    return True

"""Compiled modes of a piecewise linear structure for every pattern of stuck and sliding springs.

From one pattern to the next a single spring changes, which adds a matrix of rank one to the stiffness: the new modes
follow from the roots of the secular equation (Golub 1973) and, to keep them orthogonal, from the vector that has
exactly these roots (Gu and Eisenstat 1994). Modes are kept, and found again by their pattern.
"""

import numpy as np

from ema.compiled import compiled, fast_with_arrays, inner_with_arrays
from ema.contact.linear_kernels import add_rows, copy_into, copy_table

NEGLIGIBLE = 1e-17
"""Share of the largest component of the update below which a component changes no mode."""


@fast_with_arrays
def sums(gaps, weights, shift, split):
    """Sum of w/(gap - shift), and of w/(gap - shift)^2 up to and beyond ``split``."""
    total, left, right = 0.0, 0.0, 0.0
    for i in range(split + 1):
        term = 1.0 / (gaps[i] - shift)
        total += weights[i] * term
        left += weights[i] * term * term
    for i in range(split + 1, len(gaps)):
        term = 1.0 / (gaps[i] - shift)
        total += weights[i] * term
        right += weights[i] * term * term
    return total, left, right


@inner_with_arrays
def root(poles, weights, j, end, gaps):
    """Root of 1 + sum w/(d - x) between pole j and the next (``end`` after the last).

    Returns the nearer pole and the distance from it; iteration by Li (LAPACK working note 89, 1993), kept in a bracket.
    ``gaps`` is room to work in.
    """
    size = len(poles)
    last = j == size - 1
    width = (end if last else poles[j + 1]) - poles[j]
    for i in range(size):
        gaps[i] = poles[i] - poles[j]
    origin, low, high = j, 0.0, width
    value = 1.0 + sums(gaps, weights, 0.5 * width, j)[0]
    if value > 0.0 or last:
        low, high = (0.0, 0.5 * width) if value > 0.0 else (0.5 * width, width)
    else:
        origin, low, high = j + 1, -0.5 * width, 0.0
        for i in range(size):
            gaps[i] = poles[i] - poles[j + 1]
    near, far = (0.0, width) if origin == j else (-width, 0.0)
    shift = 0.5 * (low + high)
    for _ in range(80):
        total, left, right = sums(gaps, weights, shift, j)
        value = 1.0 + total
        if value > 0.0:
            high = shift
        else:
            low = shift
        one, two = near - shift, far - shift
        a = (one + two) * value - one * two * (left + right)
        b, c = one * two * value, value - one * left - two * right
        square = np.sqrt(max(a * a - 4.0 * b * c, 0.0))
        if a <= 0.0:
            move = (a - square) / (2.0 * c) if c != 0.0 else 0.0
        else:
            move = 2.0 * b / (a + square)
        new = shift + move
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - shift) <= 4e-16 * abs(new) or new == shift:
            shift = new
            break
        shift = new
    return origin, shift


@compiled(fastmath={"contract", "nsz"})
def updated_modes(squares, row, stiffness, rotation):
    """Squared frequencies after a spring ``stiffness`` at the modal ``row`` is added (removed where negative).

    ``rotation`` returns the new modes in the old ones. Returns the squares in no particular order, and whether all is
    well; where poles coincide the matrix has to be solved as a whole.
    """
    count, sign = len(squares), 1.0 if stiffness > 0.0 else -1.0
    limit, close = 0.0, 0.0
    order, moved, result = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count)
    for i in range(count):
        limit, close = max(limit, NEGLIGIBLE * abs(row[i])), max(close, 1e-14 * abs(squares[i]))
        result[i] = squares[i]
        place = i
        while place > 0 and sign * squares[order[place - 1]] > sign * squares[i]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = i
        for j in range(count):
            rotation[i, j] = 0.0
    size = 0
    for place in order:
        if abs(row[place]) > limit:
            moved[size] = place
            size += 1
        else:
            rotation[place, place] = 1.0
    poles, weights, z = np.empty(size), np.empty(size), np.empty(size)
    for i in range(size):
        poles[i], z[i] = sign * squares[moved[i]], row[moved[i]]
        weights[i] = abs(stiffness) * z[i] * z[i]
        if i > 0 and poles[i] - poles[i - 1] <= close:
            return result, False
    if size == 0:
        return result, True
    distance, gaps = np.empty((size, size)), np.empty(size)
    end = poles[size - 1]
    for weight in weights:
        end += weight * (1.0 + 1e-15)
    for j in range(size):
        origin, shift = root(poles, weights, j, end, gaps)
        result[moved[j]] = sign * (poles[origin] + shift)
        for i in range(size):
            distance[j, i] = (poles[i] - poles[origin]) - shift
    for i in range(size):
        # the component for which the roots are exact
        square = -distance[size - 1, i]
        for j in range(i):
            square *= distance[j, i] / (poles[i] - poles[j])
        for j in range(i, size - 1):
            square *= distance[j, i] / (poles[i] - poles[j + 1])
        z[i] = np.sqrt(abs(square)) if z[i] > 0.0 else -np.sqrt(abs(square))
    for j in range(size):
        length = 0.0
        for i in range(size):
            gaps[i] = z[i] / distance[j, i]
            length += gaps[i] * gaps[i]
        length = 1.0 / np.sqrt(length)
        for i in range(size):
            rotation[moved[i], moved[j]] = gaps[i] * length
    return result, True


@inner_with_arrays
def find(sliding, keys, slots):
    """Find a pattern of sticking and sliding in the hashed table of phases: the slot where it is, or where it belongs.

    ``sliding`` (contact,) is nonzero where a contact slides, ``keys`` (phase, contact) are the patterns of the phases
    known, and ``slots`` their rows, negative where a slot is free.
    """
    code = np.uint64(1469598103934665603)
    for j in range(len(sliding)):
        code = (code ^ np.uint64(sliding[j] != 0.0)) * np.uint64(1099511628211)
    place = np.int64(code >> np.uint64(20)) % len(slots)
    while slots[place] >= 0:
        same = True
        for j in range(len(sliding)):
            if keys[slots[place], j] != (sliding[j] != 0.0):
                same = False
                break
        if same:
            break
        place = (place + 1) % len(slots)
    return place


@inner_with_arrays
def solve_whole(springs, structure, phases, number):
    """Modes of a pattern from its whole matrix."""
    (contact, k, _, _, sliding, _), (squares, slip, total) = springs, structure
    matrix, stuck = np.zeros((len(squares), len(squares))), np.empty(len(total))
    for r in range(len(squares)):
        matrix[r, r] = squares[r]
    for i in range(len(total)):
        stuck[i] = -total[i]
    for j in range(len(sliding)):
        if sliding[j] == 0.0:
            stuck[contact[j]] += k[j]
    for i in range(len(stuck)):
        for r in range(len(squares)):
            weight = stuck[i] * slip[i, r]
            if weight != 0.0:
                for s in range(len(squares)):
                    matrix[r, s] += weight * slip[i, s]
    values, vectors = np.linalg.eigh(matrix)
    all_squares, all_vectors, all_slips, _, _, _ = phases
    copy_into(all_squares[number], values)
    copy_table(all_vectors[number], vectors)
    np.dot(slip, all_vectors[number], all_slips[number])


@inner_with_arrays
def phase_of(springs, structure, phases, before, changed):
    """Number of the modes of a pattern; ``before`` is that of a pattern in which spring ``changed`` alone differs.

    springs: as in ``event_kernels``. structure: squared frequencies, rows of the relative displacements and stiffness
    of the contacts in the stuck structure. phases: squares, vectors and rows of all modes that are kept, their
    patterns, the table of places, and how many there are.
    """
    (contact, k, _, _, sliding, _), squares = springs, structure[0]
    all_squares, all_vectors, all_slips, keys, slots, used = phases
    place = find(sliding, keys, slots)
    if slots[place] >= 0:
        return slots[place]
    if used[0] == len(keys):
        # full: forget all but the table itself
        slots[:] = -1
        used[0], before = 0, -1
        place = find(sliding, keys, slots)
    number = used[0]
    done = False
    if before >= 0:
        rotation = np.empty((len(squares), len(squares)))
        spring = k[changed] if sliding[changed] == 0.0 else -k[changed]
        values, done = updated_modes(all_squares[before], all_slips[before, contact[changed]], spring, rotation)
        if done:
            copy_into(all_squares[number], values)
            np.dot(all_vectors[before], rotation, all_vectors[number])
            np.dot(all_slips[before], rotation, all_slips[number])
    if not done:
        solve_whole(springs, structure, phases, number)
    used[0] += 1
    slots[place] = number
    for j in range(len(sliding)):
        keys[number, j] = sliding[j] != 0.0
    return number


@fast_with_arrays
def into_modes(vectors, q, out):
    """out = vectors.T @ q."""
    for r in range(len(out)):
        out[r] = 0.0
    add_rows(vectors, q, out)

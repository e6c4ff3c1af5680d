"""Products of small matrices and vectors, written out: shorter to compile than those of numpy, and faster."""

from ema.compiled import fast, inner


@fast
def matvec(matrix, vector, out):
    """out = matrix @ vector for small matrices: four rows at a time share the loads of the vector."""
    rows, columns = matrix.shape
    i = 0
    while i + 4 <= rows:
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for j in range(columns):
            x = vector[j]
            a += matrix[i, j] * x
            b += matrix[i + 1, j] * x
            c += matrix[i + 2, j] * x
            d += matrix[i + 3, j] * x
        out[i], out[i + 1], out[i + 2], out[i + 3] = a, b, c, d
        i += 4
    while i < rows:
        a = 0.0
        for j in range(columns):
            a += matrix[i, j] * vector[j]
        out[i] = a
        i += 1


@fast
def add_rows(matrix, weights, out):
    """out += weights @ matrix, four rows at a time; rows without weight cost nothing."""
    rows, columns = matrix.shape
    a, b, c, d, i = 0, 0, 0, 0, 0
    while i < rows:
        wa, wb, wc, wd, count = 0.0, 0.0, 0.0, 0.0, 0
        while i < rows and count < 4:
            weight = weights[i]
            if weight != 0.0:
                a, b, c, d = b, c, d, i
                wa, wb, wc, wd = wb, wc, wd, weight
                count += 1
            i += 1
        if count > 0:
            for j in range(columns):
                out[j] += wa * matrix[a, j] + wb * matrix[b, j] + wc * matrix[c, j] + wd * matrix[d, j]


@inner
def copy_into(out, values):
    """out[:] = values, written out: the compiler then needs no sentence about shapes, which takes it seconds."""
    for i in range(len(out)):
        out[i] = values[i]


@inner
def copy_table(out, values):
    """The same for two axes."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@fast
def eliminate(matrix, rhs, count):
    """Solve the leading ``count`` equations in place by elimination with partial pivoting."""
    for n in range(count):
        best = n
        for i in range(n + 1, count):
            if abs(matrix[i, n]) > abs(matrix[best, n]):
                best = i
        if best != n:
            rhs[n], rhs[best] = rhs[best], rhs[n]
            for j in range(n, count):
                matrix[n, j], matrix[best, j] = matrix[best, j], matrix[n, j]
        for i in range(n + 1, count):
            weight = matrix[i, n] / matrix[n, n]
            if weight != 0.0:
                rhs[i] -= weight * rhs[n]
                for j in range(n + 1, count):
                    matrix[i, j] -= weight * matrix[n, j]
    for n in range(count - 1, -1, -1):
        total = rhs[n]
        for j in range(n + 1, count):
            total -= matrix[n, j] * rhs[j]
        rhs[n] = total / matrix[n, n]

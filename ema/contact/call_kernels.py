"""How a friction law reaches a compiled solver: by the address of its compiled function.

A law is compiled on its own, once, and the solvers once for all laws: a further law costs only its own compilation. One
call serves a whole group of contacts, so that calling by address costs nothing that could be measured.
"""

from typing import Any

import numba as nb
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ema.compiled import inner

# rows of the table (row, contact) in which solver and law exchange the numbers of a step. BY_FORCE is that of laws with
# one internal force: how the new one follows the old one. CROSS: slope by the way in the other direction. PRESSURE and
# BY_GAP, of normal contacts: the normal force, and its slope by the way
STIFFNESS, LIMIT, WAY, EXCESS, FORCE, SLOPE, BY_FORCE, CROSS, PRESSURE, BY_GAP = range(10)
ROWS = 10
"""Rows of that table."""
# columns of the table of groups; ACROSS: rows from a contact to that of the same pair in the other direction, LINE: the
# law in one direction that a law in two directions calls
ADDRESS, FIRST, END, OWN, ACROSS, LINE = range(6)
COLUMNS = 6
"""Columns of that table."""
BRISTLE, BY_RATE, WAY_BEFORE = range(3)
"""States of a law whose force depends on velocities: the force of its bristles, what the velocity adds to it, and the
way in the increment before, from which the velocity at the end of the next one is extrapolated."""

_TABLE = nb.float64[:, ::1]
_TABLES, _STATES = types.Tuple((_TABLE, nb.float64[:, :, ::1])), types.UniTuple(_TABLE, 2)
INCREMENT = nb.void(nb.int64[::1], nb.float64, _TABLES, _TABLE, _STATES)
"""What every law is compiled for: ``law(group, rate, tables, exchange, states)``, with its parameters and the curves in
``tables``, and the states before and after."""


def address(law: Any) -> int:
    """Address of a law, which is compiled by then, in the calling convention of compiled code."""
    law.compile(INCREMENT)
    result = law.overloads[INCREMENT.args]
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


@intrinsic
def increments(typingctx, group_address, group, rate, tables, exchange, states):
    """Let the law at ``group_address`` take an increment at all contacts of its group."""

    def codegen(context, builder, signature, arguments):
        """The call in the calling convention of compiled code; an error of the law is passed on."""
        kind = context.call_conv.get_function_type(types.void, INCREMENT.args)
        pointer = builder.inttoptr(arguments[0], kind.as_pointer())
        status, _ = context.call_conv.call_function(builder, pointer, types.void, INCREMENT.args, arguments[1:])
        with cgutils.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.void(types.int64, *INCREMENT.args), codegen


@intrinsic
def own_force(typingctx, function_address, force, way, contact, parameters):
    """Force of a user's law, compiled as a C function; ``contact``: stiffness and slip force, and four parameters."""

    def codegen(context, builder, signature, arguments):
        """The call in the calling convention of C."""
        number = ir.DoubleType()
        pointer = builder.inttoptr(arguments[0], ir.FunctionType(number, [number] * 8).as_pointer())
        numbers = [number for part in arguments[3:] for number in cgutils.unpack_tuple(builder, part)]
        return builder.call(pointer, [*arguments[1:3], *numbers])

    pair, four = types.UniTuple(types.float64, 2), types.UniTuple(types.float64, 4)
    return types.float64(types.int64, types.float64, types.float64, pair, four), codegen


@inner
def evaluate(laws, rate, exchange, before, after):
    """Let every group of contacts take its increment."""
    groups, parameters, curves = laws[0], laws[1], laws[2]
    for n in range(len(groups)):
        increments(groups[n, ADDRESS], groups[n], rate, (parameters, curves), exchange, (before, after))

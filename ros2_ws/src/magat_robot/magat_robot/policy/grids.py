# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The grids of fixed point: units and ranges of values; `fixed_point` explains them. Free of torch."""

import functools
import math

#: Activations are multiples of 2**-ACTIVATION_BITS ...
ACTIVATION_BITS = 6
#: ... from 0 to ACTIVATION_MAX. In training they are clamped to the same range.
ACTIVATION_MAX = 8.0
#: Upper limit of unnormalised sums over a robot's neighbours.
SUM_MAX = 2.0**11
#: Signed values (attention queries, logits) lie within +-SIGNED_MAX.
SIGNED_MAX = 64.0
#: Exponents (attention scores, logits over temperature) and messages are multiples of 2**-EXPONENT_BITS.
EXPONENT_BITS = 8
#: Values of exp() are rounded to multiples of 2**-EXP_TABLE_BITS.
EXP_TABLE_BITS = 24


@functools.cache
def exp_table() -> tuple[int, ...]:
    """Entry k is ``round(2**EXP_TABLE_BITS * exp(-k / 2**EXPONENT_BITS))``; the last entry is 0."""
    size = math.ceil((EXP_TABLE_BITS + 1) * math.log(2) * 2**EXPONENT_BITS) + 1
    return (*(round(2**EXP_TABLE_BITS * math.exp(-k / 2**EXPONENT_BITS)) for k in range(size)), 0)

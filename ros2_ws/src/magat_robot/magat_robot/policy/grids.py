"""The grids that a deployed policy computes on, as numbers; `fixed_point` says what they are for. Free of torch."""

#: Activations are multiples of 2**-ACTIVATION_BITS ...
ACTIVATION_BITS = 6
#: ... from 0 to ACTIVATION_MAX (rectified). In training they are clamped the same way.
ACTIVATION_MAX = 8.0
#: What a robot adds up over its neighbours, unweighed, is cut off here.
SUM_MAX = 2.0**11
#: Signed intermediates (attention queries, logits) lie within +-SIGNED_MAX.
SIGNED_MAX = 64.0
#: Exponents (attention scores, logits over temperature) and messages are multiples of 2**-EXPONENT_BITS.
EXPONENT_BITS = 8

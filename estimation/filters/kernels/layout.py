"""Indices into the vector of numbers and addresses that a compiled filter takes of a model."""

from __future__ import annotations

# Addresses of the functions; states of the machine, all states, inputs, parameters, outputs of the machine,
# measured channels, readouts of latent states, length of a stored row, exact or central derivatives.
RHS, RHS_T, OUT, OUT_T, N, ALL, N_U, N_P, N_Y, M, N_READ, LD, EXACT, GENERIC = range(14)
# Addresses of arrays: parameters as given and as used, inputs as used; drift of the latent states; for each
# readout its latent state, kind (0 input, 1 parameter), index and weight; for each channel its kind (0 state,
# 1 rate of a state, 2 output) and index;
P_0, P, U, DRIFT, READ_STATE, READ_KIND, READ_INDEX, READ_WEIGHT, CHANNEL_KIND, CHANNEL_INDEX = range(14, 24)
# directions; outputs; steps of the central differences; two columns; sizes that balance the Jacobian; bounds of
# all states.
X_DOT, U_DOT, P_DOT, Y, STEPS, A, B, BALANCE, LOW, HIGH = range(24, 34)
# Tangents that carry all directions at once, or zero; those directions, a row of LD for each element.
RHS_W, OUT_W, X_WIDE, U_WIDE, P_WIDE = range(34, 39)
# Speeds at which narrow features are passed: their address and number, the widths, and room for the speeds.
SPEEDS, N_SPEEDS, WIDTHS, PACES = range(39, 43)
# Largest step of the integration, one number.
LARGEST = 43
SIZE = 44

#: Discretisation: how F follows from the Jacobian.
EXPONENTIAL, EULER, VARIATIONAL = 0, 1, 2
#: Kinds of process noise: a density integrated over the step, the density times the step, or per step.
INTEGRATED, TIMES_STEP, PER_STEP = 0, 1, 2
#: What is kept of each step.
VARIANCES, COVARIANCES, EVERYTHING = 0, 1, 2

"""What planners run on: compiled programs and their store, batches, budgets of time, keys, files."""

#: The greatest seed: PRNG keys are made from 32 bits of it.
MAX_SEED = 2**32 - 1

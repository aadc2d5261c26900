"""What planners run on: compiled programs and their store, batches, budgets of time, keys, files."""

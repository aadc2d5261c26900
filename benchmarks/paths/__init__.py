"""Path problems by seed, their quickest paths known, and what tells how good and how clear a path is."""

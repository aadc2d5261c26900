"""Changed real files for every reader: read, or refused by one line, and nothing else is touched."""

"""What pictures, films, pages and sheets show of a run, worked out once; what draws it is elsewhere."""

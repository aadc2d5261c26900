"""The paper's simulation study (section 4) over again: figures, claims judged, readings of its text."""

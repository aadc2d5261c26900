"""An extension of griffe: a docstring's "Example:" is read as the section "Examples:" of the convention."""

import re
from typing import Any

import griffe


class Examples(griffe.Extension):
    """Renames the section where it is read, so that its code is shown as code."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """See `griffe.Extension`."""
        if obj.docstring:
            obj.docstring.value = re.sub(r"^Example:$", "Examples:", obj.docstring.value, flags=re.MULTILINE)

"""Names of the last version, which still work and warn."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a name goes in the next version."""
    warnings.warn(
        f"{old} is now {new}; the old name goes in the next version", DeprecationWarning, stacklevel
    )


def renamed_arguments(**names: str) -> Callable[[F], F]:
    """Accept keyword arguments by their old names too.

    Args:
        names: the new name of each old one.
    """

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def accepting(*arguments: Any, **more: Any) -> Any:
            for old, new in names.items():
                if old in more:
                    warn_renamed(f"{function.__name__}({old}=)", f"{new}=")
                    if new in more:
                        raise TypeError(f"{function.__name__} got both {old} and {new}")
                    more[new] = more.pop(old)
            return function(*arguments, **more)

        return accepting  # type: ignore[return-value]

    return decorate

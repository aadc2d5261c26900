"""Arrays and plain data as a page holds them: small, and the same bytes for the same values."""

import base64
import json
import math
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

#: NumPy's name of each kind of number that pages unpack, by the name that stands in the page.
_KINDS = {"f32": "<f4", "i16": "<i2", "i32": "<i4"}

#: What would end a script or a line of it, by what stands for it within JSON.
_UNSAFE = {
    "<": "\\u003c",
    ">": "\\u003e",
    "&": "\\u0026",
    "\u2028": "\\u2028",
    "\u2029": "\\u2029",
}


def packed(values: ArrayLike, kind: str = "f32", step: float = 1.0) -> dict[str, Any]:
    """Return an array as base64 of its little-endian bytes.

    Args:
        values: of any shape.
        kind: "f32", "i16" or "i32"; integers are rounded and must be finite.
        step: what one unit of the stored numbers is worth.
    """
    scaled = np.asarray(values, float) / step
    rounded = scaled if kind == "f32" else np.rint(scaled)
    data = np.ascontiguousarray(rounded, _KINDS[kind])
    return {
        "kind": kind,
        "shape": list(data.shape),
        "step": step,
        "data": base64.b64encode(data.tobytes()).decode("ascii"),
    }


def script_json(data: Any) -> str:
    """Return JSON that may stand in a script element whatever its texts hold."""
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for sign, instead in _UNSAFE.items():
        text = text.replace(sign, instead)
    return text


def plain(data: Any) -> Any:
    """Return data of Python's own types, seven digits of every number; what is no number is None."""
    if isinstance(data, dict):
        return {str(name): plain(value) for name, value in data.items()}
    if isinstance(data, list | tuple):
        return [plain(value) for value in data]
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    if isinstance(data, np.generic):
        return plain(data.item())
    if isinstance(data, float):
        return float(f"{data:.7g}") if math.isfinite(data) else None
    if isinstance(data, datetime):
        return data.isoformat()
    return data

"""Values as they stand in TOML files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np


def toml_value(value: Any) -> str:
    """A value as it stands in a TOML file."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON's escapes are valid in TOML too. TOML requires one more character to be escaped.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, (Sequence, np.ndarray)):
        return f"[{', '.join(toml_value(part) for part in value)}]"
    raise TypeError(f"a file of Isotherm has no values of the type {type(value).__name__}")

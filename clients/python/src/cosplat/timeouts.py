"""How long somebody waits."""

from __future__ import annotations

import math


def seconds(timeout: float) -> float:
    """A timeout [s] as a number: 0 for what is below, as for a deadline that has passed; infinite for as long as it takes.

    Raises TypeError for what is no number, and ValueError for NaN.
    """
    try:
        number = math.fsum([timeout])
    except OverflowError:
        return math.inf if timeout > 0 else 0.0
    except TypeError:
        raise TypeError(f"the timeout is {timeout!r}, expected a number of seconds") from None
    if math.isnan(number):
        raise ValueError(f"the timeout is {number}, expected a number of seconds")
    return max(0.0, number)

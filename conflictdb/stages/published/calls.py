"""Count the calls of the published programs."""

from dataclasses import dataclass


@dataclass(slots=True)
class Programs:
    """Calls of each program, and calls that missed a contact."""

    lp_calls: int = 0
    nlp_calls: int = 0
    failed_calls: int = 0

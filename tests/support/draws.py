"""How many random cases a test draws: a few in the usual run, many with `-m slow`."""

import pytest


def draws(name: str, usual: int, slow: int) -> pytest.MarkDecorator:
    """Return the parametrization of a test by its number of draws, an argument of that name."""
    return pytest.mark.parametrize(
        name, [pytest.param(usual, id=f"{usual}"), pytest.param(slow, id=f"{slow}", marks=pytest.mark.slow)]
    )

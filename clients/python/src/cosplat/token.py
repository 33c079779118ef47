"""The token that requests to a gateway show: who has it may give orders."""

from __future__ import annotations

import os
import secrets

from .errors import WrongToken

VARIABLE = "COSPLAT_TOKEN"
"""The environment variable that gateways and programs on other machines take it from."""
LEAST = 16
"""Shortest token [character]."""


def new() -> str:
    """A token of 128 random bits, 32 hexadecimal digits, like that of the page."""
    return secrets.token_hex(16)


def checked(token: str) -> str:
    """The same token. Raises WrongToken for one that could be guessed."""
    if len(token) < LEAST:
        raise WrongToken(f"the token has {len(token)} characters, expected at least {LEAST}")
    return token


def from_env() -> str | None:
    """The token of COSPLAT_TOKEN; None where it is not set, or empty. Raises WrongToken for one that is too short."""
    token = os.environ.get(VARIABLE)
    return checked(token) if token else None

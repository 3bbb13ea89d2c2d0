"""Short names that stay distinct: cut, with a digest of the whole at their end."""

from __future__ import annotations

import hashlib


def ending_in_digest(shown: str, whole: str, longest: int) -> str:
    """`shown`, cut to leave room, and 8 hexadecimal digits of the digest of `whole`.

    The result has `longest` characters at most.
    """
    digest = hashlib.sha256(whole.encode()).hexdigest()[:8]
    return f"{shown[: longest - 9]}-{digest}"

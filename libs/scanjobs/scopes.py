"""What a caller may do. Pure data."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Scope(StrEnum):
    """What a key is good for; each includes the ones before it."""

    READ = "read"
    SUBMIT = "submit"
    ADMIN = "admin"


ORDER: Final = tuple(Scope)
LOCAL_OWNER: Final = "local"


@dataclass(frozen=True, slots=True, kw_only=True)
class Principal:
    """Who a request acts for, and what it may do."""

    owner: str
    scopes: frozenset[Scope]
    key_id: str | None = None
    requests_per_minute: int | None = None

    def may(self, scope: Scope) -> bool:
        """Whether this scope, or one that includes it, was given."""
        return any(given in self.scopes for given in ORDER[ORDER.index(scope) :])


LOCAL: Final = Principal(owner=LOCAL_OWNER, scopes=frozenset(Scope))
"""Who uses a service that runs on his own machine."""

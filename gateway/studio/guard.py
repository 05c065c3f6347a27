"""Who may see the pages: on this machine anybody, from elsewhere whoever has the token.

The token stands in the address that is printed once; the first visit turns it into a cookie that
scripts cannot read and pages of other sites cannot send.
"""

import hmac
import secrets
from collections.abc import Callable
from typing import Any

from bokeh.server.auth_provider import AuthProvider
from tornado.web import RequestHandler

COOKIE = "shadow_studio"
REFUSED = "Open the address that `shadow studio` printed: it ends in ?token=…"


def new_token() -> str:
    """A secret that nobody guesses."""
    return secrets.token_urlsafe(24)


class Refusal(RequestHandler):  # type: ignore[misc]
    """What those without a token see."""

    def get(self) -> None:
        """One line, status 403."""
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(REFUSED)


class Guard(AuthProvider):  # type: ignore[misc]
    """What Bokeh's server asks before it opens a page or a websocket."""

    def __init__(self, token: str) -> None:
        self._token = token
        super().__init__()

    @property
    def get_user(self) -> Callable[[Any], str | None]:
        """Handler -> a name, or None for whoever has no token."""

        def user(handler: Any) -> str | None:
            if self._is(handler.get_cookie(COOKIE)):
                return "guest"
            if not self._is(handler.get_query_argument("token", None)):
                return None
            handler.set_cookie(COOKIE, self._token, httponly=True, samesite="Strict", path="/")
            return "guest"

        return user

    @property
    def get_user_async(self) -> None:
        """Not needed."""
        return None

    @property
    def login_url(self) -> str:
        """Where those without a token are sent."""
        return "/refused"

    @property
    def get_login_url(self) -> None:
        """It is always the same."""
        return None

    @property
    def login_handler(self) -> type[Refusal]:
        """What is there."""
        return Refusal

    @property
    def logout_url(self) -> None:
        """There is no need to leave."""
        return None

    @property
    def logout_handler(self) -> None:
        """There is no need to leave."""
        return None

    def _is(self, given: str | None) -> bool:
        return given is not None and hmac.compare_digest(given.encode(), self._token.encode())

"""Access: which files the pages may read and write, and which browsers may see the pages.

Files lie in the folders that were given, and nowhere else. On this machine everybody sees the
pages; from elsewhere a token is needed. It stands in the address that is printed once; the first
visit turns it into a cookie that scripts cannot read and pages of other sites cannot send. Requests
are answered only under the names that the server was given.
"""

import hmac
import os
import re
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

from bokeh.server.auth_provider import AuthProvider
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher
from tornado.web import RequestHandler

from gateway.errors import BadInput, ShadowError
from gateway.ingest.open import suffixes
from gateway.vessel_file import read_vessel_file

FILE_NAME = re.compile(r"[\w][\w .+-]{0,80}\.toml")
LOG_NAME = re.compile(r"[\w][\w .+()-]{0,120}")
TABLES = ("[dynamics]", "[hull]")  # by which a vessel file is recognised
LONGEST_NAME = 245  # bytes: file systems take 255, and while it is written it has a longer one
LARGEST_VESSEL = 1_000_000  # bytes
COOKIE = "shadow_studio"
UNKNOWN_HOST = "The studio does not know itself under this name: start it with --origin HOST:PORT"
REFUSED = "Open the address that `shadow studio` printed: it ends in ?token=…"


@dataclass(frozen=True)
class Folders:
    """Folders to read from, and the one that is written to."""

    read: tuple[Path, ...]
    write: Path

    @classmethod
    def of(cls, files: Iterable[Path], folders: Iterable[Path], write: Path) -> "Folders":
        """The folders named and those that the files lie in."""
        every = [*folders, *(file.parent for file in files)]
        resolved = dict.fromkeys(folder.resolve() for folder in every)
        for folder in resolved:
            if not folder.is_dir():
                raise BadInput(f"{folder}: no such folder")
        return cls(tuple(resolved), write.resolve())

    def recordings(self) -> list[Path]:
        """All recordings, by name."""
        return self._files(lambda file: file.suffix.lower() in suffixes())

    def vessels(self) -> list[Path]:
        """All vessel files, by name; also those saved."""
        return self._files(_is_vessel)

    def refused_vessels(self) -> dict[Path, str]:
        """Files that look like a vessel's and are none, each with the reason."""
        out: dict[Path, str] = {}
        for file in self._files(_looks_like_vessel):
            try:
                read_vessel_file(file)
            except ShadowError as error:
                out[file] = " ".join(str(error).split()).replace(f"{file.parent}/", "")
        return out

    def checked(self, path: str | Path) -> Path:
        """A path that may be read; BadInput for every other."""
        file = Path(path).resolve()
        if file.parent not in (*self.read, self.write):
            raise BadInput(f"{Path(path).name}: not in a folder that the studio was given")
        return file

    def to_save(self, name: str) -> Path:
        """Where a vessel file of that name goes: never elsewhere, never over another one."""
        if not FILE_NAME.fullmatch(name):
            raise BadInput(f"{name!r}: give a plain name that ends in .toml")
        file = self.write / name
        if _is_taken(file):
            raise BadInput(f"{name} is there already: choose another name")
        return file

    def to_add(self, name: str) -> Path:
        """Where a recording of that name goes; never over another file.

        One that is called as a recording in another folder is numbered: pages name them alike.
        """
        file = self.write / name
        if not LOG_NAME.fullmatch(name) or file.suffix.lower() not in suffixes():
            raise BadInput(f"{name!r}: no recording: expected {', '.join(sorted(suffixes()))}")
        if _is_taken(file):
            raise BadInput(f"{name} is there already")
        given = {one.name for one in self.recordings()}
        numbered = (file.with_name(f"{file.stem}-{k}{file.suffix}") for k in count(2))
        return next(one for one in chain([file], numbered)
                    if one.name not in given and not _is_taken(one))  # fmt: skip

    def _files(self, wanted: Callable[[Path], bool]) -> list[Path]:
        found: list[Path] = []
        for folder in dict.fromkeys((*self.read, self.write)):
            if folder.is_dir():
                found += [f for f in sorted(folder.iterdir()) if _plain(f, folder) and wanted(f)]
        return found


def _is_taken(file: Path) -> bool:
    """Whether a file is there; BadInput where none can have that name."""
    try:
        if len(os.fsencode(file.name)) <= LONGEST_NAME:
            return file.exists()
    except OSError:  # some file systems take less
        pass
    raise BadInput(f"{file.name}: too long for the name of a file: give it a shorter one")


def _plain(file: Path, folder: Path) -> bool:
    """A file that lies there itself: a link may lead anywhere."""
    return file.is_file() and not file.name.startswith(".") and file.resolve().parent == folder


def _is_vessel(file: Path) -> bool:
    return all(table in _text_of(file) for table in TABLES)


def _looks_like_vessel(file: Path) -> bool:
    return any(table in _text_of(file) for table in TABLES)


def _text_of(file: Path) -> str:
    """Of a TOML file as large as a vessel's may be; empty for every other."""
    if file.suffix.lower() != ".toml" or file.stat().st_size > LARGEST_VESSEL:
        return ""
    return file.read_text(encoding="utf-8", errors="replace")


def new_token() -> str:
    """A secret that cannot be guessed."""
    return secrets.token_urlsafe(24)


class OtherHost(Matcher):  # type: ignore[misc]
    """Requests under a name that the server was not given.

    A page of another site can have its own name lead to this machine (DNS rebinding): its requests
    then look like this page's own, but for the name.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names = frozenset(name.lower() for name in names)

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """Empty where the request is to be refused, as tornado has it."""
        host = (request.host or "").lower()
        return None if host in self._names or f"{host}:80" in self._names else {}


class OtherHostHandler(RequestHandler):  # type: ignore[misc]
    """Answers any request under another host's name with one line, status 403."""

    def prepare(self) -> None:
        """Answer a request of any method."""
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(UNKNOWN_HOST)


class RefusedHandler(RequestHandler):  # type: ignore[misc]
    """The page for browsers without a token: one line, status 403."""

    def get(self) -> None:
        """Answer a request."""
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(REFUSED)


class TokenAuth(AuthProvider):  # type: ignore[misc]
    """Decides for Bokeh's server who may open a page or a websocket; nobody logs out."""

    get_user_async = get_login_url = logout_url = logout_handler = None
    login_url = "/refused"
    login_handler = RefusedHandler

    def __init__(self, token: str) -> None:
        self._token = token
        super().__init__()

    @property
    def get_user(self) -> Callable[[Any], str | None]:
        """Handler -> a name, or None without the token."""

        def user(handler: Any) -> str | None:
            if self._is(handler.get_cookie(COOKIE)):
                return "guest"
            if not self._is(handler.get_query_argument("token", None)):
                return None
            handler.set_cookie(COOKIE, self._token, httponly=True, samesite="Strict", path="/")
            return "guest"

        return user

    def _is(self, given: str | None) -> bool:
        return given is not None and hmac.compare_digest(given.encode(), self._token.encode())

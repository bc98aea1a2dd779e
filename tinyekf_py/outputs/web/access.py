"""Who may do what on the web: the token, the names under which the server is known, and where a request comes from.

Nothing here does I/O but making and reading the token's file. What a client sends is compared in constant time.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import ipaddress
import os
import re
import secrets
import stat
import time
from collections import OrderedDict
from collections.abc import Collection, Mapping
from pathlib import Path

COOKIE = "tinyekf"
SESSION_S = 30 * 24 * 3600
#: Wrong tokens that one address may send within `FAILURE_WINDOW_S`; then it waits.
MAX_FAILURES = 5
FAILURE_WINDOW_S = 60.0
_REMEMBERED_ADDRESSES = 256
_HOST = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+)(?::(\d{1,5}))?")
_DEFAULT_PORTS = {"http": "80", "https": "443"}


class TokenFileError(ValueError):
    """A token's file that cannot be used: one line saying which, why and what to do."""


def token_path(configured: str, environment: Mapping[str, str]) -> Path:
    """The token's file: the configured one, the service's in $STATE_DIRECTORY, or the user's own."""
    if configured:
        return Path(configured)
    state = environment.get("STATE_DIRECTORY", "").partition(":")[0]
    if state:
        return Path(state) / "web-token"
    home = environment.get("XDG_CONFIG_HOME") or Path(environment.get("HOME") or "/") / ".config"
    return Path(home) / "tinyekf" / "token"


def token_in(path: Path) -> tuple[str, bool]:
    """The token in the file `path`, and whether it has been made just now; TokenFileError when it cannot be had."""
    try:
        try:
            made = _new_token()
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            # Written beside it and linked: never there half-written, and never over another program's.
            beside = path.with_name(f".{path.name}.{os.getpid()}")
            with os.fdopen(os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                file.write(made + "\n")
            try:
                os.link(beside, path)
            finally:
                beside.unlink()
            return made, True
        except FileExistsError:
            pass
        status = path.stat()
        if status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise TokenFileError(f"{path} can be read by others; chmod 600 {path}, or remove it for a new token")
        token = path.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise TokenFileError(
            f"no token in {path}: {error.strerror or error}; set outputs.web.token_file to a file of your own"
        ) from error
    if len(_normal(token)) < 16:
        raise TokenFileError(f"the token in {path} is shorter than 16 characters; remove the file for a new one")
    return token, False


def _new_token() -> str:
    """120 random bits, in groups that can be typed at a helm."""
    letters = base64.b32encode(secrets.token_bytes(15)).decode().lower()
    return "-".join(letters[i : i + 4] for i in range(0, len(letters), 4))


def _normal(token: str) -> bytes:
    return re.sub(r"[\s-]", "", token).lower().encode("utf-8", "replace")


class Failures:
    """Counts wrong tokens by address, and says who has to wait."""

    def __init__(self) -> None:
        self._times: OrderedDict[str, list[float]] = OrderedDict()

    def wait_s(self, address: str) -> float:
        """How long `address` has to wait before it may try again, seconds; 0 when it may."""
        now = time.monotonic()
        times = [t for t in self._times.get(_network(address), ()) if now - t < FAILURE_WINDOW_S]
        return FAILURE_WINDOW_S - (now - times[-MAX_FAILURES]) if len(times) >= MAX_FAILURES else 0.0

    def add(self, address: str) -> None:
        """Note a wrong token from `address`."""
        network = _network(address)
        times = self._times.setdefault(network, [])
        self._times.move_to_end(network)
        times.append(time.monotonic())
        del times[:-MAX_FAILURES]
        if len(self._times) > _REMEMBERED_ADDRESSES:
            self._times.popitem(last=False)


def _network(address: str) -> str:
    """What one client has: an IPv4 address, or a /64 of IPv6."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(parsed, ipaddress.IPv6Address) and parsed.ipv4_mapped is None:
        return str(ipaddress.ip_network((parsed, 64), strict=False))
    return str(parsed)


class Access:
    """The rules of one server."""

    def __init__(self, token: str | None, names: Collection[str] = (), *, read_token: bool = False) -> None:
        """Without a `token` everybody who can connect may do everything; `names` are the host names it goes by."""
        self._token = _normal(token) if token is not None else None
        self._names = {"localhost", *(name.lower().rstrip(".") for name in names)}
        self._read_token = read_token and token is not None
        self._failures = Failures()

    @property
    def needs_token(self) -> bool:
        """Whether control needs the token."""
        return self._token is not None

    def host_is_ours(self, host: str, local_address: str) -> bool:
        """Whether the Host header names this server: its own address, or a name that cannot be a stranger's.

        A page of another site whose name was pointed at us (DNS rebinding) has that site's name here.
        """
        found = _HOST.fullmatch(host)
        if not found:
            return False
        name = found[1].strip("[]").lower().rstrip(".")
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return name in self._names
        local = ipaddress.ip_address(local_address.partition("%")[0])
        if isinstance(local, ipaddress.IPv6Address) and local.ipv4_mapped is not None:
            local = local.ipv4_mapped
        return address == local or name in self._names

    def origin_is_ours(self, origin: str | None, host: str, fetch_site: str | None) -> bool:
        """Whether a request comes from our own page, or from no page at all (a script, a chart plotter)."""
        if fetch_site is not None and fetch_site not in ("same-origin", "none"):
            return False
        if origin is None:
            return True
        scheme, separator, authority = origin.partition("://")
        if not separator or scheme not in _DEFAULT_PORTS:
            return False
        ours, theirs = _HOST.fullmatch(host), _HOST.fullmatch(authority)
        if not ours or not theirs:
            return False
        default = _DEFAULT_PORTS[scheme]
        return (ours[1].lower(), ours[2] or default) == (theirs[1].lower(), theirs[2] or default)

    def wait_s(self, address: str) -> float:
        """How long `address`, having sent wrong tokens, has to wait, seconds."""
        return self._failures.wait_s(address)

    def token_is_right(self, token: str, address: str) -> bool:
        """Whether `token` is ours; a wrong one is counted against `address`, and while it waits none is right."""
        if self._token is None or self._failures.wait_s(address) > 0.0:
            return False
        if hmac.compare_digest(_normal(token), self._token):
            return True
        self._failures.add(address)
        return False

    def session(self) -> str:
        """A cookie's value for somebody who has sent the token; it ends after `SESSION_S`, or with the token."""
        expiry = str(int(time.time()) + SESSION_S)
        return f"{expiry}.{self._signature(expiry)}"

    def may_control(self, authorization: str | None, cookie: str | None, address: str) -> bool:
        """Whether a request with these headers may start and stop tasks."""
        if self._token is None:
            return True
        if cookie is not None and self._session_is_ours(cookie):
            return True
        kind, _, token = (authorization or "").partition(" ")
        return kind.lower() in ("bearer", "jwt") and self.token_is_right(token, address)

    def may_read(self, authorization: str | None, cookie: str | None, address: str) -> bool:
        """Whether a request with these headers may see what the boat does."""
        return not self._read_token or self.may_control(authorization, cookie, address)

    def _session_is_ours(self, cookie: str) -> bool:
        expiry, _, signature = cookie.partition(".")
        ours = hmac.compare_digest(signature.encode("utf-8", "replace"), self._signature(expiry).encode())
        return ours and expiry.isdecimal() and expiry.isascii() and int(expiry[:15]) > time.time()

    def _signature(self, expiry: str) -> str:
        assert self._token is not None
        return hmac.new(self._token, b"session " + expiry.encode("utf-8", "replace"), hashlib.sha256).hexdigest()

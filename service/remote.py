"""A client of the running service, for the command line: start a check and wait for its end."""

from __future__ import annotations

import json
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from typing import Any

POLL = 0.2
"""Between two looks at the run [s]."""

Noted = Callable[[int, int, str], None]
"""Called with (steps done, steps in all, what is being done)."""


class RemoteError(RuntimeError):
    """The service refused, or cannot be reached; the message says why and what to do."""


class Service:
    """The REST API at ``url``; ``token`` where the service wants one."""

    def __init__(self, url: str, token: str | None = None) -> None:
        if not url.startswith(("http://", "https://")):
            raise RemoteError(f"{url!r} is no address of a service; use http://host:port")
        self._url = url.rstrip("/")
        self._token = token

    def check(self, target: str, noted: Noted) -> dict[str, Any]:
        """Start a check of an axis or group, wait for its end, and return the run. Raises RemoteError."""
        known = self._call("GET", "/api/v1/axes")["items"]
        axes, groups = ({axis[key] for axis in known} for key in ("name", "group"))
        if target not in axes | groups:
            raise RemoteError(
                f"{target!r} is not configured; axes are {', '.join(sorted(axes))}, groups {', '.join(sorted(groups))}"
            )
        accepted = self._call("POST", "/api/v1/checks", {"axis" if target in axes else "group": target})
        path = f"/api/v1/runs/{accepted['run_id']}"
        while (run := self._call("GET", path))["state"] in ("queued", "running"):
            progress = self._call("GET", "/api/v1/status").get("progress")
            if progress:
                noted(progress["done"], progress["total"], progress["phase"])
            time.sleep(POLL)
        return run

    def axis(self, name: str) -> dict[str, Any]:
        """Return an axis as it stands. Raises RemoteError."""
        return self._call("GET", f"/api/v1/axes/{urllib.parse.quote(name, safe='')}")

    def explain(self, run_id: int, tell: Callable[[str], None]) -> dict[str, Any]:
        """Have a stored run explained, wait for it, and return the explanation. Raises RemoteError."""
        accepted = self._call("POST", f"/api/v1/runs/{run_id}/explanations")
        while (found := self._call("GET", accepted["location"]))["state"] in ("queued", "running"):
            computing = self._call("GET", "/api/v1/status").get("computing")
            ours = computing is not None and computing["run_id"] == run_id
            tell(computing["what"] if computing and ours else f"run {run_id} waits for its turn")
            time.sleep(POLL)
        if found["found"] is None:
            raise RemoteError(f"run {run_id}: {found['state'].replace('_', ' ')}: {found['detail']}")
        return found

    def part_of_explanation(self, number: int, part: str) -> bytes:
        """Download the predictions (Parquet) or the report (HTML) of an explanation. Raises RemoteError."""
        return self._ask("GET", f"/api/v1/explanations/{number}/{part}")

    def _call(self, method: str, path: str, body: Any = None) -> dict[str, Any]:
        return dict(json.loads(self._ask(method, path, body)))

    def _ask(self, method: str, path: str, body: Any = None) -> bytes:
        headers = {"Accept": "application/json"}
        if self._token:
            headers["Authorization"] = f"Bearer {self._token}"
        data = None
        if body is not None:
            data = json.dumps(body).encode()
            headers["Content-Type"] = "application/json"
        request = urllib.request.Request(self._url + path, data=data, headers=headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=10) as reply:
                return bytes(reply.read())
        except urllib.error.HTTPError as error:
            raise RemoteError(_problem(error)) from error
        except OSError as error:
            raise RemoteError(
                f"no service answers at {self._url} ({error}): is it running? systemctl status flankwatch, or "
                "give its address with --url"
            ) from error


def _problem(error: urllib.error.HTTPError) -> str:
    """What a problem+json answer says."""
    try:
        problem = json.load(error)
        return f"{problem['title']}: {problem['detail']}"
    except (ValueError, KeyError, TypeError):
        return f"the service answered {error.code} {error.reason}"

"""Delivering an alarm: a command that the user names, without a shell, or a web address."""

from __future__ import annotations

import json
import subprocess
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

from operation.follow.settings import Alarms

__all__ = ["NotDelivered", "deliver"]

#: Seconds that a command or a server may take.
PATIENCE = 30.0


class NotDelivered(RuntimeError):
    """An alarm could not be delivered; the message says why.  It is tried again after the next record."""


def deliver(alarms: Alarms, message: Mapping[str, Any]) -> bool:
    """Deliver a message by all the ways that are named; False where none is.

    The command reads the message as JSON from its standard input; nothing of it becomes an argument.

    Raises
    ------
    NotDelivered
        With every way that failed.
    """
    text = json.dumps(message, allow_nan=False, ensure_ascii=False)
    faults = []
    if alarms.command:
        try:
            done = subprocess.run(
                alarms.command, input=text, text=True, capture_output=True, timeout=PATIENCE, check=False
            )
            if done.returncode:
                said = (done.stderr or done.stdout).strip().splitlines()
                faults.append(f"{alarms.command[0]}: exit code {done.returncode}{': ' + said[-1] if said else ''}")
        except (OSError, subprocess.TimeoutExpired) as error:
            faults.append(f"{alarms.command[0]}: {error}")
    if alarms.webhook:
        request = urllib.request.Request(
            alarms.webhook, text.encode(), {"Content-Type": "application/json"}, method="POST"
        )
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE):
                pass
        except (urllib.error.URLError, OSError, ValueError) as error:
            faults.append(f"{alarms.webhook}: {error}")
    if faults:
        raise NotDelivered("; ".join(faults))
    return bool(alarms.command or alarms.webhook)

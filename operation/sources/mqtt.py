"""Records over MQTT: a message is one record; it is written to the disk before its arrival is acknowledged.

The broker keeps what is sent while this program is away (a session that lasts, quality of service 1), so a broker or a
follower that is restarted loses nothing and may deliver a message twice.  Needs the extra ``[mqtt]`` (Eclipse Paho).
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

__all__ = ["MqttAddress", "MqttInbox", "SourceError"]

#: Seconds between attempts to reach a broker, at first and at most.
RETRY = (1, 30)
#: Environment variable that holds the password: a command line is visible to others.
PASSWORD = "VTSDT_MQTT_PASSWORD"


class SourceError(ValueError):
    """A source of records cannot be used; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class MqttAddress:
    """A broker and a topic.

    Parameters
    ----------
    host : str
    port : int
    topic : str
        May have wild cards (``+``, ``#``).
    user : str
    secure : bool
        True for ``mqtts://``: TLS with the system's certificates.

    Examples
    --------
    >>> MqttAddress.parse("mqtt://broker.example/lifts/7/%23")
    MqttAddress(host='broker.example', port=1883, topic='lifts/7/#', user='', secure=False)
    """

    host: str
    port: int
    topic: str
    user: str = ""
    secure: bool = False

    @classmethod
    def parse(cls, text: str) -> MqttAddress:
        """Read ``mqtt://[user@]host[:port]/topic`` (``#`` in a topic may be written as it is, or ``%23``).

        Raises
        ------
        SourceError
            If it is no such address.
        """
        parts = urlsplit(text.replace("#", "%23"))
        faults = []
        if parts.scheme not in ("mqtt", "mqtts"):
            faults.append(f"begins with '{parts.scheme}': write mqtt:// or mqtts://")
        if not parts.hostname:
            faults.append("names no host")
        if not parts.path.strip("/"):
            faults.append("names no topic: mqtt://host/machines/7/records")
        if parts.password:
            faults.append(f"holds a password, which others can see: put it into {PASSWORD}")
        try:
            port = parts.port
        except ValueError:
            port, faults = None, [*faults, "the port is no number from 1 to 65535"]
        if faults:
            raise SourceError(f"--source {text}: " + "; ".join(faults))
        secure = parts.scheme == "mqtts"
        return cls(
            host=str(parts.hostname),
            port=port or (8883 if secure else 1883),
            topic=unquote(parts.path.strip("/")),
            user=unquote(parts.username or ""),
            secure=secure,
        )


class MqttInbox:
    """A folder into which the messages of a topic are written, one file each.

    Parameters
    ----------
    address : MqttAddress
    folder : Path
        Made if it is not there.  A file is named by the last level of its topic and by its content, so that a message
        that comes twice makes one file.
    client : str
        Name under which the broker keeps what is not delivered yet.
    suffix : str
        Of the files; the reader goes by it.

    Raises
    ------
    SourceError
        If the extra is not installed.
    """

    def __init__(self, address: MqttAddress, folder: Path, client: str, suffix: str = ".csv"):
        try:
            from paho.mqtt import client as paho
        except ImportError as error:
            raise SourceError("mqtt:// needs the extra [mqtt]: pip install 'vtsdt[mqtt]'") from error
        self.address, self.folder, self.suffix = address, folder, suffix
        self.received, self.failed = 0, ""
        self.connected = threading.Event()
        folder.mkdir(parents=True, exist_ok=True)
        self._client = paho.Client(
            paho.CallbackAPIVersion.VERSION2, client_id=client, clean_session=False, manual_ack=True
        )
        if address.user:
            self._client.username_pw_set(address.user, os.environ.get(PASSWORD, ""))
        if address.secure:
            self._client.tls_set()
        self._client.reconnect_delay_set(*RETRY)
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message

    def start(self) -> None:
        """Connect in a thread of its own; a broker that is not there is tried again and again."""
        self._client.connect_async(self.address.host, self.address.port)
        self._client.loop_start()

    def stop(self) -> None:
        """Disconnect; the broker keeps what comes meanwhile."""
        self._client.disconnect()
        self._client.loop_stop()

    def __enter__(self) -> MqttInbox:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _on_connect(self, client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self.failed = f"the broker refuses the connection: {reason}"
            return
        self.failed = ""
        client.subscribe(self.address.topic, qos=1)

    def _on_subscribe(self, _client: Any, _data: Any, _number: Any, _reasons: Any, _properties: Any) -> None:
        self.connected.set()

    def _on_disconnect(self, _client: Any, _data: Any, _flags: Any, _reason: Any, _properties: Any) -> None:
        self.connected.clear()

    def _on_message(self, client: Any, _data: Any, message: Any) -> None:
        try:
            self._keep(message.topic, bytes(message.payload))
        except OSError as error:  # a full disk: not confirmed, so the broker sends it again
            self.failed = f"{self.folder}: {error.strerror or error}"
            return
        client.ack(message.mid, message.qos)
        self.received += 1

    def _keep(self, topic: str, payload: bytes) -> None:
        last = topic.rsplit("/", 1)[-1]
        stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in last)[:80].lstrip(".") or "record"
        stem = stem.removesuffix(self.suffix)
        path = self.folder / f"{stem}-{hashlib.sha256(payload).hexdigest()[:16]}{self.suffix}"
        if path.exists():
            return
        handle, draft = tempfile.mkstemp(dir=self.folder, prefix=".", suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(payload)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)

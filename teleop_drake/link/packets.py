"""The packets of a link; docs/network.md has their layout.

A packet is believed if its keyed hash is right, if it is newer than those before, and
if it names the session of the process that it comes to. A session is a random number
of a process, so that a packet of another run, sent again, names another session.

The robot's side does not know who will call. It answers each hello, a packet that does
not name its session yet, with one packet. Only a caller that names the session in turn
is sent more. A caller that has another key gets a short notice instead, which is not
authenticated and is therefore only reported.
"""

import functools
import hashlib
import hmac
import os
import re
import secrets
import socket
from collections import Counter
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.validation import Refuse

NUM_USED = 32
"""A packet says what was in use at so many ticks: so many in a row may be lost."""

WRONG_KEY_NOTICE = b"TDL?key"
"""What a caller is sent whose packets have another key."""

Address = tuple[Any, ...]
"""Where a socket sends to: host, port, and more with IPv6."""

_MAGIC = b"TDL"
_VERSION = 1
_HASH_SIZE = 16


class Reason(StrEnum):
    """Why a datagram is not believed; they are examined in this order."""

    NOTICE = "notice"
    FOREIGN = "foreign"
    HASH = "hash"
    VERSION = "version"
    OWN = "own"
    SCENARIO = "scenario"
    HELLO = "hello"
    SESSION = "session"
    OLD = "old"
    VALUES = "values"


class Opened(NamedTuple):
    """A datagram that was opened.

    Attributes:
        packet: Its packet, of PacketType(); None if it is not believed.
        reason: Why it is not believed; None if it is.
    """

    packet: Any
    reason: Reason | None


@functools.cache
def PacketType(size: int) -> np.dtype[Any]:
    """Returns the layout of a packet with a signal of some size.

    Each field is an attribute of a packet. `start` is when tick 0 of the sender was, by
    its own clock, ns; 0: not yet. `tick` is its last one; -1 before the start. `used`
    is the tick of the packet that was in use at each of its last ticks; -1: none.
    `ended` is 1 if it sends no more than this.
    """
    fields: list[Any] = [
        ("magic", "S3"),
        ("version", "u1"),
        ("role", "u1"),
        ("ended", "u1"),
        ("size", "<u2"),
        ("session", "<i8"),
        ("peer", "<i8"),
        ("sequence", "<i8"),
        ("sent", "<i8"),
        ("heard", "<i8"),
        ("held", "<i8"),
        ("agreement", "<i8"),
        ("start", "<i8"),
        ("tick", "<i8"),
        ("used", "<i4", NUM_USED),
        ("values", "<f8", (size,)),
        ("hash", "V16"),
    ]
    return np.dtype((np.record, fields))


def FirstPacket(values: Array) -> Any:
    """Returns what is in use before any packet is heard: a signal of no tick."""
    packet = np.zeros(1, PacketType(len(values)))[0]
    packet.tick = -1
    packet.used = -1
    packet.values = values
    return packet


class Session:
    """One end of a conversation: seals what it sends, and opens what it receives.

    Args:
        key: The key of both sides (32 bytes).
        role: 0 at the operator, 1 at the robot.
        agreement: What both sides must have in common, as a number.
        size: Width of the signal that comes in.
        address: Where the other side is; None: not known yet.

    Attributes:
        refused: How many datagrams were not believed, by the reason.
        exchanges: How many packets were believed.
        round_trip: The shortest round trip of these, ns.
        offset: What to add to this clock to have the other one's, ns, if both ways of
            the shortest round trip took half of it.
    """

    def __init__(
        self,
        key: bytes,
        role: int,
        agreement: int,
        size: int,
        address: Address | None,
    ):
        self._key = key
        self._role = role
        self._agreement = agreement
        self._type = PacketType(size)
        self._session = secrets.randbits(63)
        # The number of the last packet that was sent.
        self._sequence = 0
        # Of the other side: its session, and of its last packet that counts its number,
        # when it was sent by its clock, and when it came by this clock.
        self._peer = 0
        self._last = 0
        self._heard = 0
        self._arrived = 0
        self.address = address
        self.refused: Counter[str] = Counter()
        self.exchanges = 0
        self.round_trip = np.inf
        self.offset = 0.0

    def Seal(
        self,
        now: int,
        values: Array,
        *,
        start: int,
        tick: int,
        used: Array,
        ended: bool,
    ) -> bytes:
        """Returns the next packet.

        Args:
            now: This clock, ns.
            values: The signal that goes out.
            start, tick, used, ended: See PacketType().
        """
        self._sequence += 1
        fields = {
            "magic": _MAGIC,
            "version": _VERSION,
            "role": self._role,
            "size": len(values),
            "session": self._session,
            "peer": self._peer,
            "sequence": self._sequence,
            "sent": now,
            "heard": self._heard,
            "held": now - self._arrived,
            "agreement": self._agreement,
            "start": start,
            "tick": tick,
            "used": used,
            "ended": ended,
            "values": values,
        }
        packet = np.zeros((), PacketType(len(values)))
        for name, value in fields.items():
            packet[name] = value
        data = packet.tobytes()[:-_HASH_SIZE]
        return data + self._Hash(data)

    def _Hash(self, data: bytes) -> bytes:
        return hashlib.blake2b(data, key=self._key, digest_size=_HASH_SIZE).digest()

    def Open(self, data: bytes, address: Address, now: int) -> Opened:
        """Opens a datagram that came now, and takes note of what is believed.

        A hello proves nothing about who sent it. It is remembered only so that the
        answer names its session.

        Args:
            address: Where it came from.
            now: This clock, ns.
        """
        packet, reason = self._Read(data)
        if reason is not None:
            self.refused[reason] += 1
        if packet is not None and reason in (None, Reason.HELLO):
            self._peer = packet.session
            self._heard = packet.sent
            self._arrived = now
        if packet is None or reason is not None:
            return Opened(None, reason)
        if self._role == 1:
            self.address = address
        self._last = packet.sequence
        self.exchanges += 1
        round_trip = float(now - packet.heard - packet.held)
        if round_trip <= self.round_trip:
            self.round_trip = round_trip
            self.offset = packet.sent + round_trip / 2 - now
        return Opened(packet, None)

    def _Read(self, data: bytes) -> tuple[Any, Reason | None]:
        """Returns the packet of a datagram, if it has one, and why it does not count.

        Nothing of it is looked at before its hash, but for its first letters.
        """
        if data == WRONG_KEY_NOTICE:
            return None, Reason.NOTICE
        if not data.startswith(_MAGIC):
            return None, Reason.FOREIGN
        if not hmac.compare_digest(data[-_HASH_SIZE:], self._Hash(data[:-_HASH_SIZE])):
            return None, Reason.HASH
        if data[3] != _VERSION:
            return None, Reason.VERSION
        if data[4] == self._role:
            return None, Reason.OWN
        if len(data) != self._type.itemsize:
            return None, Reason.SCENARIO
        packet = np.frombuffer(data, self._type)[0]
        return packet, self._WhyNotBelieved(packet)

    def _WhyNotBelieved(self, packet: Any) -> Reason | None:
        """Returns why a packet of somebody who has the key is not believed."""
        has_peer = self._last > 0
        if packet.agreement != self._agreement:
            return Reason.SCENARIO
        if has_peer and packet.session != self._peer:
            return Reason.SESSION
        if packet.peer != self._session:
            return Reason.SESSION if has_peer else Reason.HELLO
        if packet.sequence <= self._last:
            return Reason.OLD
        if not np.isfinite(packet.values).all():
            return Reason.VALUES
        return None


def NewKey(file: str) -> None:
    """Writes a random key to a new file that only its owner can read.

    Raises:
        FileExistsError: If there is such a file.
    """
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "w") as stream:
        stream.write(secrets.token_hex(32) + "\n")


def ReadKey(file: str) -> bytes:
    """Returns the key in a file; refuses one that others can read."""
    allowed = (
        "a file that `teleop-drake serve --new-key FILE` made, for its owner alone"
    )
    try:
        with open(file, encoding="ascii") as stream:
            mode = os.fstat(stream.fileno()).st_mode & 0o777
            text = stream.read(100)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text"
        Refuse("key", file, f"{allowed} ({reason})")
    if mode & 0o077:
        Refuse("key", file, f"{allowed} (its mode is {mode:o}; `chmod 600` mends it)")
    if not re.fullmatch("[0-9a-f]{64}", text.strip()):
        Refuse("key", file, f"{allowed} (a key is 64 hexadecimal digits)")
    return bytes.fromhex(text)


def OpenSocket(address: str, *, listens: bool) -> tuple[socket.socket, Address]:
    """Returns a UDP socket that never waits, and what HOST:PORT means.

    Args:
        address: HOST:PORT.
        listens: Whether the socket listens there.
    """
    option = "listen" if listens else "connect"
    host, _, port = address.rpartition(":")
    if not port.isdecimal() or int(port) > 65535:
        Refuse(option, address, "HOST:PORT (a port is 0 to 65535)")
    try:
        places = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)
        family, *_, place = places[0]
        end = socket.socket(family, socket.SOCK_DGRAM)
        # A burst of others' datagrams pushes nothing out.
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        if listens:
            end.bind(place)
    except OSError as error:
        Refuse(option, address, f"HOST:PORT ({error})")
    end.setblocking(False)
    return end, place

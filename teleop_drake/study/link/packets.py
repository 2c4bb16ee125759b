"""The packets of a link; docs/network.md has their layout.

A packet is accepted if its keyed hash is right, if it is newer than all accepted ones,
and if it contains the session number of the receiver. Each process draws its session
number at random, so a packet that is replayed from another run contains another number.

The robot's side does not know in advance who will call. It answers each hello, which is
a packet without its session number, with one packet. It sends more packets only to a
caller whose packets then contain this number. A caller with another key gets a short
notice instead. A notice is not authenticated and is therefore only reported.
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

from teleop_drake.loops.framework.arrays import Array
from teleop_drake.loops.framework.validation import Refuse

NUM_USED = 32
"""Number of ticks whose packets in use are reported, in case packets are lost."""

WRONG_KEY_NOTICE = b"TDL?key"
"""The datagram that a caller gets if its packets have another key."""

Address = tuple[Any, ...]
"""The address of a socket: host, port, and further entries for IPv6."""

_MAGIC = b"TDL"
_VERSION = 1
_HASH_SIZE = 16


class Reason(StrEnum):
    """The reason why a datagram is rejected; reasons are tested in this order."""

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
    """A datagram that was checked.

    Attributes:
        packet: The packet, of PacketType(); None if it is rejected.
        reason: The reason why it is rejected; None if it is accepted.
    """

    packet: Any
    reason: Reason | None


@functools.cache
def PacketType(size: int) -> np.dtype[Any]:
    """Returns the layout of a packet with a signal of some size.

    Each field is an attribute of a packet. `start` is the time of the sender's tick 0
    by its own clock, ns; 0 if there is none yet. `tick` is the sender's last tick; -1
    before the start. `used` are the ticks of the packets in use at the sender's last
    NUM_USED ticks; -1: none. `ended` is 1 if the sender has ended.
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
    """Returns the packet in use before any packet is received; its tick is -1."""
    packet = np.zeros(1, PacketType(len(values)))[0]
    packet.tick = -1
    packet.used = -1
    packet.values = values
    return packet


class Session:
    """One end of a connection, which authenticates packets in both directions.

    Args:
        key: The key of both sides (32 bytes).
        role: 0 at the operator, 1 at the robot.
        agreement: A digest of the settings that both sides must have in common.
        size: Width of the signal that is received.
        address: The address of the other side; None: not known yet.

    Attributes:
        refused: The number of rejected datagrams, by the reason.
        exchanges: The number of accepted packets.
        round_trip: The shortest round trip of these packets, ns.
        offset: The other side's clock minus this one, ns, if both directions of the
            shortest round trip took half of it.
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
        # The other side's session number, and the number of its last accepted packet.
        # Then the time when its last packet, maybe a hello, was sent, by its clock, and
        # the time when it arrived, by this clock.
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
        """Returns the next packet, with its keyed hash.

        Args:
            now: The time of this clock, ns.
            values: The signal to send.
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
        # The hash covers everything before it.
        data = packet.tobytes()[:-_HASH_SIZE]
        return data + self._Hash(data)

    def _Hash(self, data: bytes) -> bytes:
        return hashlib.blake2b(data, key=self._key, digest_size=_HASH_SIZE).digest()

    def Open(self, data: bytes, address: Address, now: int) -> Opened:
        """Checks a datagram that has arrived; if it is accepted, updates the session.

        A hello does not prove who sent it. Its session number and time are stored only
        for the answer.

        Args:
            data: The datagram.
            address: The address of its sender.
            now: The time of this clock, ns.
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
        """Returns the packet of a datagram, or None, and why it is rejected, or None.

        Only its first letters are read before the hash has been verified.
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
        """Returns why a packet with the right hash is rejected; None if accepted."""
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
        FileExistsError: If the file exists already.
    """
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with open(descriptor, "w") as stream:
        stream.write(secrets.token_hex(32) + "\n")


def ReadKey(file: str) -> bytes:
    """Returns the key in a file; refuses a file that other users have access to."""
    allowed = (
        "a file that `teleop-drake serve --new-key FILE` made, for its owner alone"
    )
    try:
        with open(file, encoding="ascii") as stream:
            mode = os.fstat(stream.fileno()).st_mode & 0o777
            text = stream.read(100)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        Refuse("key", file, f"{allowed} ({reason})")
    if mode & 0o077:
        Refuse("key", file, f"{allowed} (its mode is {mode:o}; `chmod 600` mends it)")
    if not re.fullmatch("[0-9a-f]{64}", text.strip()):
        Refuse("key", file, f"{allowed} (a key is 64 hexadecimal digits)")
    return bytes.fromhex(text)


def OpenSocket(address: str, *, listens: bool) -> tuple[socket.socket, Address]:
    """Returns a non-blocking UDP socket, and the address that HOST:PORT means.

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
        # So large that a burst of foreign datagrams displaces no packets.
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        if listens:
            end.bind(place)
    except OSError as error:
        Refuse(option, address, f"HOST:PORT ({error})")
    end.setblocking(False)
    return end, place

"""The packets of a link; docs/network.md has their layout.

A packet counts if its keyed hash is right, if it is newer than those before, and if it
names the session, a random number, of the process that it comes to: a replay of another
session names another one.
"""

import functools
import hashlib
import hmac
import os
import secrets
import socket
from collections import Counter
from typing import Any

import numpy as np

from teleop_drake.arrays import Array
from teleop_drake.validation import Refuse

NUM_USED = 32
"""A packet says what was in use at so many ticks: so many in a row may be lost."""

_MAGIC, _HASH_SIZE = b"TDL\x01", 16
_NUMBERS = "session peer sequence sent heard held agreement start tick"


@functools.cache
def PacketType(size: int) -> np.dtype[np.void]:
    """Returns the layout of a packet with so many values."""
    fields: Any = [("magic", "S4"), ("role", "u1"), ("ended", "u1"), ("size", "<u2")]
    fields += [(name, "<i8") for name in _NUMBERS.split()]
    fields += [("used", "<i4", NUM_USED), ("values", "<f8", (size,)), ("hash", "V16")]
    return np.dtype(fields)


class Session:
    """One end of a conversation: seals what it sends, believes what is fresh.

    Args:
        role: 0 at the operator, 1 at the robot.
        agreement: What both sides must have in common, as a number.
        size: Width of the signal that comes in.
        address: Where the other side is; None: not known yet.

    Attributes:
        refused: How many packets were not believed, by the reason.
        round_trip: The shortest of so many `exchanges` in ns; `offset` is what to add
            to this clock to have the other one's, if both ways took half of it.
    """

    def __init__(self, key: bytes, role: int, agreement: int, size: int, address: Any):
        self._key, self._role, self._agreement = key, role, agreement
        self._type, self._session = PacketType(size), secrets.randbits(63)
        self._peer = self._sequence = self._last = self._heard = self._arrived = 0
        self.address, self.refused = address, Counter[str]()
        self.round_trip, self.offset, self.exchanges = np.inf, 0.0, 0

    def Seal(self, now: int, ended: bool, values: Array, *state: Any) -> bytes:
        """Returns the next packet; the state is `start`, `tick` and `used`."""
        self._sequence += 1
        mine = _MAGIC, self._role, ended, len(values), self._session, self._peer
        times = self._sequence, now, self._heard, now - self._arrived
        packet = *mine, *times, self._agreement, *state, values, b""
        data = np.array(packet, PacketType(len(values))).tobytes()[:-_HASH_SIZE]
        return data + self._Hash(data)

    def _Hash(self, data: bytes) -> bytes:
        return hashlib.blake2b(data, key=self._key, digest_size=_HASH_SIZE).digest()

    def Open(self, data: bytes, address: Any, now: int) -> Any:
        """Returns a packet that came now; None if it does not count, see `refused`."""
        packet, reason = self._Read(data)
        # A hello proves nothing, but is answered with its number.
        if not reason or (reason == "session" and not self._last):
            self._peer, self._heard = packet["session"], packet["sent"]
            self._arrived = now
            self.address = address if self._role else self.address
        if reason:
            self.refused[reason] += 1
            return None
        self._last = packet["sequence"]
        self.exchanges += 1
        round_trip = float(now - packet["heard"] - packet["held"])
        if round_trip <= self.round_trip:
            self.round_trip = round_trip
            self.offset = packet["sent"] + round_trip / 2 - now
        return packet

    def _Read(self, data: bytes) -> tuple[Any, str]:
        """Returns the packet that bytes are, if any, and why it does not count."""
        if data[:4] != _MAGIC:
            return None, "version" if data[:3] == _MAGIC[:3] else "foreign"
        if not hmac.compare_digest(data[-_HASH_SIZE:], self._Hash(data[:-_HASH_SIZE])):
            return None, "hash"
        if data[4] == self._role:
            return None, "own"
        fits = len(data) == self._type.itemsize
        packet = np.frombuffer(data, self._type)[0] if fits else None
        if packet is None or packet["agreement"] != self._agreement:
            return None, "scenario"
        is_other = self._last and packet["session"] != self._peer
        if packet["peer"] != self._session or is_other:
            return packet, "session"
        if packet["sequence"] <= self._last:
            return packet, "old"
        return packet, "" if np.isfinite(packet["values"]).all() else "values"


def NewKey(file: str) -> None:
    """Writes a random key to a new file that only its owner can read."""
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as key:
        key.write(secrets.token_hex(32) + "\n")


def ReadKey(file: str) -> bytes:
    """Returns the key in a file; refuses one that others can read."""
    try:
        with open(file, encoding="ascii") as stream:
            mode, text = os.fstat(stream.fileno()).st_mode & 0o777, stream.read(100)
        if mode & 0o077 == 0 and len(key := bytes.fromhex(text)) == 32:
            return key
        raise ValueError(f"its mode is {mode:o}, its length {len(text)}")
    except (OSError, ValueError) as error:
        Refuse("key", file, f"of `serve --new-key FILE`, for its owner alone ({error})")


def OpenSocket(address: str, *, listens: bool) -> tuple[socket.socket, Any]:
    """Returns a UDP socket that never waits, and HOST:PORT, at which it may listen."""
    host, _, port = address.rpartition(":")
    try:
        number = range(65536).index(int(port))  # Larger ones would be cut.
        places = socket.getaddrinfo(host.strip("[]"), number, type=socket.SOCK_DGRAM)
        end = socket.socket(places[0][0], socket.SOCK_DGRAM)
        # A burst of others' datagrams pushes nothing out.
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        if listens:
            end.bind(places[0][4])
    except (OSError, ValueError) as error:
        Refuse("listen" if listens else "connect", address, f"HOST:PORT ({error})")
    end.setblocking(False)
    return end, places[0][4]

"""The packets of a link; docs/network.md has their layout.

A packet counts if its keyed hash is right, if it is newer than those before, and if it
names the session, a random number, of the process that it comes to: a replay of another
session names another one.
"""

import contextlib
import hashlib
import hmac
import os
import secrets
import socket
import struct
from collections import Counter, namedtuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_drake.validation import Refuse

Array = NDArray[np.float64]

WAITING, RUNNING, ENDED = range(3)
"""The states of a side."""

NUM_USED = 32
"""A packet says what was in use at so many ticks: so many in a row may be lost."""

_START, _HASH_SIZE = b"TDL\x01", 16
_HEADER = struct.Struct(f"<4sBBHQQQqqqqqq{NUM_USED}i")
Packet = namedtuple(
    "Packet",
    "magic role state num_values session peer sequence sent heard held start agreement "
    "tick used values",
)
NOTHING = Packet._make([_START, *[0] * 11, -1, (-1,) * NUM_USED, None])
"""The newest packet as long as there is none."""

# Most datagrams that are read in a period: a flood takes no longer.
_MAX_DATAGRAMS = 256


class Session:
    """One end of a conversation: seals what it sends, believes what is fresh.

    Args:
        key: The secret of both sides.
        role: 0 at the operator, 1 at the robot.
        agreement: What both sides must have in common, as a number.
        size: Width of the signal that comes in.

    Attributes:
        address: Where the other side is; None: not known yet.
        refused: How many packets were not believed, by the reason.
        round_trip: The shortest so far in ns; `offset` is what to add to this clock to
            have the other one's, if both ways took half of it.
        num_exchanges: How many round trips were measured.
    """

    def __init__(
        self, key: bytes, role: int, agreement: int, size: int, address: Any = None
    ):
        self._key, self._role, self._agreement = key, role, agreement
        self._length = _HEADER.size + 8 * size + _HASH_SIZE
        self._session, self._peer = secrets.randbits(63) + 1, 0
        self._sequence = self._last = self._heard = self._arrived = 0
        self.address, self.refused = address, Counter[str]()
        self.round_trip, self.offset, self.num_exchanges = np.inf, 0.0, 0

    def Seal(
        self, now: int, state: int, start: int, used: list[int], values: Array
    ) -> bytes:
        """Returns the next packet; `used` has the packets in use at all ticks."""
        self._sequence += 1
        header = _HEADER.pack(
            *(_START, self._role, state, len(values), self._session, self._peer),
            *(self._sequence, now, self._heard, now - self._arrived, start),
            *(self._agreement, len(used) - 1),
            *(*used[: -NUM_USED - 1 : -1], *NOTHING.used)[:NUM_USED],
        )
        data = header + values.astype("<f8").tobytes()
        return data + self._Hash(data)

    def _Hash(self, data: bytes) -> bytes:
        return hashlib.blake2b(data, key=self._key, digest_size=_HASH_SIZE).digest()

    def Open(self, data: bytes, now: int, address: Any) -> Any:
        """Returns a packet that came now; None if it does not count, see `refused`."""
        packet, reason = self._Read(data)
        # A hello proves nothing, but is answered with its number.
        if not reason or (reason == "session" and not self._last):
            self._peer, self._heard, self._arrived = packet.session, packet.sent, now
            if self._role == 1:
                self.address = address
        if reason:
            self.refused[reason] += 1
            return None
        self._last = packet.sequence
        round_trip = now - packet.heard - packet.held
        self.num_exchanges += 1
        if round_trip <= self.round_trip:
            self.round_trip = round_trip
            self.offset = packet.sent + round_trip / 2 - now
        return packet

    def _Read(self, data: bytes) -> tuple[Any, str]:
        """Returns the packet that bytes are, if any, and why it does not count."""
        if data[:4] != _START:
            return None, "version" if data[:3] == _START[:3] else "foreign"
        body = data[:-_HASH_SIZE]
        if not hmac.compare_digest(data[-_HASH_SIZE:], self._Hash(body)):
            return None, "hash"
        if data[4] == self._role:
            return None, "own"
        if len(data) != self._length:
            return None, "scenario"
        fields = _HEADER.unpack_from(data)
        values = np.frombuffer(body[_HEADER.size :], "<f8").astype(float)
        packet = Packet._make([*fields[:13], fields[13:], values])
        is_other = self._last and packet.session != self._peer
        if packet.agreement != self._agreement:
            return None, "scenario"
        if packet.peer != self._session or is_other:
            return packet, "session"
        if packet.sequence <= self._last:
            return packet, "old"
        return packet, "" if np.isfinite(values).all() else "values"


def NewKey(file: str) -> None:
    """Writes a random key to a new file that only its owner can read."""
    with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as key:
        key.write(secrets.token_hex(32) + "\n")


def ReadKey(file: str) -> bytes:
    """Returns the key in a file; refuses one that others can read."""
    try:
        with open(file, encoding="ascii") as stream:
            mode, key = os.fstat(stream.fileno()).st_mode, stream.read(100).strip()
        if mode & 0o077 == 0 and len(key) == 64:
            return bytes.fromhex(key)
        reason = f"its mode is {mode & 0o777:o}, its length {len(key)}"
    except (OSError, ValueError) as error:
        reason = str(error)
    Refuse("key", file, f"of `serve --new-key FILE`, for its owner alone ({reason})")


class Udp:
    """A UDP socket that never waits: it listens at HOST:PORT, or sends there."""

    def __init__(self, address: str, *, listens: bool):
        host, _, port = address.rpartition(":")
        self.address: Any
        try:
            if int(port) > 65535:
                raise ValueError("there is no such port")
            (family, *_, self.address), *_ = socket.getaddrinfo(
                host.strip("[]"), int(port), type=socket.SOCK_DGRAM
            )
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            # A burst of others' datagrams pushes nothing out.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
            if listens:
                self._socket.bind(self.address)
                self.address = self._socket.getsockname()
        except (OSError, ValueError, OverflowError) as error:
            Refuse("listen" if listens else "connect", address, f"HOST:PORT ({error})")
        self._socket.setblocking(False)
        self.Close = self._socket.close

    def Send(self, data: bytes, address: Any) -> None:
        """Sends a datagram; one that the system does not take is lost."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, address)

    def Receive(self) -> list[tuple[bytes, Any]]:
        """Returns the datagrams that have come, and from where."""
        datagrams = []
        with contextlib.suppress(OSError):  # None is left.
            for _ in range(_MAX_DATAGRAMS):
                datagrams.append(self._socket.recvfrom(2048))
        return datagrams

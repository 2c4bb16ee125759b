"""What ping prints, on every system: small outputs of our own making."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables import ReadPackets

LOST = float("nan")


def answer(number, ms, before="", name="icmp_seq"):
    return f"{before}64 bytes from 192.0.2.1: {name}={number} ttl=57 time={ms} ms\n"


def read(tmp_path, text, **given):
    path = tmp_path / "ping.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ReadPackets("trace", {"file": str(path), **given} if given else str(path))


def summary(sent, received, time="", mean=None, words="received"):
    share = 100 * (sent - received) / sent
    lines = (
        f"\n--- h ping statistics ---\n{sent} packets transmitted, {received} {words}"
    )
    lines += f", {share:g}% packet loss{time}\n"
    if mean is not None:
        lines += f"rtt min/avg/max/mdev = 1.0/{mean}/99.0/0.5 ms\n"
    return lines


IPUTILS = "PING h (192.0.2.1) 56(84) bytes of data.\n"
BSD = "PING h (192.0.2.1): 56 data bytes\n"
BOTH = answer(1, 10.0) + answer(2, 30.0)

WINDOWS = """\

Pinging a.example [192.0.2.1] with 32 bytes of data:
Reply from 192.0.2.1: bytes=32 time=10ms TTL=57
Request timed out.
Reply from 192.0.2.1: bytes=32 time<1ms TTL=57
Reply from 192.0.2.9: Destination host unreachable.

Ping statistics for 192.0.2.1:
    Packets: Sent = 4, Received = 3, Lost = 1 (25% loss),
Approximate round trip times in milli-seconds:
    Minimum = 0ms, Maximum = 10ms, Average = 5ms
"""
WINDOWS_READ = [10.0, LOST, 0.5, LOST], [0, 1, 2, 3]
GERMAN = """\

Ping wird ausgeführt für a.example [192.0.2.1] mit 32 Bytes Daten:
Antwort von 192.0.2.1: Bytes=32 Zeit=10ms TTL=57
Zeitüberschreitung der Anforderung.
Antwort von 192.0.2.1: Bytes=32 Zeit=30ms TTL=57

Ping-Statistik für 192.0.2.1:
    Pakete: Gesendet = 3, Empfangen = 2, Verloren = 1
    (33% Verlust),
Ca. Zeitangaben in Millisek.:
    Minimum = 10ms, Maximum = 30ms, Mittelwert = 20ms
"""
FRENCH = """\

Envoi d'une requête 'ping' sur a.example [192.0.2.1] avec 32 octets de données :
Réponse de 192.0.2.1 : octets=32 temps=10 ms TTL=57
Délai d'attente de la demande dépassé.
Réponse de 192.0.2.1 : octets=32 temps=30 ms TTL=57

Statistiques Ping pour 192.0.2.1:
    Paquets : envoyés = 3, reçus = 2, perdus = 1 (perte 33%),
"""
# The lines of a summary, which other languages break or divide by other commas.
ITALIAN = """\

Esecuzione di Ping a.example [192.0.2.1] con 32 byte di dati:
Risposta da 192.0.2.1: byte=32 durata=10ms TTL=57
Richiesta scaduta.
Risposta da 192.0.2.1: byte=32 durata=30ms TTL=57

Statistiche Ping per 192.0.2.1:
    Pacchetti: Trasmessi = 3, Ricevuti = 2,
    Persi = 1 (33% persi),
Tempo approssimativo percorsi andata/ritorno in millisecondi:
    Minimo = 10ms, Massimo =  30ms, Medio =  20ms
"""
RUSSIAN = """\

Обмен пакетами с a.example [192.0.2.1] с 32 байтами данных:
Ответ от 192.0.2.1: число байт=32 время=10мс TTL=57
Превышен интервал ожидания для запроса.
Ответ от 192.0.2.1: число байт=32 время=30мс TTL=57

Статистика Ping для 192.0.2.1:
    Пакетов: отправлено = 3, получено = 2, потеряно = 1
    (33% потерь)
Приблизительное время приема-передачи в мс:
    Минимальное = 10мсек, Максимальное = 30 мсек, Среднее = 20 мсек
"""
CHINESE = """\

正在 Ping a.example [192.0.2.1] 具有 32 字节的数据:
来自 192.0.2.1 的回复: 字节=32 时间=10ms TTL=57
请求超时。
来自 192.0.2.1 的回复: 字节=32 时间=30ms TTL=57

192.0.2.1 的 Ping 统计信息:
    数据包: 已发送 = 3，已接收 = 2，丢失 = 1 (33% 丢失)，
往返行程的估计时间(以毫秒为单位):
    最短 = 10ms，最长 = 30ms，平均 = 20ms
"""
JAPANESE = """\

a.example [192.0.2.1]に ping を送信しています 32 バイトのデータ:
192.0.2.1 からの応答: バイト数 =32 時間 =10ms TTL=57
要求がタイムアウトしました。
192.0.2.1 からの応答: バイト数 =32 時間 =30ms TTL=57

192.0.2.1 の ping 統計:
    パケット数: 送信 = 3、受信 = 2、損失 = 1 (33% の損失)、
ラウンド トリップの概算時間 (ミリ秒):
    最小 = 10ms、最大 = 30ms、平均 = 20ms
"""
OVER_IPV6 = """\

Pinging a.example [2001:db8::1] with 32 bytes of data:
Reply from 2001:db8::1: time=10ms\x20
Request timed out.
Reply from 2001:db8::1: time=30ms\x20

Ping statistics for 2001:db8::1:
    Packets: Sent = 3, Received = 2, Lost = 1 (33% loss),
"""
CONSOLE = "Microsoft Windows [Version 10]\n\nC:\\>ping -t a.example\n"

# iputils in other languages: the counts, which stand before or behind their words.
COUNTS = {
    "Chinese": "已发送 4 个包， 已接收 2 个包, 50% 包丢失, 耗时 600 毫秒",
    "Japanese": "送信パケット数 4, 受信パケット数 2, パケット損失 50%, 時間 600ミリ秒",
    "Turkish": "4 paket iletildi, 2 alındı, %50 paket kaybı, süre 600ms",
    "Korean": "4 패킷이 전송되었습니다, 2 수신되었습니다, 50% 패킷 손실, 시간 600ms",
}
FPING = """\
192.0.2.1 : [0], 64 bytes, 10.0 ms (10.0 avg, 0% loss)
192.0.2.1 : [1], timed out (10.0 avg, 50% loss)
192.0.2.1 : [2], 64 bytes, 30.0 ms (20.0 avg, 33% loss)

192.0.2.1 : xmt/rcv/%loss = 3/2/33%, min/avg/max = 10.0/20.0/30.0
"""
THREE = [10.0, LOST, 30.0]

# What is printed, the round trips in ms, and the times in s when packets were sent.
DIALECTS = {
    "iputils, numbers missing": (
        IPUTILS + answer(1, 10.0) + answer(3, 30.0),
        THREE,
        [0, 1, 2],
    ),
    "iputils -i 0.2, lost at both ends": (
        IPUTILS + answer(2, 10.0) + answer(3, 30.0) + summary(4, 2, ", time 600ms", 20),
        [LOST, 10.0, 30.0, LOST],
        [0, 0.2, 0.4, 0.6],
    ),
    "iputils -D -O": (
        IPUTILS
        + answer(1, 10.0, "[1700000000.010] ")
        + "[1700000000.400] no answer yet for icmp_seq=2\n"
        + answer(3, 30.0, "[1700000000.430] "),
        THREE,
        [0, 0.2, 0.4],
    ),
    "an answer after `no answer yet`": (
        IPUTILS + BOTH + "no answer yet for icmp_seq=3\n" + answer(3, 1200),
        [10.0, 30.0, 1200],
        [0, 1, 2],
    ),
    "iputils, unreachable": (
        IPUTILS
        + answer(1, 10.0)
        + "From 192.0.2.9 icmp_seq=2 Destination Host Unreachable\n"
        + answer(3, 30.0)
        + summary(3, 2, ", time 2000ms", 20, "received, +1 errors"),
        THREE,
        [0, 1, 2],
    ),
    "iputils, duplicates": (
        IPUTILS
        + answer(1, 10.0)
        + answer(1, 14.0).replace(" ms", " ms (DUP!)")
        + answer(2, 30.0)
        + summary(2, 2, ", time 1000ms", 18, "received, +1 duplicates"),
        [10.0, 30.0],
        [0, 1],
    ),
    "iputils, answers that overtake each other": (
        IPUTILS + answer(1, 10.0) + answer(3, 30.0) + answer(2, 1500),
        [10.0, 1500, 30.0],
        [0, 1, 2],
    ),
    "iputils over IPv6": (
        IPUTILS.replace("(192.0.2.1) 56(84)", "(h (2001:db8:12:34:56::1)) 56")
        + "".join(
            f"64 bytes from h (2001:db8:12:34:56::1): icmp_seq={n} ttl=57 time={x} ms\n"
            for n, x in ((2, 10.0), (3, 30.0))
        ),
        [LOST, 10.0, 30.0],
        [0, 1, 2],
    ),
    "iputils in German, with a decimal comma": (
        "PING h (192.0.2.1) 56(84) Bytes an Daten.\n"
        "64 Bytes von 192.0.2.1: icmp_seq=1 ttl=57 Zeit=10,5 ms\n"
        "64 Bytes von 192.0.2.1: icmp_seq=2 ttl=57 Zeit=30,5 ms\n"
        "\n--- h ping-Statistik ---\n"
        "2 Pakete übertragen, 2 empfangen, 0% Paketverlust, Zeit 1000ms\n"
        "rtt min/avg/max/mdev = 10,500/20,500/30,500/0,1 ms\n",
        [10.5, 30.5],
        [0, 1],
    ),
    "macOS": (
        BSD
        + answer(0, "10.000")
        + "Request timeout for icmp_seq 1\n"
        + answer(2, "30.000")
        + summary(4, 2, "", 20, "packets received"),
        [*THREE, LOST],
        [0, 1, 2, 3],
    ),
    "macOS --apple-time": (
        BSD
        + answer(0, "10.000", "23:59:59.910000 ")
        + answer(1, "30.000", "00:00:00.130000 "),
        [10.0, 30.0],
        [0, 0.2],
    ),
    "BusyBox": (
        BSD
        + answer(0, "10.000", name="seq")
        + answer(2, "30.000", name="seq")
        + summary(3, 2, "", 20, "packets received"),
        THREE,
        [0, 1, 2],
    ),
    "fping": (FPING, THREE, [0, 1, 2]),
    "hping": (
        "len=46 ip=192.0.2.1 ttl=57 id=0 sport=80 flags=SA seq=0 win=9 rtt=10.0 ms\n"
        "len=46 ip=192.0.2.1 ttl=57 id=0 sport=80 flags=SA seq=1 win=9 rtt=30.0 ms\n",
        [10.0, 30.0],
        [0, 1],
    ),
    "Windows": (WINDOWS, *WINDOWS_READ),
    "Windows with its line ends": (WINDOWS.replace("\n", "\r\n"), *WINDOWS_READ),
    "Windows in German, of a terminal": (GERMAN.encode("cp850"), THREE, [0, 1, 2]),
    "Windows in German, of PowerShell": (GERMAN.encode("utf-16"), THREE, [0, 1, 2]),
    "Windows in French": (FRENCH.encode("cp1252"), THREE, [0, 1, 2]),
    "a collector's dates": (
        answer(1, 10.0, "[2030-05-27 10:59:00.210000] ")
        + answer(2, 30.0, "[2030-05-27 10:59:00.430000] "),
        [10.0, 30.0],
        [0, 0.2],
    ),
    "dates with a zone": (
        answer(1, 10.0, "2030-05-27T10:59:00.21+02:00 ")
        + answer(2, 30.0, "2030-05-27T10:59:00.43+02:00 "),
        [10.0, 30.0],
        [0, 0.2],
    ),
    "dates without a year": (
        answer(1, 10.0, "May 27 10:59:00.01 ") + answer(2, 30.0, "May 27 10:59:01.03 "),
        [10.0, 30.0],
        [0, 1],
    ),
    "Windows in Italian": (ITALIAN, THREE, [0, 1, 2]),
    "Windows in Russian, of a terminal": (RUSSIAN.encode("cp866"), THREE, [0, 1, 2]),
    "Windows in Chinese": (CHINESE, THREE, [0, 1, 2]),
    "Windows in Chinese, of a terminal": (CHINESE.encode("gbk"), THREE, [0, 1, 2]),
    "Windows in Japanese, of a terminal": (JAPANESE.encode("cp932"), THREE, [0, 1, 2]),
    "Windows over IPv6": (OVER_IPV6, THREE, [0, 1, 2]),
    "Windows, with the console's lines": (CONSOLE + WINDOWS, *WINDOWS_READ),
    "Windows, with a stamp on each line": (
        "".join(
            f"27.05.2030 10:59:0{min(i, 5)} {line}\n"
            for i, line in enumerate(GERMAN.splitlines())
        ),
        THREE,
        [0, 0.99, 1.98],
    ),
    **{
        f"iputils in {language}": (
            IPUTILS + BOTH.replace(" ms", unit) + f"\n--- h ---\n{counts}\n",
            [10.0, 30.0, LOST, LOST],
            [0, 0.2, 0.4, 0.6],
        )
        for (language, counts), unit in zip(
            COUNTS.items(), (" 毫秒", "ミリ秒", " ms", " ms"), strict=True
        )
    },
    "stamps in ms since 1970": (
        answer(1, 10.0, "[1700000000010] ") + answer(2, 30.0, "1700000000230 "),
        [10.0, 30.0],
        [0, 0.2],
    ),
    "numbers of 16 bits of macOS": (
        answer(65535, 10.0) + "Request timeout for icmp_seq 65536\n" + answer(1, 30.0),
        THREE,
        [0, 1, 2],
    ),
    "numbers of 16 bits": (
        answer(65535, 10.0) + answer(1, 30.0),
        THREE,
        [0, 1, 2],
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_dialect(dialect, tmp_path):
    text, round_trips, times = DIALECTS[dialect]
    packets = read(tmp_path, text)
    assert packets.times.tolist() == pytest.approx(times, abs=1e-6)
    expected = np.array(round_trips) / 2e3
    assert_allclose(packets.delays, expected, rtol=1e-12)
    assert packets.kind == "half of rtt"


def test_whole_seconds_are_spread_evenly(tmp_path):
    """Five packets a second: their mean distance follows from all of the stamps."""
    rows = [answer(i, 10.0, f"May 27 10:59:{i // 5:02d} ") for i in range(101)]
    packets = read(tmp_path, "".join(rows))
    assert np.diff(packets.times) == pytest.approx(np.full(100, 0.2))
    assert "coarse stamps: packets 0.2 s apart, their mean" in packets.Summary()


def test_what_was_read_is_told(tmp_path):
    text = IPUTILS + BOTH + answer(4, 20.0) + summary(4, 3, ", time 600ms", 20)
    assert read(tmp_path, text).Summary() == (
        "4 packets in 0.6 s, 1 lost, median 10 ms, 5 to 15 ms (half of rtt), clock: "
        "packets 0.2 s apart (from ping's summary)"
    )
    assert "packets 1 s apart (taken so: no stamps)" in read(tmp_path, BOTH).Summary()
    told = read(tmp_path, BOTH, interval=0.05).Summary()
    assert "packets 0.05 s apart (as given)" in told


def test_stamps_of_an_unknown_form_may_be_left_aside(tmp_path):
    text = "".join(answer(i, 10.0, f"{i / 5:.6f} ") for i in range(1, 4))
    with pytest.raises(
        ScenarioError, match=r"line 1, '0.200000 64 bytes.*must have a "
    ):
        read(tmp_path, text)
    assert read(tmp_path, text, interval=0.2).times.tolist() == [0, 0.2, 0.4]


STAMPED = answer(1, 10.0, "[1700000000.0] ") + answer(2, 30.0, "[1700000000.2] ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            IPUTILS + BOTH + summary(3, 3),
            "2 answers were read, and ping's summary has 3",
        ),
        (IPUTILS + BOTH + answer(5, 9) + summary(3, 3), "5 packets were read, and pin"),
        (
            IPUTILS + BOTH + summary(2, 2, "", 24.0),
            "a mean round trip of 20 ms was rea",
        ),
        (IPUTILS + STAMPED + summary(2, 2, ", time 9000ms"), "0.18 s, and ping's summ"),
        (
            WINDOWS.replace("Sent = 4", "Sent = 6").replace("Lost = 1", "Lost = 3"),
            "4 packets were read, and ping's sum",
        ),
        (IPUTILS + BOTH + IPUTILS + BOTH, "must be one run of ping; split the file"),
        (BOTH + BOTH, "line 3: packet 1: must be answered once, and is in line 1; if "),
        (
            answer(1, 9, "[1700000000.0] ") + answer(2, 9, "[1699999999.0] "),
            "line 2: must not be earlier than the answer before, and is by 1 s; if a ",
        ),
        (STAMPED + answer(3, 9), "line 3: must have a stamp, as other answers have"),
        (IPUTILS + summary(2, 0), "packets that were answered, and none of its 2 was"),
        (
            "no answer yet for icmp_seq=1\nno answer yet for icmp_seq=2\n",
            "none of its 2 was",
        ),
        (
            IPUTILS + summary(2, 2, "", 9),
            "has only the summary of 2 packets: leave out -q",
        ),
        (
            "".join(answer(i, f"10 ms [{1.7e9 + i:.0f}]") for i in (1, 2, 3)),
            " ms': must have a stamp in seconds since 1970, in ISO 8601",
        ),
        (
            IPUTILS + BOTH + answer(3, "14").removesuffix(" ms\n"),
            "line 4, '64 bytes from 192.0.2.1: icmp_seq=3 ttl=57 time=14': must have a",
        ),
        (
            BOTH.replace("ms", "milli"),
            "icmp_seq=1 ttl=57 time=10.0 milli': must have a round trip with its unit",
        ),
        (
            IPUTILS + BOTH + "--- h statistics ---\nfour packets, all answered\n",
            "line 4, '--- h statistics ---': must be followed by the numbers of pac",
        ),
        (
            WINDOWS.partition("\nPing stat")[0] + "Sent = 4\n",
            "line 7, 'Sent = 4': must have a round trip with its unit",
        ),
        (answer(1, 9), "must have two packets, and has 1"),
        (answer(1, 9) + answer(30000, 9), "packets 1 to 30000: must have fewer gaps"),
    ],
)
def test_what_disagrees_is_refused(text, message, tmp_path):
    with pytest.raises(ScenarioError) as error:
        read(tmp_path, text)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_bad_interval(tmp_path):
    with pytest.raises(ScenarioError, match=r"^trace.interval = 0: must be a finite n"):
        read(tmp_path, BOTH, interval=0)
    text = IPUTILS + BOTH + summary(2, 2, ", time 200ms")
    assert read(tmp_path, text, interval=0.21).times.tolist() == [0, 0.21]
    with pytest.raises(
        ScenarioError, match=r"^trace.interval = 1: must be 0.2 \(s\), "
    ):
        read(tmp_path, text, interval=1)


def test_columns_of_ping_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"^trace.columns = .*left out where the"):
        read(tmp_path, BOTH, columns={"time": 1})

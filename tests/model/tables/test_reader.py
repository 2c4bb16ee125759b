"""Files of each format as tables, and what of them is refused."""

import datetime
import gzip
import sys

import h5py
import numpy as np
import openpyxl
import pandas
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat

from teleop_drake.loops.framework.validation import ScenarioError
from teleop_drake.model.tables import ReadPackets, ReadTable
from teleop_drake.model.tables.motion import ReadMotion

TIMES = np.arange(5) * 0.1


def test_columns_are_found_by_name_and_number(tmp_path):
    (tmp_path / "a.csv").write_text("Time_s,Speed [mm/s],b\n0,1,5\n1,-1,6\n")
    table = ReadTable("FILE", str(tmp_path / "a.csv"))
    assert table.names == ["Time_s", "Speed [mm/s]", "b"]
    assert table.Find("time_S") == table.Find(1) == "Time_s"
    assert table.Find("3") == table.Find(3) == table.Find("B") == "b"
    assert table.Values("Speed [mm/s]").tolist() == [0.001, -0.001]
    assert table.Values("Speed [mm/s]", "").tolist() == [1, -1]
    with pytest.raises(ScenarioError, match=r"column 'Speed': must be one of Time_s"):
        table.Find("Speed")


def test_excel(tmp_path):
    path = str(tmp_path / "a.xlsx")
    dates = pandas.date_range("2030-05-27", periods=4, freq="100ms")
    table = pandas.DataFrame({"sent": dates, "rtt_ms": [40, np.nan, -1, 60]})
    table.to_excel(path, index=False)
    packets = ReadPackets("trace", path)
    assert packets.times.tolist() == pytest.approx([0, 0.1, 0.2, 0.3])
    assert_allclose(packets.delays, [0.02, np.nan, np.nan, 0.03])


def test_matlab(tmp_path):
    path = str(tmp_path / "a.mat")
    pose = {"x": np.sin(TIMES)[:, np.newaxis], "name": "hand"}
    savemat(path, {"time": TIMES, "pose": pose, "scale": 3.0, "vel": np.ones((5, 2))})
    assert ReadTable("FILE", path).names == ["time", "pose/x", "vel_0", "vel_1"]
    motion = ReadMotion("surgeon.file", path, 2)
    assert motion.times == pytest.approx(TIMES)
    assert motion.velocities.tolist() == np.ones((5, 2)).tolist()


def test_matlab_of_version_7_3(tmp_path):
    """It is HDF5 behind a block of 512 bytes, and has matrices column by column."""
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"] = TIMES[np.newaxis, :]
        file["vel"] = np.array([TIMES, 2 * TIMES])
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    motion = ReadMotion("surgeon.file", str(path), 2)
    assert motion.velocities == pytest.approx(np.outer(TIMES, [1, 2]))


def test_hdf5(tmp_path):
    path = str(tmp_path / "a.hdf5")
    with h5py.File(path, "w") as file:
        file["observations/qpos"] = np.column_stack([2 * TIMES, -TIMES])
        file["timestamp"] = TIMES
        file["images"] = np.zeros((5, 2, 2, 3), np.uint8)
        file["about"] = "of our own making"
    assert ReadTable("FILE", path).names == [
        "observations/qpos_0",
        "observations/qpos_1",
        "timestamp",
    ]
    motion = ReadMotion("surgeon.file", path, 2)
    assert motion.velocities == pytest.approx(np.tile([2.0, -1.0], (5, 1)))


def test_numpy(tmp_path):
    path = str(tmp_path / "a.npz")
    np.savez(path, time=TIMES, v=2 * TIMES, text="of no use")
    motion = ReadMotion("surgeon.file", path, 1)
    assert motion.velocities.ravel().tolist() == (2 * TIMES).tolist()


def test_a_column_of_vectors_is_several_columns(tmp_path, monkeypatch):
    """As Parquet files of robot learning have them; pandas reads these with pyarrow."""
    frame = pandas.DataFrame({"timestamp": TIMES, "v": [[1, -t] for t in TIMES]})
    monkeypatch.setattr(pandas, "read_parquet", lambda file: frame)
    (tmp_path / "a.parquet").write_bytes(b"")
    motion = ReadMotion("surgeon.file", str(tmp_path / "a.parquet"), 2)
    assert motion.velocities.tolist() == [[1, -t] for t in TIMES]


def ReadFrame(monkeypatch, tmp_path, frame):
    monkeypatch.setattr(pandas, "read_parquet", lambda file: frame)
    (tmp_path / "a.parquet").write_bytes(b"")
    return ReadPackets("trace", str(tmp_path / "a.parquet"))


def test_durations_and_an_index_are_columns(tmp_path, monkeypatch):
    """pandas writes such columns into Parquet; both have no unit in their names."""
    rtt = pandas.to_timedelta([40, np.nan, 60], unit="ms")
    index = pandas.to_timedelta([0, 100, 200], unit="ms").rename("time")
    packets = ReadFrame(monkeypatch, tmp_path, pandas.DataFrame({"rtt": rtt}, index))
    assert packets.times.tolist() == pytest.approx([0, 0.1, 0.2])
    np.testing.assert_allclose(packets.delays, [0.02, np.nan, 0.03])


def test_elapsed_times_of_excel(tmp_path):
    book = openpyxl.Workbook()
    book.active.append(["time", "v"])
    for i in range(3):
        book.active.append([datetime.timedelta(seconds=30 * i), 0.1 * i])
    book.save(tmp_path / "a.xlsx")
    motion = ReadMotion("surgeon.file", str(tmp_path / "a.xlsx"), 1)
    assert motion.times.tolist() == [0, 30, 60]


def test_a_workbook_has_one_sheet_with_rows(tmp_path):
    book = openpyxl.Workbook()
    for sheet in (book.active, book.create_sheet("later")):
        sheet.append(["time", "v"])
        sheet.append([0.0, 0.1])
    book.create_sheet("empty")
    file = str(tmp_path / "a.xlsx")
    book.save(file)
    with pytest.raises(
        ScenarioError, match="one sheet with rows, not 'Sheet', 'later'"
    ):
        ReadMotion("surgeon.file", file, 1)
    del book["later"]
    book["Sheet"].append([1.0, 0.2])
    book.save(file)
    assert ReadMotion("surgeon.file", file, 1).times.tolist() == [0, 1]


@pytest.mark.parametrize(
    "cells", [[True, False, True], list(pandas.date_range("2030-05-27", periods=3))]
)
def test_dates_and_marks_are_no_numbers(cells, tmp_path, monkeypatch):
    frame = pandas.DataFrame({"time_s": [0, 1, 2], "rtt_ms": cells})
    with pytest.raises(ScenarioError, match="column 'rtt_ms': must have numbers"):
        ReadFrame(monkeypatch, tmp_path, frame)


def test_missing_stamps_of_whole_numbers(tmp_path, monkeypatch):
    sent = 1_700_000_000_000_000_000 + np.arange(3) * 10**8
    received = pandas.array([*(sent[:2] + 20_000_000), None], dtype="Int64")
    frame = pandas.DataFrame({"sent_ns": sent, "received_ns": received})
    packets = ReadFrame(monkeypatch, tmp_path, frame)
    np.testing.assert_allclose(packets.delays, [0.02, 0.02, np.nan])


@pytest.mark.parametrize(
    ("suffix", "package"),
    [(".xlsx", "openpyxl"), (".h5", "h5py"), (".parquet", "pyarrow")],
)
def test_a_missing_package_is_named(suffix, package, tmp_path, monkeypatch):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"PK\x03\x04")
    if package == "pyarrow":  # pandas looks for another one as well.
        monkeypatch.setitem(sys.modules, "fastparquet", None)
    if package == "openpyxl":
        pandas.DataFrame({"a": [1]}).to_excel(path)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ScenarioError, match=f"reads it: pip install {package}$"):
        ReadTable("FILE", str(path))


SUFFIXES = [".csv", ".json", ".xlsx", ".parquet", ".mat", ".h5", ".npz"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_is_not_there(suffix, tmp_path):
    path = str(tmp_path / f"a{suffix}")
    with pytest.raises(ScenarioError) as error:
        ReadTable("FILE", path)
    assert str(error.value).endswith("must be readable (No such file or directory)")


@pytest.mark.parametrize("suffix", [".xlsx", ".mat", ".h5", ".npz"])
@pytest.mark.parametrize("data", [b"", b"x", b"PK\x03\x04", b"\x89HDF\r\n\x1a\n0000"])
def test_a_damaged_file(suffix, data, tmp_path):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data)
    with pytest.raises(ScenarioError) as error:
        ReadTable("FILE", str(path))
    assert f"must be a {suffix} file (" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("data", [b"a\x00b\n1,2\n", b"\xff\xfe\x00"])
def test_what_is_no_text(data, tmp_path):
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(ScenarioError, match="must be text, or have the suffix of its "):
        ReadTable("FILE", str(tmp_path / "a.csv"))


def test_a_compressed_text(tmp_path):
    path = tmp_path / "a.json.gz"
    data = gzip.compress(b'[{"t_s": 0, "rtt_ms": 40}, {"t_s": 1, "rtt_ms": 60}]')
    path.write_bytes(data)
    assert ReadPackets("trace", str(path)).delays.tolist() == [0.02, 0.03]
    for damaged in (data[:-9], data[:20] + b"x" + data[21:]):
        path.write_bytes(damaged)
        with pytest.raises(ScenarioError, match=r"must be a .gz file \("):
            ReadTable("FILE", str(path))


def test_a_directory(tmp_path):
    with pytest.raises(ScenarioError, match=r"must be readable \(Is a directory\)"):
        ReadTable("FILE", str(tmp_path))


def test_arrays_without_numbers(tmp_path):
    np.savez(tmp_path / "a.npz", text="of no use", one=1.0)
    with pytest.raises(ScenarioError, match="must have arrays of numbers, and has"):
        ReadTable("FILE", str(tmp_path / "a.npz"))

"""What the simulated drive puts on the wire, byte for byte as CiA 301 and CiA 402 have it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import pytest

from drivers.sim.drive_config import DriveFaults
from tests.drivers.sim.rig import DRIVE, Bench, Scripted, of, sdo_write, statusword


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_boots_up_once_into_pre_operational(bench):
    assert [(f[1], f[2].hex()) for f in bench.step(50)] == [(0x705, "00")]
    assert bench.ask("605#2b17100064000000") == "6017100000000000"
    beats = bench.step(250)
    assert [f[2].hex() for f in of(beats, 0x705)] == ["7f", "7f"]
    assert [round(f[0], 3) for f in of(beats, 0x705)] == [0.150, 0.250]


@pytest.mark.parametrize(
    ("command", "beat"), [("000#0105", "05"), ("000#0100", "05"), ("000#0205", "04"), ("000#8005", "7f")]
)
def test_heartbeat_tells_the_nmt_state(bench, command, beat):
    bench.write(0x1017, 0, 100, 2)
    bench.send(command)
    assert of(bench.step(120), 0x705)[-1][2].hex() == beat


def test_other_nodes_nmt_commands_do_not_concern_it(bench):
    bench.write(0x1017, 0, 100, 2)
    bench.send("000#0106")
    assert of(bench.step(120), 0x705)[-1][2].hex() == "7f"


@pytest.mark.parametrize(("reset", "profile_speed"), [("000#8105", "00000000"), ("000#8205", "10270000")])
def test_reset_boots_again_and_restores_its_part_of_the_dictionary(bench, reset, profile_speed):
    bench.write(0x1017, 0, 100, 2)
    bench.write(0x6081, 0, 10_000, 4)
    bench.step(10)
    bench.send(reset)
    assert [f[2].hex() for f in of(bench.step(300), 0x705)] == ["00"]
    assert bench.ask("605#4081600000000000")[8:] == profile_speed


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("605#4000100000000000", "4300100092010200"),  # device type 0x00020192
        ("605#4017100000000000", "4b17100000000000"),  # two bytes
        ("605#4018100000000000", "4f18100004000000"),  # one byte
        ("605#402f600000000000", "802f600000000206"),  # no such object
        ("605#4018100900000000", "8018100911000906"),  # no such sub-index
        ("605#2300100000000000", "8000100002000106"),  # read only
        ("605#2f17100064000000", "8017100010000706"),  # one byte for two
        ("605#2b86600003000000", "8086600030000906"),  # a profile type that it has not
        ("605#a000100000000000", "8000000001000405"),  # block upload is unknown
    ],
)
def test_sdo_answers(bench, request_, answer):
    assert bench.ask(request_) == answer


def test_written_value_reads_back_signed(bench):
    assert bench.ask("605#237d600118fcffff") == "607d600100000000"
    assert bench.ask("605#407d600100000000") == "437d600118fcffff"


def test_segmented_download(bench):
    assert bench.ask("605#2181600004000000") == "6081600000000000"
    assert bench.ask("605#0710270000000000") == "2000000000000000"
    assert bench.ask("605#4081600000000000") == "4381600010270000"


def test_segment_with_the_wrong_toggle_is_refused(bench):
    bench.ask("605#2181600004000000")
    assert bench.ask("605#1710270000000000") == "8081600000000305"


def test_client_abort_and_short_frames_get_no_answer(bench):
    bench.read()
    bench.send("605#8081600000000305")
    bench.send("605#40")
    assert bench.read() == []


def test_sync_counts_to_240_and_begins_again(bench):
    bench.set_up()
    syncs = of(bench.step(245), 0x080)
    assert [f[2][0] for f in syncs] == [*range(1, 241), 1, 2, 3, 4]
    assert syncs[9][0] - syncs[8][0] == pytest.approx(0.001, abs=1e-9)


def test_sync_counter_is_not_to_be_changed_while_syncing(bench):
    bench.write(0x1006, 0, 1000, 4)
    assert bench.ask("605#2f191000f0000000") == "8019100022000008"


def test_sync_without_counter_has_no_payload(bench):
    bench.write(0x1006, 0, 2000, 4)
    bench.write(0x1005, 0, 0x4000_0080, 4)
    syncs = of(bench.step(11), 0x080)
    assert [f[2] for f in syncs] == [b""] * 5


@pytest.mark.parametrize(
    ("speed_rad_s", "torque_n_m", "payload"),
    [
        (10.471975511965978, 1.0, "d0070000c8005002"),  # 100 rpm at 0.05 rpm, 200 ‰ of 5 N·m
        (-10.471975511965978, -0.005, "30f8ffffffff5002"),
        (0.0026, 1e6, "00000000ff7f5002"),  # half a count rounds down, torque saturates
    ],
)
def test_tpdo_holds_speed_torque_statusword(speed_rad_s, torque_n_m, payload):
    bench = Bench(Scripted(motor_speed=speed_rad_s, motor_torque=torque_n_m))
    bench.set_up()
    tpdos = of(bench.step(5), 0x185)
    bench.close()
    assert [f[2].hex() for f in tpdos] == [payload] * 4  # the fifth is under way


def test_tpdo_follows_its_sync_on_the_wire(bench):
    bench.set_up()
    frames = [f for f in bench.step(300) if f[1] in (0x080, 0x185)]
    assert [f[1] for f in frames] == [0x080, 0x185] * (len(frames) // 2)
    delays = [b[0] - a[0] for a, b in zip(frames[0::2], frames[1::2], strict=False)]
    assert 0.0001 < min(delays) < max(delays) < 0.0004


def test_no_tpdo_outside_operational(bench):
    bench.set_up()
    bench.send("000#8005")
    assert of(bench.step(10), 0x185) == []


def test_tpdo_as_the_master_maps_it():
    bench = Bench(Scripted(motor_position=3.141592653589793))
    bench.write(0x1800, 1, 0xC000_0185, 4)
    bench.write(0x1A00, 0, 0, 1)
    bench.write(0x1A00, 1, 0x6041_0010, 4)
    bench.write(0x1A00, 2, 0x6064_0020, 4)
    bench.write(0x1A00, 0, 2, 1)
    bench.write(0x1800, 2, 2, 1)  # every second SYNC
    bench.write(0x1800, 1, 0x4000_01C5, 4)
    bench.set_up()
    frames = bench.step(20)
    bench.close()
    assert of(frames, 0x185) == []
    assert [f[2].hex() for f in of(frames, 0x1C5)[:9]] == ["500200800000"] * 9  # half a turn of 65536
    assert len(of(frames, 0x1C5)) in (9, 10)


@pytest.mark.parametrize(
    ("sub", "value", "size", "code"),
    [
        (0, 0, 1, "22000008"),  # the PDO is valid
        (1, 0x6041_0010, 4, "22000008"),
    ],
)
def test_a_valid_pdo_is_not_mapped(bench, sub, value, size, code):
    assert bench.ask(sdo_write(0x1A00, sub, value, size))[8:] == code


@pytest.mark.parametrize(
    ("value", "code"), [(0x6502_0020, "41000406"), (0x6041_0020, "41000406"), (0x1234_0010, "41000406")]
)
def test_what_cannot_be_mapped_is_refused(bench, value, code):
    bench.write(0x1800, 1, 0xC000_0185, 4)
    bench.write(0x1A00, 0, 0, 1)
    assert bench.ask(sdo_write(0x1A00, 1, value, 4))[8:] == code


def test_a_mapping_beyond_eight_bytes_is_refused(bench):
    bench.write(0x1800, 1, 0xC000_0185, 4)
    bench.write(0x1A00, 0, 0, 1)
    for sub in (1, 2, 3):
        bench.write(0x1A00, sub, 0x6064_0020, 4)
    assert bench.ask(sdo_write(0x1A00, 0, 3, 1))[8:] == "42000406"


def test_statuswords_on_the_way_to_operation_enabled(bench):
    bench.set_up()
    seen = [statusword(of(bench.step(5), 0x185)[-1])]
    for controlword in (0x06, 0x07, 0x0F):
        bench.command(controlword)
        seen.append(statusword(of(bench.step(5), 0x185)[-1]))
    assert seen == [0x0250, 0x0231, 0x0233, 0x0237]


def test_the_sdo_shows_a_new_state_before_time_passes(bench):
    bench.set_up()
    bench.step(5)
    bench.write(0x6040, 0, 0x06, 2)
    assert bench.ask("605#4041600000000000") == "4b41600031020000"


def test_a_trip_sends_its_emcy_and_the_reset_withdraws_it():
    bench = Bench(drives=[replace(DRIVE, faults=DriveFaults(trip_in_move=0, trip_after_s=0.03))])
    bench.enable()
    bench.command(0x1F, 13_908)
    frames = bench.step(100)
    assert [f[2].hex() for f in of(frames, 0x085)] == ["1023030000000000"]
    assert statusword(of(frames, 0x185)[-1]) & 0x4F == 0x08
    assert bench.ask("605#403f600000000000") == "4b3f600010230000"
    assert bench.ask("605#4003100100000000") == "4303100110230000"
    bench.command(0x00)
    bench.command(0x80)
    frames = bench.step(10)
    bench.close()
    assert [f[2].hex() for f in of(frames, 0x085)] == ["0000000000000000"]
    assert statusword(of(frames, 0x185)[-1]) & 0x4F == 0x40


def test_frames_on_the_wire_are_spaced_by_their_length(bench):
    """At 1 Mbit/s 8 bytes take 111 to 135 µs, and no two frames overlap."""
    bench.set_up()
    frames = bench.step(200)
    for earlier, later in itertools.pairwise(frames):
        if len(later[2]) == 8:
            assert later[0] - earlier[0] > 111e-6

"""What can go wrong between this program and the iron.

::

    DriverError
    ├── BusError
    │   ├── BusNotOpened            "can0 does not exist": adapter unplugged, interface not brought up
    │   ├── BusLost                 receiving or sending failed: adapter, cable, interface down
    │   ├── BusOff                  the controller shut itself off: wiring, bit rate, terminator
    │   ├── BusSilent               open, but not one frame arrives: drives off, wrong bit rate
    │   └── BusOverloaded           more frames than the wire carries, or a transmit queue that never empties
    ├── NodeError
    │   ├── NodeSilent              a drive does not answer, or its heartbeat stopped
    │   ├── NodeRestarted           a drive booted again and forgot what was written to it
    │   ├── WrongDevice             something else than the configured drive sits at this node id
    │   ├── ObjectRefused           a drive aborts a read or a write of its object dictionary
    │   │   ├── JerkProfileRefused      no jerk-limited profile: the method cannot work on this drive
    │   │   ├── ProtectionNotConfirmed  its reaction to a lost master could not be set and read back
    │   │   └── MappingRefused          speed, torque and status could not be mapped
    │   ├── DriveFault              statusword: the drive has shut its power stage off
    │   ├── UnknownStatusword       a bit pattern that CiA 402 leaves out
    │   ├── StateTransitionTimeout  a controlword was sent, the statusword never followed
    │   ├── MoveRefused             outside the limits, or the set-point was not acknowledged
    │   └── MoveNotFinished         target reached never came, or the axis does not come to rest
    └── StreamError
        ├── SensorSilent            no data frames: unplugged, other id, other bit rate
        ├── SensorTooSlow           below the rate at which t2 means anything, or far from the configured one
        ├── SensorFault             its self-test failed
        ├── SamplesMissing          too few samples arrived to place them in time
        ├── CounterRestarted        the device restarted inside the recording
        └── ClockInconsistent       device and bus clock do not run evenly

Example: the emergency stop is pressed in mid-move. The drive sends EMCY 0x5441 and leaves *operation
enabled*; the wait for standstill raises ``DriveFault``, ``with drive.enabled():`` disables what is left to
disable.

Example: the adapter is pulled out. The receive loop closes the bus and goes on trying to open it; whoever
waits gets ``BusLost``; the drives miss the master's heartbeat and stop by themselves (0x6007).

Every class carries the likely physical cause and what to do, and says both in its message.
"""

from __future__ import annotations

from typing import ClassVar


class DriverError(Exception):
    """Something failed between this program and the machine: `what`, with the class' `cause` and `remedy`."""

    cause: ClassVar[str] = "unknown"
    remedy: ClassVar[str] = "look at the log of the service"

    def __init__(self, what: str, *details: object) -> None:
        super().__init__(what, *details)
        self.what = what

    def __str__(self) -> str:
        return f"{self.what}. Likely cause: {self.cause}. What to do: {self.remedy}."


class BusError(DriverError):
    """The bus as a whole."""


class BusNotOpened(BusError):
    """A bus could not be opened at all."""

    cause = "the CAN adapter is unplugged, or the interface was not brought up"
    remedy = (
        "`ip link show type can`; `ip link set can0 up type can bitrate 1000000`; "
        "`ip link set can0 txqueuelen 1000` (deploy/ holds both as a unit)"
    )


class BusLost(BusError):
    """A bus that worked failed; the receive loop goes on trying to re-open it."""

    cause = "the CAN adapter was unplugged or the interface went down"
    remedy = (
        "`ip -details link show can0`; check the plug; the bus re-opens by itself once the interface is up"
    )


class BusOff(BusError):
    """The CAN controller is bus-off; sending still reports success, hence this is watched by error frames."""

    cause = "a short circuit or an open line, a missing terminator, or a node with another bit rate"
    remedy = (
        "measure 60 ohm between CAN_H and CAN_L with the power off; compare bit rates; "
        "then `ip link set can0 down`, `ip link set can0 up`"
    )


class BusSilent(BusError):
    """The bus is open and nothing at all arrives."""

    cause = "the drives are without power, the cable is open, or the bit rate differs"
    remedy = "`candump can0` must show heartbeats; check the drives' supply and `bitrate`"


class BusOverloaded(BusError):
    """The frames do not fit onto the wire."""

    cause = "too many synchronous PDOs and sensor frames for the bit rate"
    remedy = "raise the bit rate, double the SYNC period, or move the accelerometers to a bus of their own"


class NodeError(DriverError):
    """One CANopen node, by its name and id."""


class NodeSilent(NodeError):
    """A node does not answer or its heartbeat or PDOs stopped."""

    cause = "the drive is without logic supply, its node id or bit rate differs, or its plug is loose"
    remedy = "check the drive's 24 V, its node id and bit rate, and the bus plug; then connect again"


class NodeRestarted(NodeError):
    """A node sent a boot-up message: its mapping and its protections are gone."""

    cause = "the drive's logic supply dipped or somebody reset it"
    remedy = "check the 24 V supply; connect again, which writes the protections anew"


class WrongDevice(NodeError):
    """The node is not the one that the configuration names."""

    cause = "the drive was exchanged, or two drives have their node ids swapped"
    remedy = "compare type plate and node id with the configuration of the axis"


class ObjectRefused(NodeError):
    """The drive aborted a transfer, or read back something else than was written."""

    cause = "the drive's firmware does not hold this object, or not in this range or state"
    remedy = "look the object up in the drive's manual; give the drive's own EDS in the configuration"


class JerkProfileRefused(ObjectRefused):
    """0x6086 = 2 or 0x60A4 was not accepted."""

    cause = (
        "some drives have no jerk-limited profile (0x6086 = 2 with 0x60A4), or only with another option set"
    )
    remedy = (
        "enable the jerk-limited profile in the drive, or use another drive: this axis cannot be diagnosed"
    )


class ProtectionNotConfirmed(ObjectRefused):
    """The drive's reaction to a lost master could not be set and read back; nothing may move."""

    cause = "the drive codes 0x1016, 0x6007, 0x605A or 0x6085 otherwise, or has them write-protected"
    remedy = "give the vendor's codes in the configuration; do not run the axis before they read back"


class MappingRefused(ObjectRefused):
    """The process data could not be mapped as needed."""

    cause = "the drive has fixed PDOs, or cannot map velocity, torque and statusword together"
    remedy = "map 0x606C, 0x6077 and 0x6041 into TPDO1 with the drive's own tool, transmission type 1"


class DriveFault(NodeError):
    """The drive reports a fault: error code of the EMCY message or of 0x603F."""

    cause = "see the drive's error code"
    remedy = "clear the cause at the machine, then reset the fault at the drive"

    def __init__(self, what: str, code: int = 0, register: int = 0) -> None:
        super().__init__(what, code, register)
        self.code = code
        self.register = register


class UnknownStatusword(NodeError):
    """The statusword tells none of the standard's states."""

    cause = "the TPDO carries something else than the statusword, or the drive is no CiA 402 drive"
    remedy = "compare the drive's TPDO1 mapping with 0x606C, 0x6077, 0x6041"


class StateTransitionTimeout(NodeError):
    """A controlword went out and the statusword did not follow."""

    cause = "main supply off, safe torque off (STO) active, enable input open, or another master in control"
    remedy = "check mains contactor, STO and enable inputs; see the statusword in the message"


class MoveRefused(NodeError):
    """A move was not begun."""

    cause = "the target lies outside the software limits, or the drive is still busy with another set-point"
    remedy = "check the axis' position and limits; no other master may command the drive"


class MoveNotFinished(NodeError):
    """A move was begun and did not end in time."""

    cause = "the axis is blocked or its position window (0x6067, 0x6068) is narrower than its friction allows"
    remedy = "look whether the axis is free; compare the position window with the following error at rest"


class StreamError(DriverError):
    """A stream of samples that does not come, or cannot be placed in time."""


class SensorSilent(StreamError):
    """Not one data frame in the time in which hundreds should have come."""

    cause = "the accelerometer is unplugged or without supply, or its frame id or bit rate differs"
    remedy = "check its cable (drag chains break first) and supply; `candump can0` must show its frame id"


class SensorTooSlow(StreamError):
    """The sample rate is not what the method needs or the configuration says."""

    cause = "the sensor is set to another output data rate, or the DBC does not belong to it"
    remedy = "set it to 2 kHz or more; compare its DBC and nominal rate with the configuration"


class SensorFault(StreamError):
    """The sensor says itself that it is broken."""

    cause = "its self-test failed: shock, moisture or an ageing element"
    remedy = "switch it off and on once; exchange it if the flag stays"


class SamplesMissing(StreamError):
    """Fewer frames than a regression of counter on time needs."""

    cause = "frames were lost in masses, or the recording was shorter than a few samples"
    remedy = "look at the bus' counts of lost frames and errors; record longer"


class CounterRestarted(StreamError):
    """The device's counter jumped: samples before and after have no common clock."""

    cause = "the device restarted inside the recording: its supply dipped"
    remedy = "check its supply; repeat the run"


class ClockInconsistent(StreamError):
    """Counter against bus time is not a straight line."""

    cause = "the PC's clock was stepped during the run, or the device dropped samples without counting them"
    remedy = "let the clock be slewed, not stepped (chrony); compare the device's time frames; repeat the run"

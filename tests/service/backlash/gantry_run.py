"""A simulated gantry as it would be recorded: clean speed and torque of both motors, noisy acceleration."""

from __future__ import annotations

import numpy as np

from service.dynamics.parameters import AxisParameters, GantryParameters, Machine
from service.dynamics.simulation import Simulation, simulate, ten_steps
from service.recording import AxisDescription, Recording, Trace

STEPS = 4


def simulated(first: AxisParameters, second: AxisParameters, k: float, offset: float = 0.0) -> Simulation:
    """STEPS steps of X1 and X2 on a bridge of stiffness k [N/m] that is free of stress at `offset` [m]."""
    bridge = GantryParameters("X1", "X2", k=k, offset=offset)
    return simulate(Machine({"X1": first, "X2": second}, (bridge,)), ten_steps(count=STEPS))


def recorded(run: Simulation, transmission: float, every: int = 8, noise: float = 0.05) -> Recording:
    """The run with drives sampled at 8 kHz / `every` and accelerometers at 2 kHz with `noise` [m/s²]."""
    rng, traces = np.random.default_rng(11), {}
    mean = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) / 4.0
    for name, axis in run.axes.items():
        measured = axis.measured
        load = np.convolve(measured.load_acceleration, mean, "same")[1::4]
        load = load + noise * rng.standard_normal(len(load))
        drive = slice(7, None, every)
        traces[name, "motor_speed"] = Trace(run.time[drive], measured.motor_speed[drive])
        traces[name, "motor_torque"] = Trace(run.time[drive], measured.motor_torque[drive])
        traces[name, "acceleration"] = Trace(run.time[1::4], load)
    described = tuple(AxisDescription(name, transmission) for name in run.axes)
    return Recording("simulated", described, traces, run.moves, (tuple(run.axes),))

"""The drive's PPI cascade, closed on the motor encoder (paper section IV).

Position P, speed PI, current loop. Computed once per sub-step, as a drive's processor does it; the torque
command is held in between. The current loop itself is a first-order lag and part of the mechanism's state, so
that it is propagated exactly.
"""

from __future__ import annotations

from service.dynamics.parameters import ControllerParameters


class PPIController:
    """One drive's cascade: it remembers the speed loop's integral and nothing else."""

    def __init__(self, parameters: ControllerParameters, dt: float) -> None:
        self._p = parameters
        self._integral_gain = parameters.Kp * dt / parameters.Tn
        self._integral = 0.0

    def torque(
        self, setpoint: tuple[float, float, float], motor_position: float, motor_speed: float
    ) -> float:
        """Return the torque command [N m] for a set-point (position, speed, acceleration) and the encoder.

        All in rad and s. At the torque limit the integral does not grow further, so that it need not unwind
        afterwards.
        """
        p = self._p
        position, speed, acceleration = setpoint
        error = p.Kv * (position - motor_position) + p.speed_feedforward * speed - motor_speed
        integral = self._integral + self._integral_gain * error
        command = p.Kp * error + integral + p.inertia_feedforward * acceleration
        if command > p.torque_limit:
            self._integral = min(self._integral, integral)
            return p.torque_limit
        if command < -p.torque_limit:
            self._integral = max(self._integral, integral)
            return -p.torque_limit
        self._integral = integral
        return command

    def disable(self) -> None:
        """Forget the integral: the drive gives no torque and starts afresh when it is enabled again."""
        self._integral = 0.0

"""MuJoCo >= 3.5: delays of actuators and sensors, in ring buffers of samples."""

import math

import mujoco
import numpy as np
from benchmarks.delay_standard.simulator import Input, NotOffered, Simulator

# The longest delay that changes, s.
LONGEST = 0.16

MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="Euler"/>
  <worldbody>{bodies}</worldbody>
  <actuator>{motors}</actuator>
  <sensor>{sensors}</sensor>
</mujoco>"""
BODY = """
<body><joint name="x{i}" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>"""


def history(delay: float, step: float) -> str:
    """Returns the attributes of a delay: as many samples as the manual asks for."""
    if delay == 0:
        return ""
    samples = math.ceil(delay / step - 1e-9)
    return f'delay="{delay!r}" nsample="{samples}" interp="linear"'


class MuJoCo(Simulator):
    # The integrator is the adapter's choice: mj_step1 and mj_step2 exclude RK4.
    name = "MuJoCo, semi-implicit Euler"
    pd_step = 1e-3

    @staticmethod
    def _motors(count: int, delay: float, step: float):
        """Returns a model of some motors with one delay each."""
        late = history(delay, step)
        text = MODEL.format(
            step=step,
            bodies="".join(BODY.format(i=i) for i in range(count)),
            motors="".join(f'<motor joint="x{i}" {late}/>' for i in range(count)),
            sensors="",
        )
        return mujoco.MjModel.from_xml_string(text)

    @staticmethod
    def _forces(model, data, signal: Input, times, delay=None):
        """Returns the forces that commands make, at the instants of the commands.

        Args:
            delay: Of the time in s, if the delay of the actuators varies.
        """
        step = model.opt.timestep
        rows = []
        for k in range(round(times[-1] / step) + 1):
            if delay is not None:
                model.actuator_delay[:] = delay(k * step)
            data.ctrl[:] = signal(k * step)
            mujoco.mj_forward(model, data)
            rows.append(data.actuator_force.copy())
            mujoco.mj_step(model, data)
        return np.array(rows)[np.round(times / step).astype(int)]

    def echo(self, signal: Input, path, times):
        if len(path) > 1:
            raise NotOffered("delays in series")
        model = self._motors(signal.size, path[0], 0.01)
        return self._forces(model, mujoco.MjData(model), signal, times)

    def varying_echo(self, signal: Input, T, times):
        model = self._motors(signal.size, LONGEST, 0.01)
        return self._forces(model, mujoco.MjData(model), signal, times, delay=T)

    def switched_echo(self, signal: Input, delays, times):
        model = self._motors(1, max(delays), 0.01)
        data = mujoco.MjData(model)
        columns = []
        for delay in delays:
            model.actuator_delay[:] = delay
            mujoco.mj_resetData(model, data)
            columns.append(self._forces(model, data, signal, times)[:, 0])
        return np.column_stack(columns)

    def pd(self, sensor, actuator, times):
        step = self.pd_step if times[-1] > 30 else 1e-4
        late = history(sensor, step)
        text = MODEL.format(
            step=step,
            bodies=BODY.format(i=0),
            motors=f'<motor joint="x0" {history(actuator, step)}/>',
            sensors=f'<jointpos joint="x0" {late}/><jointvel joint="x0" {late}/>',
        )
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        rows = []
        for _ in range(round(times[-1] / step) + 1):
            rows.append(data.qpos[0])
            mujoco.mj_step1(model, data)
            x, v = data.sensordata
            data.ctrl[0] = 4 * (1 - x) - 2 * v
            mujoco.mj_step2(model, data)
        return np.array(rows)[np.round(times / step).astype(int)]

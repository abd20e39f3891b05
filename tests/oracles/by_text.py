"""Small scenes as text, for tests to change."""

from pathlib import Path

DESIGN = """
schema = 1
kind = "gait-design"
[worm]
links = 2
mass = 1.0
[gait]
period = 1.0
length = [0.7, 1.3]
rate = 1.0
acceleration = 20.0
[objective]
maximise = "speed"
"""
GAIT = """
schema = 1
kind = "gait"
[worm]
links = 2
mass = 1.0
[gait]
shape = "block_wave"
period = 1.0
length = [0.7, 1.3]
"""
FAST = GAIT.replace("block_wave", "fast").replace("length = [0.7, 1.3]", "")
FILE = FAST.replace('"fast"', '"file"').replace("period = 1.0", "")
PARETO = DESIGN.replace("gait-design", "gait-pareto").replace(
    '[objective]\nmaximise = "speed"', '[pareto]\nagainst = "peak_spike_load"'
)
SWINGING = """
schema = 1
kind = "harmonic-masses"
[worm]
masses = 2
friction = { kind = "coulomb", forward = 0.1, backward = 0.2 }
[[worm.harmonic]]
amplitude = 1.0
phase = [0, 180]
"""
MATERIAL = """
schema = 1
kind = "material"
units = "SI"
[material]
field = 1.5e5
u0 = 0.071
youngs_modulus_eff = 1.6e4
"""
TRACK = """
schema = 1
kind = "track"
[worm]
links = 2
mass = 1.0
stiffness = 10.0
damping = 5.0
rest_length = 2.0
friction = { kind = "coulomb", forward = 1.0, backward = 10.0 }
[start]
position = [4.0, 2.0, 0.0]
[reference.gait]
shape = "fast"
period = 1.0
[tracker]
feedback = "derivative"
tube_radius = 0.2
growth = 1e4
[time]
end = 2.0
"""
SIMULATE = """
schema = 1
kind = "simulate"
[worm]
links = 2
mass = 1.0
stiffness = 10.0
damping = 0.5
rest_length = 2.0
friction = { kind = "coulomb", forward = 1.0, backward = 3.0 }
[time]
end = 2.0
"""
MODEL = """
schema = 1
kind = "simulate"
model.file = "own.py:build"
[time]
end = 1.0
"""
OWN = """
import casadi as ca
from wormopt import Model, Signal
def build(rate=1.0):
    x = ca.SX.sym("x")
    return Model("decay", x=[Signal("x", x, value=1.0)], ode=-rate * x)
"""

RANDOM = (
    TRACK.replace("[start]", 'random = { stiffness = { process = "fixed", spread = 1 } }\n[start]')
    + "[ensemble]\nmembers = 5\n"
)
CHANCE = (
    'worm.random={seed=3, stiffness={process="ornstein_uhlenbeck", deviation=3, '
    'correlation_time=0.5, step=0.1}, damping={process="steps", spread=2, interval=0.5}, '
    'rest_length={process="fixed", spread=[0.1, 0.3]}}'
)


def write(folder: Path, text: str | bytes, own: str = OWN) -> Path:
    for name in ("folder.py", "sub.csv"):
        (folder / name).mkdir(exist_ok=True)
    (folder / "broken.py").write_text("x = 1\ndef build(:\n")
    (folder / "null.py").write_bytes(b"x = 1\0")
    (folder / "own.py").write_text(own)
    path = folder / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path

"""Step commands for gaits on stepping motors, and the motion that they produce.

Examples
--------
>>> import wormopt as wo
>>> wo.stepper.Stepper(lead=2e-3, steps_per_turn=200, microsteps=2).travel
5e-06
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)

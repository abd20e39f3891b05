from wormopt.systems.spiked.stepper.bristles import ratchet as ratchet
from wormopt.systems.spiked.stepper.stepper import Stepper as Stepper
from wormopt.systems.spiked.stepper.steps import step_times as step_times

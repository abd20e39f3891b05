"""Designs that several tests look at: each is made once in a process."""

from functools import cache

from wormopt.systems.spiked.design.optimize import design

kept = cache(design)

from wormopt.systems.spiked.design.optimize import design as design
from wormopt.systems.spiked.limits import Limits as Limits
from wormopt.systems.spiked.runs.reference import gait_of_shape as gait_of_shape
from wormopt.systems.spiked.scenes.shapes import Shape as Shape
from wormopt.systems.spiked.scenes.shapes import why_unreadable as why_unreadable
from wormopt.systems.spiked.task import Search as Search
from wormopt.systems.spiked.task import Worm as Worm

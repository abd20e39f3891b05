from wormopt.systems.planar.body.se2 import circle_of as circle_of
from wormopt.systems.planar.body.se2 import compose as compose
from wormopt.systems.planar.body.se2 import inverse as inverse
from wormopt.systems.planar.body.shape import Shape as Shape
from wormopt.systems.planar.body.shape import chain_shape as chain_shape
from wormopt.systems.planar.body.shape import rigid_shape as rigid_shape
from wormopt.systems.planar.body.strokes import Harmonics as Harmonics
from wormopt.systems.planar.body.strokes import Polygon as Polygon

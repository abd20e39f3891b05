"""The crawl that several files of tests look at, followed once."""

from functools import cache

import wormopt as wo
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.crawling.crawl import Crawl

THREE = wo.planar.chain_shape(3, lengths=(1.0, 1.0, 1.0))
CIRCLE = wo.planar.Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])
SNAKE = Elliptic(1.0, 1.0, sideways=3.0)


@cache
def circle_of_three_links() -> Crawl:
    return wo.planar.crawl(THREE, SNAKE, CIRCLE)

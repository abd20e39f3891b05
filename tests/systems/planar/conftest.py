"""Crawls that several files of this folder look at."""

import pytest

from tests.oracles.by_crawls import circle_of_three_links
from wormopt.systems.planar.crawling.crawl import Crawl


@pytest.fixture(scope="session")
def cycle() -> Crawl:
    return circle_of_three_links()

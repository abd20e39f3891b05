"""Options of `simulate`."""

from wormopt.numerics.options import Exact as Exact
from wormopt.numerics.options import Recheck as Recheck
from wormopt.numerics.options import Route as Route
from wormopt.numerics.options import Smooth as Smooth
from wormopt.numerics.options import Tolerance as Tolerance
from wormopt.numerics.options import Treatment as Treatment

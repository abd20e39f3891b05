from wormopt.systems.pair.exact import magnetic_pair as magnetic_pair
from wormopt.systems.pair.slow import averaged_pair as averaged_pair
from wormopt.systems.pair.slow import slow_pair as slow_pair
from wormopt.systems.pair.slow import steady_pair as steady_pair

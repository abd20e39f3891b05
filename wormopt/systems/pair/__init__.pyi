from wormopt.systems.pair.averaged_pair import averaged_pair as averaged_pair
from wormopt.systems.pair.averaged_pair import steady_pair as steady_pair
from wormopt.systems.pair.magnetic_pair import magnetic_pair as magnetic_pair
from wormopt.systems.pair.slow_pair import slow_pair as slow_pair

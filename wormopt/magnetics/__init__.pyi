from wormopt.magnetics.coils import CoilRow as CoilRow
from wormopt.magnetics.material import Identification as Identification
from wormopt.magnetics.material import MagnetoElastic as MagnetoElastic
from wormopt.magnetics.material import identify_material as identify_material
from wormopt.magnetics.travelling import MovingProfile as MovingProfile
from wormopt.magnetics.travelling import moving_profile as moving_profile
from wormopt.magnetics.travelling import switched_course as switched_course
from wormopt.magnetics.winding import Coil as Coil

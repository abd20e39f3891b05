"""Two masses on a magneto-elastic link in a pulsating field.

Examples
--------
>>> import wormopt as wo
>>> pair = wo.pair.magnetic_pair(law=wo.Coulomb(0.5, 1.0), push=1.0, frequency=1.4)
>>> pair.n_x, [contact.name for contact in pair.contacts]
(4, ['mass 0', 'mass 1'])
"""

from wormopt.lazy import names_of

__getattr__, __dir__, __all__ = names_of(__name__, __file__)
